// What is known of each hit besides its instance and depth: where it comes from, its barycentric weights
// and its face's normal. Included once per instruction set.

static inline int64_t row_of(const Frame& frame, const Tile& tile, int32_t row) {
  return static_cast<int64_t>(tile.top + row) * frame.width + tile.left;
}

// Between two rounds the hits hold the sources as they are, with those of holdouts and open pixels.
static void store_sources(const Frame& frame, const Tile& tile, const Origins& origins, const LwHits& hits) {
  for (int32_t r = 0; r < tile.rows; ++r) {
    const int64_t at = row_of(frame, tile, r);
    for (int32_t c = 0; c < tile.columns; ++c) {
      const int64_t source = origins.source(origins.at[r * kStride + c]);
      hits.placement[at + c] = static_cast<int32_t>(source >> 32);
      hits.triangle[at + c] = static_cast<int32_t>(source);
    }
  }
}

static void load_sources(const Frame& frame, const Tile& tile, const LwHits& hits, Origins& origins) {
  for (int32_t r = 0; r < tile.rows; ++r) {
    const int64_t at = row_of(frame, tile, r);
    for (int32_t c = 0; c < tile.columns; ++c) {
      const int64_t source = source_of(static_cast<uint32_t>(hits.placement[at + c]),
                                       static_cast<uint32_t>(hits.triangle[at + c]));
      int32_t* origin = origins.at + r * kStride + c;
      *origin = c > 0 && origins.source(origin[-1]) == source ? origin[-1] : origins.add(source);
    }
  }
}

// Weights of corners 1 and 2 along a run of pixels of one triangle, which is in a lane of `of`.
static void write_weights(const Frame& frame, const Tile& tile, const Several& of, int lane,
                          const Candidate& run, float* out) {
  const double* ray_x = frame.ray_x.data() + tile.left;
  const double ry = frame.ray_y.data()[tile.top + run.y0];
  double a[3], rest[3];
  for (int k = 0; k < 3; ++k) {
    a[k] = of.e.a[k][lane];
    rest[k] = of.e.b[k][lane] * ry + of.e.c[k][lane];
  }
  for (int32_t c = run.x0; c <= run.x1; ++c) {
    const double e0 = a[0] * ray_x[c] + rest[0], e1 = a[1] * ray_x[c] + rest[1];
    const double e2 = a[2] * ray_x[c] + rest[2], sum = (e0 + e1) + e2;
    out[2 * c] = static_cast<float>(e1 / sum + 0.0);
    out[2 * c + 1] = static_cast<float>(e2 / sum + 0.0);
  }
}

// A vector to each pixel of a run, kBlock at a time: beyond the run what is within `room`, the rest of its row,
// is still to be written.
static inline void fill_run(const Normal& v, int32_t first, int32_t end, int32_t room, float* out) {
  const Row part[3] = {load<Row>(v.again), load<Row>(v.again + 2), load<Row>(v.again + 1)};
  int32_t c = first;
  for (; c < end && c + kBlock <= room; c += kBlock) {
    for (int k = 0; k < 3; ++k) store(out + 3 * c + k * kBlock, part[k]);
  }
  for (; c < end; ++c) std::memcpy(out + 3 * c, v.again, 3 * sizeof(float));
}

// The normals of runs, turned towards the camera by each pixel's own ray.
static void write_normals(const Frame& frame, const Tile& tile, const Several& of, const Candidate* runs,
                          int used, Turns& turns, float* normal) {
  const Facing facing = facing_of(frame, tile, of, runs, used, turns);
  const double* ray_x = frame.ray_x.data() + tile.left;
  for (int lane = 0; lane < used; ++lane) {
    const Candidate& run = runs[lane];
    float* out = normal + 3 * row_of(frame, tile, run.y0);
    const Normal v = facing.normal(lane);
    const bool is_turned = (facing.turned >> lane & 1) != 0;
    if ((facing.mixed >> lane & 1) == 0) {
      fill_run(v, run.x0, run.x1 + 1, run.x1 + 1, out);
      turns.flipped += is_turned ? run.x1 - run.x0 + 1 : 0;
      continue;
    }
    for (int32_t c = run.x0; c <= run.x1; ++c) {
      const bool here = facing.across[lane] * ray_x[c] + facing.rest[lane] > 0;
      for (int k = 0; k < 3; ++k) out[3 * c + k] = here == is_turned ? v.again[k] : 0.0f - v.again[k];
      turns.flipped += here;
    }
  }
}

// The normals of a triangle's corners in the camera's frame, of length 1; false where one has none.
static bool camera_normals(const double* m, const float* from, double to[3][3]) {
  double moved[3][3];  // the inverse transpose times the determinant: which way it points is open
  for (int i = 0; i < 3; ++i) {
    const double *a = m + 4 * ((i + 1) % 3), *b = m + 4 * ((i + 2) % 3);
    for (int j = 0; j < 3; ++j) moved[i][j] = a[(j + 1) % 3] * b[(j + 2) % 3] - a[(j + 2) % 3] * b[(j + 1) % 3];
  }
  for (int k = 0; k < 3; ++k) {
    double squares = 0;
    for (int i = 0; i < 3; ++i) {
      to[k][i] = (moved[i][0] * from[3 * k] + moved[i][1] * from[3 * k + 1]) + moved[i][2] * from[3 * k + 2];
      squares += to[k][i] * to[k][i];
    }
    const double length = std::sqrt(squares);
    if (!(length > 0 && length < INFINITY)) return false;
    for (int i = 0; i < 3; ++i) to[k][i] /= length;
  }
  return true;
}

