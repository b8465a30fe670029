// Second pass: one tile of the picture at a time, near triangles first. Included once per
// instruction set.

struct Tile {
  float depth[kTile * kStride];
  int32_t id[kTile * kStride];
  float farthest[kBlocks * kBlocks];  // of a block's stored depths, unless it is stale
  bool stale[kBlocks * kBlocks];
  int32_t left, top, columns, rows;  // pixels; the part inside the picture

  // Places the tile in the picture, empty. What lies beyond the picture is nearer than anything.
  void begin(const Frame& frame, int64_t index) {
    left = static_cast<int32_t>(index % frame.tiles_x) * kTile;
    top = static_cast<int32_t>(index / frame.tiles_x) * kTile;
    columns = frame.width - left < kTile ? frame.width - left : kTile;
    rows = frame.height - top < kTile ? frame.height - top : kTile;
    for (float& d : depth) d = INFINITY;
    for (int32_t& i : id) i = INT32_MAX;
    for (bool& s : stale) s = true;
    for (int32_t r = 0; r < kTile; ++r) {
      for (int32_t c = r < rows ? columns : 0; c < kTile; ++c) depth[r * kStride + c] = -INFINITY;
    }
  }

  float farthest_of(int block) {
    if (!stale[block]) return farthest[block];
    const float* row = depth + (block / kBlocks * kStride + block % kBlocks) * kBlock;
    float most[kBlock];
    for (int c = 0; c < kBlock; ++c) most[c] = row[c];
    for (int r = 1; r < kBlock; ++r) {
      for (int c = 0; c < kBlock; ++c) {
        const float d = row[r * kStride + c];
        most[c] = most[c] > d ? most[c] : d;
      }
    }
    float out = most[0];
    for (int c = 1; c < kBlock; ++c) out = out > most[c] ? out : most[c];
    farthest[block] = out;
    stale[block] = false;
    return out;
  }
};

struct Single {  // one triangle, ready to be drawn into a tile
  double a[3], b[3], c[3];
  double tiny, z[3], low, high;
  int64_t cut;  // the triangle's global index when its alpha decides, else -1
  int32_t id;
  bool clip;    // part of it is nearer than z_near or beyond z_far
  float nearest;
};

struct Drawing {
  const Frame& frame;
  Tile& tile;
};

static unsigned keep_opaque(const Frame& frame, const Single& s, unsigned mask, Vd e0, Vd e1, Vd e2) {
  unsigned kept = mask;
  for (; mask != 0; mask &= mask - 1) {
    const int lane = __builtin_ctz(mask);
    const double e[3] = {e0[lane], e1[lane], e2[lane]};
    if (cut_away(frame.surfaces, s.cut, e)) kept &= ~(1u << lane);
  }
  return kept;
}

static inline Vm mask_of(unsigned mask) {
  Vm out;
  for (int lane = 0; lane < kLanes; ++lane) out[lane] = (mask >> lane & 1) != 0 ? -1 : 0;
  return out;
}

// Draws columns x0..x1 of rows y0..y1 (inside the tile). True when something may have been stored.
// kCovered: every ray of the rectangle is known to hit the triangle.
template <bool kCovered>
static bool draw_rows(const Drawing& d, const Single& s, int x0, int x1, int y0, int y1) {
  const LwView& view = d.frame.view;
  const double* ray_x = d.frame.ray_x.data() + d.tile.left;
  const double* ray_y = d.frame.ray_y.data() + d.tile.top;
  const Vd a0 = spread(s.a[0]), a1 = spread(s.a[1]), a2 = spread(s.a[2]), tiny = spread(s.tiny);
  const Vd z0 = spread(s.z[0]), z1 = spread(s.z[1]), z2 = spread(s.z[2]);
  const Vd low = spread(s.low), high = spread(s.high), scale = spread(view.depth_scale);
  const Vi id = s.id - Vi{};
  bool drawn = kCovered;
  for (int y = y0; y <= y1; ++y) {
    const Vd r0 = spread(s.b[0] * ray_y[y] + s.c[0]);
    const Vd r1 = spread(s.b[1] * ray_y[y] + s.c[1]);
    const Vd r2 = spread(s.b[2] * ray_y[y] + s.c[2]);
    float* row_depth = d.tile.depth + y * kStride;
    int32_t* row_id = d.tile.id + y * kStride;
    for (int x = x0; x <= x1; x += kLanes) {
      const Vd rx = load<Vd>(ray_x + x);
      const Vd e0 = a0 * rx + r0, e1 = a1 * rx + r1, e2 = a2 * rx + r2;
      const Vd sum = (e0 + e1) + e2;
      Vm hit = Vm{} - 1;
      if (!kCovered) {
        hit = (e0 >= 0) & (e1 >= 0) & (e2 >= 0) & (sum > tiny);
        if (bits(hit) == 0) continue;
        drawn = true;
      }
      const Vd z = sample_z(e0, e1, e2, sum, z0, z1, z2, low, high);
      if (!kCovered) {
        if (s.clip) hit &= (z >= view.z_near) & (z <= view.z_far);
        if (s.cut >= 0) hit = mask_of(keep_opaque(d.frame, s, bits(hit), e0, e1, e2));
      }
      const Vf depth = narrow(z * scale + 0.0);
      const Vf old_depth = load<Vf>(row_depth + x);
      const Vi old_id = load<Vi>(row_id + x);
      Vi wins = (depth < old_depth) | ((depth == old_depth) & (id < old_id));
      if (!kCovered) wins &= __builtin_convertvector(hit, Vi);
      store(row_depth + x, wins ? depth : old_depth);
      store(row_id + x, wins ? id : old_id);
    }
  }
  return drawn;
}

