// Second pass: one tile of the picture at a time, near triangles first. Included once per
// instruction set.

constexpr int kStride = kTile + kPadding / 2;
constexpr int kBlocks = kTile / kBlock;

struct Tile {
  float depth[kTile * kStride];
  int32_t id[kTile * kStride];
  float farthest[kBlocks * kBlocks];  // of a block's stored depths, unless it is stale
  bool stale[kBlocks * kBlocks];
  int32_t left, top;

  void clear() {
    for (float& d : depth) d = INFINITY;
    for (int32_t& i : id) i = INT32_MAX;
    for (bool& s : stale) s = true;
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
static bool draw_rows(const Drawing& d, const Single& s, int x0, int x1, int y0, int y1) {
  const LwView& view = d.frame.view;
  const double* ray_x = d.frame.ray_x.data() + d.tile.left;
  const double* ray_y = d.frame.ray_y.data() + d.tile.top;
  const Vd a0 = spread(s.a[0]), a1 = spread(s.a[1]), a2 = spread(s.a[2]), tiny = spread(s.tiny);
  const Vd z0 = spread(s.z[0]), z1 = spread(s.z[1]), z2 = spread(s.z[2]);
  const Vd low = spread(s.low), high = spread(s.high), scale = spread(view.depth_scale);
  const Vi id = s.id - Vi{};
  unsigned drawn = 0;
  for (int y = y0; y <= y1; ++y) {
    const Vd r0 = spread(s.b[0] * ray_y[y] + s.c[0]);
    const Vd r1 = spread(s.b[1] * ray_y[y] + s.c[1]);
    const Vd r2 = spread(s.b[2] * ray_y[y] + s.c[2]);
    for (int x = x0; x <= x1; x += kLanes) {
      const Vd rx = load<Vd>(ray_x + x);
      const Vd e0 = a0 * rx + r0, e1 = a1 * rx + r1, e2 = a2 * rx + r2;
      const Vd sum = (e0 + e1) + e2;
      Vm hit = (e0 >= 0) & (e1 >= 0) & (e2 >= 0) & (sum > tiny);
      unsigned mask = bits(hit);
      if (mask == 0) continue;
      const Vd z = sample_z(e0, e1, e2, sum, z0, z1, z2, low, high);
      if (s.clip) hit &= (z >= view.z_near) & (z <= view.z_far);
      if (s.cut >= 0) hit = mask_of(keep_opaque(d.frame, s, bits(hit), e0, e1, e2));
      const Vf depth = narrow(z * scale + 0.0);
      float* to_depth = d.tile.depth + y * kStride + x;
      int32_t* to_id = d.tile.id + y * kStride + x;
      const Vf old_depth = load<Vf>(to_depth);
      const Vi old_id = load<Vi>(to_id);
      const Vi wins = __builtin_convertvector(hit, Vi) &
                      ((depth < old_depth) | ((depth == old_depth) & (id < old_id)));
      store(to_depth, wins ? depth : old_depth);
      store(to_id, wins ? id : old_id);
      drawn |= mask;
    }
  }
  return drawn != 0;
}

static void draw(const Drawing& d, const Single& s, const Candidate& box) {
  const double *rx = d.frame.ray_x.data() + d.tile.left, *ry = d.frame.ray_y.data() + d.tile.top;
  const bool narrow_box = box.x1 - box.x0 < kBlock;
  for (int by = box.y0 / kBlock; by <= box.y1 / kBlock; ++by) {
    const int top = by * kBlock, y0 = box.y0 > top ? box.y0 : top;
    const int y1 = box.y1 < top + kBlock - 1 ? box.y1 : top + kBlock - 1;
    if (narrow_box) {
      if (draw_rows(d, s, box.x0, box.x1, y0, y1)) {
        d.tile.stale[by * kBlocks + box.x0 / kBlock] = true;
        d.tile.stale[by * kBlocks + box.x1 / kBlock] = true;
      }
      continue;
    }
    for (int bx = box.x0 / kBlock; bx <= box.x1 / kBlock; ++bx) {
      const int left = bx * kBlock, x0 = box.x0 > left ? box.x0 : left;
      const int x1 = box.x1 < left + kBlock - 1 ? box.x1 : left + kBlock - 1;
      if (!may_hit(s.a, s.b, s.c, rx[x0], rx[x1], ry[y0], ry[y1])) continue;
      const int block = by * kBlocks + bx;
      if (s.nearest > d.tile.farthest_of(block)) continue;
      if (draw_rows(d, s, x0, x1, y0, y1)) d.tile.stale[block] = true;
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

static void write_tile(const Frame& frame, const Tile& tile, int32_t* instance, float* depth) {
  const int32_t columns = frame.width - tile.left < kTile ? frame.width - tile.left : kTile;
  const int32_t rows = frame.height - tile.top < kTile ? frame.height - tile.top : kTile;
  for (int32_t r = 0; r < rows; ++r) {
    const int64_t at = static_cast<int64_t>(tile.top + r) * frame.width + tile.left;
    const float* from_depth = tile.depth + r * kStride;
    const int32_t* from_id = tile.id + r * kStride;
    for (int32_t c = 0; c < columns; ++c) {
      const bool there = from_id[c] >= 0 && from_id[c] != INT32_MAX;
      instance[at + c] = there ? from_id[c] : kNothing;
      depth[at + c] = there ? from_depth[c] : INFINITY;
    }
  }
}