// The corners' normals along a run, interpolated, on the side of the face normals that are there.
static void smooth_normals(const Frame& frame, const Tile& tile, const Several& of, int lane,
                           const Candidate& run, const float* corner_normal, float* normal) {
  double corner[3][3];
  if (!camera_normals(of.matrix[lane], corner_normal + 9 * of.triangle[lane], corner)) return;
  float weights[2 * kTile];
  write_weights(frame, tile, of, lane, run, weights);
  for (int32_t c = run.x0; c <= run.x1; ++c) {
    const double w1 = weights[2 * c], w2 = weights[2 * c + 1], w0 = 1 - w1 - w2;
    double n[3], squares = 0, along = 0;
    for (int i = 0; i < 3; ++i) {
      n[i] = (w0 * corner[0][i] + w1 * corner[1][i]) + w2 * corner[2][i];
      squares += n[i] * n[i];
      along += n[i] * normal[3 * c + i];
    }
    const double scale = (along < 0 ? -1.0 : 1.0) / std::sqrt(squares);
    if (!(squares > 0 && std::isfinite(scale))) continue;
    for (int i = 0; i < 3; ++i) normal[3 * c + i] = static_cast<float>(n[i] * scale + 0.0);
  }
}

// The first `used` of kLanes runs, each of one row and one triangle.
static void write_runs(const Frame& frame, const Tile& tile, const Candidate* runs, int used,
                       const LwHits& hits, Turns& turns) {
  const bool weighs = hits.barycentric != nullptr || hits.corner_normal != nullptr;
  const Several of = weighs ? set_up(frame, runs, used) : gather(frame, runs, used);
  for (int lane = 0; lane < used && hits.barycentric != nullptr; ++lane) {
    const int64_t at = row_of(frame, tile, runs[lane].y0);
    write_weights(frame, tile, of, lane, runs[lane], hits.barycentric + 2 * at);
  }
  if (hits.normal == nullptr) return;
  write_normals(frame, tile, of, runs, used, turns, hits.normal);
  for (int lane = 0; lane < used && hits.corner_normal != nullptr; ++lane) {
    float* row = hits.normal + 3 * row_of(frame, tile, runs[lane].y0);
    smooth_normals(frame, tile, of, lane, runs[lane], hits.corner_normal, row);
  }
}

static inline void write_missing(int64_t pixel, const LwHits& hits) {
  for (int k = 0; k < 2 && hits.barycentric != nullptr; ++k) hits.barycentric[2 * pixel + k] = NAN;
  for (int k = 0; k < 3 && hits.normal != nullptr; ++k) hits.normal[3 * pixel + k] = NAN;
  if (hits.placement != nullptr) hits.placement[pixel] = hits.triangle[pixel] = -1;
}

struct ShownRow {  // of a finished tile
  int32_t origin[kTile];  // -1 for holdouts and open pixels
  uint64_t begins;        // bit by bit the columns where a run of one origin begins
};

static inline void finish_origins(const Tile& tile, const Origins& origins, int32_t row, ShownRow& out) {
  const auto shown = [&](int32_t c) {
    const RowMask id = load<RowMask>(tile.id + row * kStride + c);
    return load<RowMask>(origins.at + row * kStride + c) | ~((id >= 0) & (id != INT32_MAX));
  };
  out.begins = 0;
  for (int32_t c = 0; c < kTile; c += kBlock) {
    const RowMask origin = shown(c);
    store(out.origin + c, origin);
    out.begins |= static_cast<uint64_t>(row_bits(origin != shown(c + 1))) << c;
  }
  out.begins = out.begins << 1 | 1;
  if (tile.columns < kTile) out.begins &= (uint64_t{1} << tile.columns) - 1;
}

// A finished tile.
static void write_hits(const Frame& frame, const Tile& tile, Origins& origins, const LwHits& hits) {
  Candidate few[kLanes];
  int waiting = 0;
  for (int32_t r = 0; r < tile.rows; ++r) {
    const int64_t at = row_of(frame, tile, r);
    ShownRow shown;
    finish_origins(tile, origins, r, shown);
    if (hits.normal != nullptr && r + kAhead < tile.rows) {
      expect_row(3 * tile.columns, hits.normal + 3 * (at + int64_t{kAhead} * frame.width));
    }
    for (uint64_t begins = shown.begins; begins != 0;) {
      const int32_t first = __builtin_ctzll(begins);
      begins &= begins - 1;
      const int32_t end = begins == 0 ? tile.columns : __builtin_ctzll(begins);
      if (shown.origin[first] < 0) {
        for (int32_t c = first; c < end; ++c) write_missing(at + c, hits);
        continue;
      }
      const Origin& origin = origins.known[static_cast<size_t>(shown.origin[first])];
      const auto placement = static_cast<uint32_t>(origin.source >> 32), triangle = static_cast<uint32_t>(origin.source);
      const auto row = static_cast<uint8_t>(r);
      const Candidate run{0, triangle, placement, static_cast<uint8_t>(first), static_cast<uint8_t>(end - 1), row, row};
      for (int32_t c = first; c < end && hits.placement != nullptr; ++c) {
        hits.placement[at + c] = static_cast<int32_t>(placement);
        hits.triangle[at + c] = static_cast<int32_t>(triangle);
      }
      if (origin.turned >= 0) {
        fill_run(origin.normal, first, end, tile.columns, hits.normal + 3 * at);
        origins.turns.flipped += origin.turned * (end - first);
        continue;
      }
      if (hits.barycentric == nullptr && hits.normal == nullptr) continue;
      few[waiting++] = run;
      if (waiting == kLanes) {
        write_runs(frame, tile, few, waiting, hits, origins.turns);
        waiting = 0;
      }
    }
  }
  if (waiting > 0) write_runs(frame, tile, few, waiting, hits, origins.turns);
}