// Whether every ray of the rectangle hits, and no sample of the triangle needs a look of its own.
// Exact as may_hit is: rounding is monotone, so the sum is never below the sum of the least values.
static inline bool all_hit(const Single& s, double x_low, double x_high, double y_low, double y_high) {
  if (s.clip || s.cut >= 0) return false;
  double least[3];
  bool hit = true;
  for (int k = 0; k < 3; ++k) {
    const double x = s.a[k] >= 0 ? x_low : x_high;
    const double y = s.b[k] >= 0 ? y_low : y_high;
    least[k] = s.a[k] * x + (s.b[k] * y + s.c[k]);
    hit &= least[k] >= 0;
  }
  return hit && (least[0] + least[1]) + least[2] > s.tiny;
}

// Narrows columns x0..x1 to those where rows y0..y1 may be hit. An edge value a * rx + r is negative
// left (or right) of -r / a, whose own rounding is far less than the one column kept on either side.
static inline void narrow_columns(const Drawing& d, const Single& s, int y0, int y1, int& x0, int& x1) {
  const LwView& view = d.frame.view;
  const double* ry = d.frame.ray_y.data() + d.tile.top;
  const double shift = view.cx - 0.5 - d.tile.left;
  double low = x0, high = x1;
  for (int k = 0; k < 3; ++k) {
    const double r = s.b[k] * ry[s.b[k] >= 0 ? y1 : y0] + s.c[k];
    const double column = -r / s.a[k] * view.fx + shift;
    if (s.a[k] > 0 && column - 1 > low) low = column - 1;
    if (s.a[k] < 0 && column + 1 < high) high = column + 1;
  }
  if (low > high) {
    x1 = x0 - 1;
    return;
  }
  x0 = static_cast<int>(low);
  x1 = static_cast<int>(high);
}

// Blocks of one row of blocks; neighbours that are covered are drawn in one go.
static void draw_blocks(const Drawing& d, const Single& s, int by, int x0, int x1, int y0, int y1) {
  const double *rx = d.frame.ray_x.data() + d.tile.left, *ry = d.frame.ray_y.data() + d.tile.top;
  narrow_columns(d, s, y0, y1, x0, x1);
  if (x0 > x1) return;
  if (x1 - x0 < kBlock) {
    const int first = by * kBlocks + x0 / kBlock, last = by * kBlocks + x1 / kBlock;
    if (s.nearest > d.tile.farthest_of(first) && s.nearest > d.tile.farthest_of(last)) return;
    if (draw_rows<false>(d, s, x0, x1, y0, y1)) d.tile.stale[first] = d.tile.stale[last] = true;
    return;
  }
  int run_start = 0, run_end = -1;  // columns, waiting to be drawn
  for (int bx = x0 / kBlock; bx <= x1 / kBlock; ++bx) {
    const int left = bx * kBlock, c0 = x0 > left ? x0 : left;
    const int c1 = x1 < left + kBlock - 1 ? x1 : left + kBlock - 1;
    const int block = by * kBlocks + bx;
    if (!may_hit(s.a, s.b, s.c, rx[c0], rx[c1], ry[y0], ry[y1])) continue;
    if (s.nearest > d.tile.farthest_of(block)) continue;
    // Whole vectors are written, so a covered run is made of whole blocks, tested to their ends.
    const int right = left + kBlock - 1;
    if (all_hit(s, rx[left], rx[right], ry[y0], ry[y1])) {
      if (run_end != left - 1) {
        if (run_end >= run_start) draw_rows<true>(d, s, run_start, run_end, y0, y1);
        run_start = left;
      }
      run_end = right;
      d.tile.stale[block] = true;
    } else if (draw_rows<false>(d, s, c0, c1, y0, y1)) {
      d.tile.stale[block] = true;
    }
  }
  if (run_end >= run_start) draw_rows<true>(d, s, run_start, run_end, y0, y1);
}

