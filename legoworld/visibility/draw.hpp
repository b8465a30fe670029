// Second pass: a tile's triangles, a few at a time. Spans of a row are drawn along it, the short spans of
// tall triangles together. Included once per instruction set.

struct Drawing {
  const Frame& frame;
  Tile& tile;
  Origins* origins;  // of the tile, or null
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

// Depths at some rays as they will be stored; NaN for a miss, which is not nearer, nor as near, as
// anything. kAsk: z_near, z_far or an alpha decide as well.
template <bool kAsk>
static inline Vf sample(const Frame& frame, const Single& s, Vd rx, Vd r0, Vd r1, Vd r2) {
  const LwView& view = frame.view;
  const Vd e0 = s.a[0] * rx + r0, e1 = s.a[1] * rx + r1, e2 = s.a[2] * rx + r2;
  const Vd sum = (e0 + e1) + e2;
  Vm hit = (e0 >= 0) & (e1 >= 0) & (e2 >= 0) & (sum > s.tiny);
  const Vd z = sample_z(e0, e1, e2, sum, spread(s.z[0]), spread(s.z[1]), spread(s.z[2]),
                        spread(s.low), spread(s.high));
  if (kAsk) {
    hit &= (z >= view.z_near) & (z <= view.z_far);
    if (s.cut >= 0) hit = mask_of(keep_opaque(frame, s, bits(hit), e0, e1, e2));
  }
  return narrow((Vd)((Vm)(z * view.depth_scale + 0.0) | ~hit));
}

struct Kept {  // of what a pixel holds and what is offered: the nearer, of equal ones the lower id
  Vf depth;
  Vi id, changed;
};

static inline Kept keep(Vf old_depth, Vi old_id, Vf depth, Vi id) {
  const Vi wins = (depth < old_depth) | ((depth == old_depth) & (id < old_id));
  return {depth < old_depth ? depth : old_depth, old_id ^ ((old_id ^ id) & wins), wins};
}

static inline bool any(Vi mask) { return bits(__builtin_convertvector(mask, Vm)) != 0; }

// Which of them are an offered origin's: those that it wins, and of equal depths of one instance those of a
// higher source.
static inline Vi origins_of(const Origins& all, Vi old, const Kept& kept, Vf old_depth, Vi old_id, Vf depth,
                            Vi id, int32_t origin) {
  Vi wins = kept.changed;
  const Vi tied = (depth == old_depth) & (old_id == id);
  for (int lane = 0; any(tied) && lane < kLanes; ++lane) {
    if (tied[lane] != 0 && all.source(origin) < all.source(old[lane])) wins[lane] = -1;
  }
  return old ^ ((old ^ (origin - Vi{})) & wins);
}

// Draws columns x0..x1 of row y. Lanes where it stored something. kSource: sources are stored too.
template <bool kAsk, bool kSource>
static inline Vi draw_row(const Drawing& d, const Single& s, Vi id, int y, int x0, int x1) {
  const double* ray_x = d.frame.ray_x.data() + d.tile.left;
  const Vd ry = spread(d.frame.ray_y.data()[d.tile.top + y]);
  const Vd r0 = s.b[0] * ry + s.c[0], r1 = s.b[1] * ry + s.c[1], r2 = s.b[2] * ry + s.c[2];
  float* row_depth = d.tile.depth + y * kStride;
  int32_t* row_id = d.tile.id + y * kStride;
  Vi changed = Vi{};
  int x = x0;
  do {
    const Vf depth = sample<kAsk>(d.frame, s, load<Vd>(ray_x + x), r0, r1, r2);
    const Vf old_depth = load<Vf>(row_depth + x);
    const Vi old_id = load<Vi>(row_id + x);
    const Kept kept = keep(old_depth, old_id, depth, id);
    if (kSource) {
      int32_t* at = d.origins->at + y * kStride + x;
      store(at, origins_of(*d.origins, load<Vi>(at), kept, old_depth, old_id, depth, id, s.origin));
    }
    store(row_depth + x, kept.depth);
    store(row_id + x, kept.id);
    changed |= kept.changed;
    x += kLanes;
  } while (x <= x1);
  return changed;
}

// One row of blocks.
template <bool kAsk, bool kSource>
static inline void draw_rows(const Drawing& d, const Single& s, const Spans& spans, int by, unsigned rows) {
  int left = kTile, right = 0;
  for (unsigned todo = rows; todo != 0; todo &= todo - 1) {
    const int row = __builtin_ctz(todo);
    left = spans.first[row] < left ? spans.first[row] : left;
    right = spans.last[row] > right ? spans.last[row] : right;
  }
  // Without the blocks at the ends where everything stored is nearer.
  int first = left / kBlock, last = right / kBlock;
  while (first <= last && s.nearest > d.tile.farthest_of(by * kBlocks + first)) ++first;
  while (first < last && s.nearest > d.tile.farthest_of(by * kBlocks + last)) --last;
  if (first > last) return;
  left = first * kBlock;
  right = last * kBlock + kBlock - 1;
  const Vi id = s.id - Vi{};
  Vi changed = Vi{};
  for (; rows != 0; rows &= rows - 1) {
    const int row = __builtin_ctz(rows);
    const int x0 = spans.first[row], x1 = spans.last[row];
    changed |= draw_row<kAsk, kSource>(d, s, id, by * kBlock + row, x0 > left ? x0 : left,
                                       x1 < right ? x1 : right);
  }
  if (any(changed)) d.tile.stale |= ((uint64_t{2} << last) - (uint64_t{1} << first)) << by * kBlocks;
}

// Pixels of short spans, drawn kLanes at a time wherever they lie.
struct Pixels {
  static constexpr int kTall = 8;  // rows of a triangle from which on this pays
  static constexpr int kFew = 4;   // columns of a span that is taken up here
  int count = 0;
  uint64_t blocks = 0;                   // some that they lie in, bit by bit
  uint16_t at[kTile * kFew + kPadding];  // 256 * row + column

