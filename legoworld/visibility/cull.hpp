// First pass: bounds of vertices, rejection of triangles between pixel centres, and the samples of
// those that touch at most 2 x 2 of them. Included once per instruction set.

constexpr double kMargin = 1e-6;  // pixels; far above the rounding of a projection inside the picture

// Pixel bounds (see Bounds) and depth of each vertex. Both outputs may be written kLanes past the end.
static void bound_vertices(const Frame& frame, const double* cam_from_mesh, const float* vertices,
                           int64_t count, uint64_t* bounds, float* depths) {
  const LwView& view = frame.view;
  Vd m[12];
  spread_matrix(cam_from_mesh, m);
  const Vd width = spread(frame.width), height = spread(frame.height), zero = Vd{};
  for (int64_t i = 0; i < count; i += kLanes) {
#define LW_AT(L) (vertices + 3 * (i + L < count ? i + L : count - 1))
    const float* const at[kLanes] = {LW_EACH(LW_AT)};
#undef LW_AT
#define LW_X(L) at[L][0]
#define LW_Y(L) at[L][1]
#define LW_Z(L) at[L][2]
    const Vf vx = {LW_EACH(LW_X)}, vy = {LW_EACH(LW_Y)}, vz = {LW_EACH(LW_Z)};
#undef LW_X
#undef LW_Y
#undef LW_Z
    Vd x, y, z;
    to_camera(m, widen(vx), widen(vy), widen(vz), x, y, z);
    const Vd inverse = frame.orthographic ? spread(1.0) : 1.0 / z;
    const Vd u = view.fx * (x * inverse) + (view.cx - 0.5);
    const Vd v = view.fy * (y * inverse) + (view.cy - 0.5);
    // Non-negative after clamping, so truncation is floor; floor(t - margin) + 1 stands for ceil.
    const Vi x0 = __builtin_convertvector(smaller(larger(u + (1 - kMargin), zero), width), Vi);
    const Vi x1 = __builtin_convertvector(smaller(larger(u + (1 + kMargin), zero), width), Vi);
    const Vi y0 = __builtin_convertvector(smaller(larger(v + (1 - kMargin), zero), height), Vi);
    const Vi y1 = __builtin_convertvector(smaller(larger(v + (1 + kMargin), zero), height), Vi);
    const Vu columns = (Vu)__builtin_convertvector((x0 & 0xffff) | (-x1 << 16), Vm);
    const Vu rows = (Vu)__builtin_convertvector((y0 & 0xffff) | (-y1 << 16), Vm);
    const Vu packed = (columns & 0xffffffffu) | (rows << 32);
    const Vm outside = (z < view.z_near) | (z > view.z_far);
    store(bounds + i, (Vu)(outside ? (Vm)(kOutOfRange - Vu{}) : (Vm)packed));
    store(depths + i, narrow(z * view.depth_scale));
  }
}

struct Placed {  // a placement being culled
  const Frame& frame;
  Worker& worker;
  const Shape& shape;
  const double* cam_from_mesh;
  const uint64_t* bounds;
  const float* depths;
  const int32_t* cutout;  // of the mesh's first triangle, or null
  const SoFar& so_far;
  uint32_t placement;
  int32_t id;
  bool sources;  // whether samples keep where they come from
};

struct Few {  // triangles waiting for a full set of lanes
  static constexpr int kSize = 8;
  int count = 0;
  uint32_t triangle[kSize];
  uint64_t bounds[kSize];
};

static inline void put_sample(const Placed& p, int32_t column, int32_t row, float depth,
                              uint32_t triangle) {
  const int64_t tile = (row / kTile) * p.frame.tiles_x + column / kTile;
  const auto pixel = static_cast<uint32_t>(row % kTile * kStride + column % kTile);
  TileBins& bins = p.worker.bins.data()[tile];
  bins.samples.push(p.worker.arena, Sample{depth, p.id, pixel});
  if (p.sources) bins.sources.push(p.worker.arena, source_of(p.placement, triangle));
}

// Samples of kLanes triangles, of which the first `used` count, at their 2 x 2 pixel centres.
static inline void sample_lanes(const Placed& p, const Vd m[12], const uint32_t* triangle,
                                const uint64_t* bounds, int used) {
  const Frame& frame = p.frame;
  const float* vertices[kLanes];
  const int32_t* from[kLanes];
  int32_t x0[kLanes], y0[kLanes];
  bool wide[2] = {true, false}, tall[2] = {true, false};
  for (int lane = 0; lane < kLanes; ++lane) {
    const int safe = lane < used ? lane : 0;
    const Bounds box(bounds[safe]);
    vertices[lane] = p.shape.vertices;
    from[lane] = p.shape.triangles + 3 * static_cast<int64_t>(triangle[safe]);
    x0[lane] = box.x0;
    y0[lane] = box.y0;
    wide[1] |= box.x1 > box.x0;
    tall[1] |= box.y1 > box.y0;
  }
  const Corners t = gather_corners(m, vertices, from);
  const Edges e = make_edges(t, frame.orthographic, frame.reach);
  const Vd low = smaller(smaller(t.z[0], t.z[1]), t.z[2]);
  const Vd high = larger(larger(t.z[0], t.z[1]), t.z[2]);
  const unsigned lanes = (1u << used) - 1;
  for (int down = 0; down < 2; ++down) {
    if (!tall[down]) continue;
#define LW_RAY(L) frame.ray_y.data()[y0[L] + down]
    const Vd ry = {LW_EACH(LW_RAY)};
#undef LW_RAY
    const Vd r0 = e.b[0] * ry + e.c[0], r1 = e.b[1] * ry + e.c[1], r2 = e.b[2] * ry + e.c[2];
    for (int right = 0; right < 2; ++right) {
      if (!wide[right]) continue;
#define LW_RAY(L) frame.ray_x.data()[x0[L] + right]
      const Vd rx = {LW_EACH(LW_RAY)};
#undef LW_RAY
      const Vd e0 = e.a[0] * rx + r0, e1 = e.a[1] * rx + r1, e2 = e.a[2] * rx + r2;
      const Vd sum = (e0 + e1) + e2;
      const Vm hit = ((e0 >= 0) & (e1 >= 0) & (e2 >= 0) & (sum > e.tiny)) |
                     ((e0 <= 0) & (e1 <= 0) & (e2 <= 0) & (sum < -e.tiny));
      unsigned mask = bits(hit) & lanes;
      if (mask == 0) continue;
      const Vd z = sample_z(e0, e1, e2, sum, t.z[0], t.z[1], t.z[2], low, high);
      const Vf depth = narrow(z * frame.view.depth_scale + 0.0);
      for (int lane = 0; mask != 0; ++lane, mask >>= 1) {
        if ((mask & 1) == 0) continue;
        const Bounds box(bounds[lane]);
        if (box.x0 + right > box.x1 || box.y0 + down > box.y1) continue;
        put_sample(p, box.x0 + right, box.y0 + down, depth[lane], triangle[lane]);
      }
    }
  }
}

static void sample_few(const Placed& p, const Vd m[12], Few& few) {
  for (int done = 0; done < few.count; done += kLanes) {
    const int left = few.count - done;
    sample_lanes(p, m, few.triangle + done, few.bounds + done, left < kLanes ? left : kLanes);
  }
  few.count = 0;
}