static void draw(const Drawing& d, const Single& s, const Candidate& box) {
  const bool narrow_box = box.x1 - box.x0 < kBlock;
  for (int by = box.y0 / kBlock; by <= box.y1 / kBlock; ++by) {
    const int top = by * kBlock, y0 = box.y0 > top ? box.y0 : top;
    const int y1 = box.y1 < top + kBlock - 1 ? box.y1 : top + kBlock - 1;
    if (!narrow_box) {
      draw_blocks(d, s, by, box.x0, box.x1, y0, y1);
    } else if (draw_rows<false>(d, s, box.x0, box.x1, y0, y1)) {
      d.tile.stale[by * kBlocks + box.x0 / kBlock] = true;
      d.tile.stale[by * kBlocks + box.x1 / kBlock] = true;
    }
  }
}

static inline bool hidden(Tile& tile, const Candidate& box) {
  for (int by = box.y0 / kBlock; by <= box.y1 / kBlock; ++by) {
    for (int bx = box.x0 / kBlock; bx <= box.x1 / kBlock; ++bx) {
      if (!(box.nearest > tile.farthest_of(by * kBlocks + bx))) return false;
    }
  }
  return true;
}

// Sets up kLanes candidates at once, then draws the first `used`.
static void draw_lanes(const Drawing& d, const Candidate* boxes, int used) {
  const LwSurfaces& all = d.frame.surfaces;
  const LwView& view = d.frame.view;
  const float* vertices[kLanes];
  const int32_t* from[kLanes];
  const double* matrix[kLanes];
  int64_t triangle[kLanes];
  for (int lane = 0; lane < kLanes; ++lane) {
    const Candidate& box = boxes[lane < used ? lane : 0];
    const int64_t mesh = all.placement_mesh[box.placement];
    triangle[lane] = all.triangle_start[mesh] + box.triangle;
    vertices[lane] = all.vertices + 3 * all.vertex_start[mesh];
    from[lane] = all.triangles + 3 * triangle[lane];
    matrix[lane] = all.cam_from_mesh + 12 * static_cast<int64_t>(box.placement);
  }
  Vd m[12];
  for (int i = 0; i < 12; ++i) {
#define LW_ENTRY(L) matrix[L][i]
    m[i] = Vd{LW_EACH(LW_ENTRY)};
#undef LW_ENTRY
  }
  const Corners t = gather_corners(m, vertices, from);
  const Edges e = make_edges(t, d.frame.orthographic, d.frame.reach);
  const Vd low = smaller(smaller(t.z[0], t.z[1]), t.z[2]);
  const Vd high = larger(larger(t.z[0], t.z[1]), t.z[2]);
  for (int lane = 0; lane < used; ++lane) {
    const Candidate& box = boxes[lane];
    Single s;
    const double sign = e.side[lane] < 0 ? -1.0 : 1.0;
    for (int k = 0; k < 3; ++k) {
      s.a[k] = sign * e.a[k][lane];
      s.b[k] = sign * e.b[k][lane];
      s.c[k] = sign * e.c[k][lane];
      s.z[k] = t.z[k][lane];
    }
    s.tiny = e.tiny[lane];
    s.low = low[lane];
    s.high = high[lane];
    s.clip = s.low < view.z_near || s.high > view.z_far;
    s.id = all.placement_id[box.placement];
    s.nearest = box.nearest;
    const bool cut = all.triangle_cutout != nullptr && all.triangle_cutout[triangle[lane]] >= 0;
    s.cut = cut ? triangle[lane] : -1;
    draw(d, s, box);
    if (e.unsure[lane] == 0) continue;
    for (int k = 0; k < 3; ++k) {
      s.a[k] = -s.a[k];
      s.b[k] = -s.b[k];
      s.c[k] = -s.c[k];
    }
    draw(d, s, box);
  }
}