  void add(int y, int x0, int x1) {
    typedef uint16_t Few __attribute__((vector_size(2 * kFew)));
    store(at + count, Few{0, 1, 2, 3} + static_cast<uint16_t>(y << 8 | x0));
    count += x1 - x0 + 1;
  }
};

template <bool kAsk, bool kSource>
static inline void draw_pixels(const Drawing& d, const Single& s, Pixels& pixels) {
  const double* ray_x = d.frame.ray_x.data() + d.tile.left;
  const double* ray_y = d.frame.ray_y.data() + d.tile.top;
  const Vi id = s.id - Vi{};
  for (int i = 0; i < kLanes; ++i) pixels.at[pixels.count + i] = pixels.at[pixels.count - 1];
  Vi changed = Vi{};
  for (int i = 0; i < pixels.count; i += kLanes) {
    int x[kLanes], y[kLanes], at[kLanes];
    for (int lane = 0; lane < kLanes; ++lane) {
      x[lane] = pixels.at[i + lane] & 255;
      y[lane] = pixels.at[i + lane] >> 8;
      at[lane] = y[lane] * kStride + x[lane];
    }
#define LW_X(L) ray_x[x[L]]
#define LW_Y(L) ray_y[y[L]]
#define LW_DEPTH(L) d.tile.depth[at[L]]
#define LW_ID(L) d.tile.id[at[L]]
    const Vd rx = {LW_EACH(LW_X)}, ry = {LW_EACH(LW_Y)};
    const Vf depth = sample<kAsk>(d.frame, s, rx, s.b[0] * ry + s.c[0], s.b[1] * ry + s.c[1],
                                  s.b[2] * ry + s.c[2]);
    const Vf old_depth = {LW_EACH(LW_DEPTH)};
    const Vi old_id = {LW_EACH(LW_ID)};
#undef LW_X
#undef LW_Y
#undef LW_DEPTH
#undef LW_ID
    const Kept kept = keep(old_depth, old_id, depth, id);
    if (kSource) {
#define LW_ORIGIN(L) d.origins->at[at[L]]
      const Vi old = {LW_EACH(LW_ORIGIN)};
#undef LW_ORIGIN
      const Vi now = origins_of(*d.origins, old, kept, old_depth, old_id, depth, id, s.origin);
      for (int lane = 0; lane < kLanes; ++lane) d.origins->at[at[lane]] = now[lane];
    }
    for (int lane = 0; lane < kLanes; ++lane) {
      d.tile.depth[at[lane]] = kept.depth[lane];
      d.tile.id[at[lane]] = kept.id[lane];
    }
    changed |= kept.changed;
  }
  if (any(changed)) d.tile.stale |= pixels.blocks;
}

template <bool kAsk, bool kSource>
static void draw(const Drawing& d, const Single& s, const Sides& sides, int lane, const Candidate& box) {
  Spans spans;
  Pixels pixels;
  const bool tall = box.y1 - box.y0 >= Pixels::kTall;
  for (int by = box.y0 / kBlock; by <= box.y1 / kBlock; ++by) {
    unsigned rows = find_spans(sides, lane, box, by, spans);
    if (rows == 0) continue;
    const RowMask more = load<RowMask>(spans.last) - load<RowMask>(spans.first) >= Pixels::kFew;
    if (!tall || (row_bits(more) & rows) != 0) {
      draw_rows<kAsk, kSource>(d, s, spans, by, rows);
      continue;
    }
    int row = __builtin_ctz(rows);
    const uint64_t first = uint64_t{1} << spans.first[row] / kBlock;
    for (; rows != 0; rows &= rows - 1) {
      row = __builtin_ctz(rows);
      pixels.add(by * kBlock + row, spans.first[row], spans.last[row]);
    }
    pixels.blocks |= (first | uint64_t{1} << spans.last[row] / kBlock) << by * kBlocks;
  }
  if (pixels.count > 0) draw_pixels<kAsk, kSource>(d, s, pixels);
}

static inline Single single_of(const LwSurfaces& all, const Several& of, double sign, int lane,
                               const Candidate& box) {
  Single s;
  for (int k = 0; k < 3; ++k) {
    s.a[k] = sign * of.e.a[k][lane];
    s.b[k] = sign * of.e.b[k][lane];
    s.c[k] = sign * of.e.c[k][lane];
    s.z[k] = of.t.z[k][lane];
  }
  s.tiny = of.e.tiny[lane];
  s.low = of.low[lane];
  s.high = of.high[lane];
  s.id = all.placement_id[box.placement];
  s.nearest = box.nearest;
  const bool cut = all.triangle_cutout != nullptr && all.triangle_cutout[of.triangle[lane]] >= 0;
  s.cut = cut ? of.triangle[lane] : -1;
  return s;
}

// The first `used` of kLanes candidates, from one side or, where that is unsure, from both.
template <bool kSource>
static void draw_lanes(const Drawing& d, const Candidate* boxes, int used) {
  const LwView& view = d.frame.view;
  const Several of = set_up(d.frame, boxes, used);
  const int32_t origin = kSource ? d.origins->add(d.frame, d.tile, of, boxes, used) : 0;
  Vd sign = of.e.side < 0 ? spread(-1.0) : spread(1.0);
  unsigned lanes = ~bits(of.e.flat) & ((1u << used) - 1);
  for (int turn = 0; turn < 2 && lanes != 0; ++turn) {
    const Sides sides = find_sides(d.frame, of.e, sign, d.tile.left, d.tile.top);
    for (unsigned todo = lanes; todo != 0; todo &= todo - 1) {
      const int lane = __builtin_ctz(todo);
      Single s = single_of(d.frame.surfaces, of, sign[lane], lane, boxes[lane]);
      s.origin = origin + lane;
      if (s.cut >= 0 && turned_away(d.frame.surfaces, s.cut, of.matrix[lane], sign[lane])) continue;
      if (s.cut >= 0 || s.low < view.z_near || s.high > view.z_far) {
        draw<true, kSource>(d, s, sides, lane, boxes[lane]);
      } else {
        draw<false, kSource>(d, s, sides, lane, boxes[lane]);
      }
    }
    lanes &= bits(of.e.unsure);
    sign = -sign;
  }
}

// In the order they come, without those that lie behind what is stored.
template <bool kSource>
static void draw_candidates(const Drawing& d, const Candidate* candidates, int64_t count) {
  Candidate few[kLanes];
  int waiting = 0;
  for (int64_t i = 0; i < count; ++i) {
    if (d.tile.hides(candidates[i])) continue;
    few[waiting++] = candidates[i];
    if (waiting == kLanes) {
      draw_lanes<kSource>(d, few, waiting);
      waiting = 0;
    }
  }
  if (waiting > 0) draw_lanes<kSource>(d, few, waiting);
}
