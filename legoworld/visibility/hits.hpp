// What is known of each hit besides its instance and depth: where it comes from, its barycentric weights
// and its face's normal. Included once per instruction set.

static inline int64_t row_of(const Frame& frame, const Tile& tile, int32_t row) {
  return static_cast<int64_t>(tile.top + row) * frame.width + tile.left;
}

// Between two rounds the hits hold the sources as they are, with those of holdouts and open pixels.
static void store_sources(const Frame& frame, const Tile& tile, const Sources& sources, const LwHits& hits) {
  for (int32_t r = 0; r < tile.rows; ++r) {
    const int64_t at = row_of(frame, tile, r);
    for (int32_t c = 0; c < tile.columns; ++c) {
      const int64_t source = sources.at[r * kStride + c];
      hits.placement[at + c] = static_cast<int32_t>(source >> 32);
      hits.triangle[at + c] = static_cast<int32_t>(source);
    }
  }
}

static void load_sources(const Frame& frame, const Tile& tile, const LwHits& hits, Sources& sources) {
  for (int32_t r = 0; r < tile.rows; ++r) {
    const int64_t at = row_of(frame, tile, r);
    for (int32_t c = 0; c < tile.columns; ++c) {
      sources.at[r * kStride + c] = source_of(static_cast<uint32_t>(hits.placement[at + c]),
                                              static_cast<uint32_t>(hits.triangle[at + c]));
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

// The normal along a run, turned towards the camera by each pixel's own ray. How many were turned.
static int64_t write_normals(const Frame& frame, const Tile& tile, const double n[3], const Candidate& run,
                             float* out) {
  const double* ray_x = frame.ray_x.data() + tile.left;
  const double ry = frame.orthographic ? 0.0 : frame.ray_y.data()[tile.top + run.y0];
  const double rest = n[1] * ry + n[2], nx = frame.orthographic ? 0.0 : n[0];
  int64_t flipped = 0;
  for (int32_t c = run.x0; c <= run.x1; ++c) {
    const bool away = nx * ray_x[c] + rest > 0;
    flipped += away;
    for (int k = 0; k < 3; ++k) out[3 * c + k] = static_cast<float>((away ? -n[k] : n[k]) + 0.0);
  }
  return flipped;
}

// The first `used` of kLanes runs, each of one row and one triangle. How many normals were turned.
static int64_t write_runs(const Frame& frame, const Tile& tile, const Candidate* runs, int used,
                          const LwHits& hits) {
  const Several of = hits.barycentric == nullptr ? gather(frame, runs, used) : set_up(frame, runs, used);
  const Corners& t = of.t;
  const Vd ux = t.x[1] - t.x[0], uy = t.y[1] - t.y[0], uz = t.z[1] - t.z[0];
  const Vd wx = t.x[2] - t.x[0], wy = t.y[2] - t.y[0], wz = t.z[2] - t.z[0];
  // The product of two moved edges is the moved normal times the determinant: so is its sign.
  const Vd nx = uy * wz - uz * wy, ny = uz * wx - ux * wz, nz = ux * wy - uy * wx;
  const Vd squared = (nx * nx + ny * ny) + nz * nz;
  int64_t flipped = 0;
  for (int lane = 0; lane < used; ++lane) {
    const Candidate& run = runs[lane];
    const int64_t at = row_of(frame, tile, run.y0);
    if (hits.barycentric != nullptr) {
      write_weights(frame, tile, of, lane, run, hits.barycentric + 2 * at);
    }
    if (hits.normal == nullptr) continue;
    const double length = std::sqrt(squared[lane]);
    const double scale = volume_of(of.matrix[lane]) < 0 ? -length : length;
    const double n[3] = {nx[lane] / scale, ny[lane] / scale, nz[lane] / scale};
    flipped += write_normals(frame, tile, n, run, hits.normal + 3 * at);
  }
  return flipped;
}

static inline void write_missing(int64_t pixel, const LwHits& hits) {
  for (int k = 0; k < 2 && hits.barycentric != nullptr; ++k) hits.barycentric[2 * pixel + k] = NAN;
  for (int k = 0; k < 3 && hits.normal != nullptr; ++k) hits.normal[3 * pixel + k] = NAN;
}

// One row's sources, without those of holdouts and open pixels.
static inline void finish_sources(const Tile& tile, const Sources& sources, int32_t row, int64_t* shown) {
  const int32_t* ids = tile.id + row * kStride;
  for (int32_t c = 0; c < kTile; ++c) {
    shown[c] = ids[c] >= 0 && ids[c] != INT32_MAX ? sources.at[row * kStride + c] : -1;
  }
}

// A finished tile. How many normals were turned towards the camera.
static int64_t write_hits(const Frame& frame, const Tile& tile, const Sources& sources, const LwHits& hits) {
  const bool more = hits.barycentric != nullptr || hits.normal != nullptr;
  Candidate few[kLanes];
  int waiting = 0;
  int64_t flipped = 0;
  for (int32_t r = 0; r < tile.rows; ++r) {
    const int64_t at = row_of(frame, tile, r);
    int64_t shown[kTile];
    finish_sources(tile, sources, r, shown);
    for (int32_t c = 0; c < tile.columns; ++c) {
      hits.placement[at + c] = static_cast<int32_t>(shown[c] >> 32);
      hits.triangle[at + c] = static_cast<int32_t>(shown[c]);
    }
    for (int32_t c = 0, first; more && c < tile.columns;) {
      for (first = c++; c < tile.columns && shown[c] == shown[first];) ++c;
      if (shown[first] < 0) {
        for (; first < c; ++first) write_missing(at + first, hits);
        continue;
      }
      few[waiting++] = Candidate{0, static_cast<uint32_t>(shown[first]), static_cast<uint32_t>(shown[first] >> 32),
                                 static_cast<uint8_t>(first), static_cast<uint8_t>(c - 1),
                                 static_cast<uint8_t>(r), static_cast<uint8_t>(r)};
      if (waiting == kLanes) {
        flipped += write_runs(frame, tile, few, waiting, hits);
        waiting = 0;
      }
    }
  }
  if (waiting > 0) flipped += write_runs(frame, tile, few, waiting, hits);
  return flipped;
}
