// First pass, continued: larger triangles go to the tiles they may cover. Included once per
// instruction set.

struct Lone {  // one triangle, in every lane
  Corners t;
  Edges e;
};

static inline Lone lone_triangle(const Frame& frame, const Shape& shape, const double* cam_from_mesh,
                                 uint32_t triangle) {
  Vd m[12];
  spread_matrix(cam_from_mesh, m);
  const float* vertices[kLanes];
  const int32_t* from[kLanes];
  for (int lane = 0; lane < kLanes; ++lane) {
    vertices[lane] = shape.vertices;
    from[lane] = shape.triangles + 3 * static_cast<int64_t>(triangle);
  }
  Lone out;
  out.t = gather_corners(m, vertices, from);
  out.e = make_edges(out.t, frame.orthographic, frame.reach);
  return out;
}

// Whether some ray of the rectangle may hit. Exact for the computed edge values: each is monotone in
// the ray's column and row, so its extreme over the rectangle is its value at a corner.
static inline bool may_hit(const double a[3], const double b[3], const double c[3], double x_low,
                           double x_high, double y_low, double y_high) {
  bool hit = true;
  for (int k = 0; k < 3; ++k) {
    const double x = a[k] >= 0 ? x_high : x_low;
    const double y = b[k] >= 0 ? y_high : y_low;
    hit &= a[k] * x + (b[k] * y + c[k]) >= 0;
  }
  return hit;
}

static inline void push(const Placed& p, int32_t tx, int32_t ty, const Extent& box, Candidate candidate) {
  const int32_t left = tx * kTile, top = ty * kTile;
  candidate.x0 = static_cast<uint8_t>((box.x0 > left ? box.x0 : left) - left);
  candidate.x1 = static_cast<uint8_t>((box.x1 < left + kTile - 1 ? box.x1 : left + kTile - 1) - left);
  candidate.y0 = static_cast<uint8_t>((box.y0 > top ? box.y0 : top) - top);
  candidate.y1 = static_cast<uint8_t>((box.y1 < top + kTile - 1 ? box.y1 : top + kTile - 1) - top);
  p.worker.bins.data()[ty * p.frame.tiles_x + tx].candidates.push(p.worker.arena, candidate);
}

// To the tiles of the box that the triangle's edges do not rule out.
static void bin_by_edges(const Placed& p, const Extent& box, const Candidate& candidate, const Edges& e) {
  if (e.flat[0] != 0) return;
  const double *rx = p.frame.ray_x.data(), *ry = p.frame.ray_y.data();
  const bool unsure = e.unsure[0] != 0;
  const double sign = e.side[0] < 0 ? -1.0 : 1.0;
  double a[3], b[3], c[3];
  for (int k = 0; k < 3; ++k) {
    a[k] = sign * e.a[k][0];
    b[k] = sign * e.b[k][0];
    c[k] = sign * e.c[k][0];
  }
  for (int32_t ty = box.y0 / kTile; ty <= box.y1 / kTile; ++ty) {
    const int32_t y0 = std::max(box.y0, ty * kTile), y1 = std::min(box.y1, ty * kTile + kTile - 1);
    for (int32_t tx = box.x0 / kTile; tx <= box.x1 / kTile; ++tx) {
      const int32_t x0 = std::max(box.x0, tx * kTile), x1 = std::min(box.x1, tx * kTile + kTile - 1);
      if (unsure || may_hit(a, b, c, rx[x0], rx[x1], ry[y0], ry[y1])) push(p, tx, ty, box, candidate);
    }
  }
}

// The box lies inside the picture.
static inline void bin_box(const Placed& p, const Extent& box, const Candidate& candidate) {
  constexpr uint32_t kSmall = 4;  // tiles that are not worth a look at the edges
  const uint32_t tx0 = static_cast<uint32_t>(box.x0) / kTile, tx1 = static_cast<uint32_t>(box.x1) / kTile;
  const uint32_t ty0 = static_cast<uint32_t>(box.y0) / kTile, ty1 = static_cast<uint32_t>(box.y1) / kTile;
  if (tx0 == tx1 && ty0 == ty1) {
    push(p, static_cast<int32_t>(tx0), static_cast<int32_t>(ty0), box, candidate);
  } else if ((tx1 - tx0 + 1) * (ty1 - ty0 + 1) > kSmall) {
    bin_by_edges(p, box, candidate,
                 lone_triangle(p.frame, p.shape, p.cam_from_mesh, candidate.triangle).e);
  } else {
    for (uint32_t ty = ty0; ty <= ty1; ++ty) {
      for (uint32_t tx = tx0; tx <= tx1; ++tx) {
        push(p, static_cast<int32_t>(tx), static_cast<int32_t>(ty), box, candidate);
      }
    }
  }
}

// Pixels a triangle may cover when some corner lies nearer than z_near or beyond z_far: the part in
// front of the near plane is projected. The plane clips these bounds only, never the triangle.
static Extent long_way(const Frame& frame, const double x[3], const double y[3], const double z[3]) {
  const LwView& view = frame.view;
  const double front = frame.orthographic ? view.z_near : view.z_near * (1 - 1e-9);
  double u0 = INFINITY, u1 = -INFINITY, v0 = INFINITY, v1 = -INFINITY, largest = 0;
  const auto add = [&](double px, double py, double pz) {
    const double inverse = frame.orthographic ? 1.0 : 1.0 / pz;
    const double u = view.fx * (px * inverse) + view.cx - 0.5;
    const double v = view.fy * (py * inverse) + view.cy - 0.5;
    u0 = u < u0 ? u : u0;
    u1 = u > u1 ? u : u1;
    v0 = v < v0 ? v : v0;
    v1 = v > v1 ? v : v1;
  };
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3;
    largest = std::fmax(largest, std::fabs(x[i]) + std::fabs(y[i]) + std::fabs(z[i]));
    if (frame.orthographic || z[i] >= front) add(x[i], y[i], z[i]);
    if (!frame.orthographic && (z[i] < front) != (z[j] < front)) {
      const double t = (front - z[i]) / (z[j] - z[i]);
      add(x[i] + t * (x[j] - x[i]), y[i] + t * (y[j] - y[i]), front);
    }
  }
  const double depth = frame.orthographic ? 1.0 : front;
  const double margin = 0.01 + 1e-14 * largest / depth * std::fmax(view.fx, view.fy);
  const double limit_x = frame.width - 1, limit_y = frame.height - 1;
  Extent out;
  out.x0 = static_cast<int32_t>(std::ceil(std::fmin(std::fmax(u0 - margin, 0), limit_x + 1)));
  out.x1 = static_cast<int32_t>(std::floor(std::fmax(std::fmin(u1 + margin, limit_x), -1)));
  out.y0 = static_cast<int32_t>(std::ceil(std::fmin(std::fmax(v0 - margin, 0), limit_y + 1)));
  out.y1 = static_cast<int32_t>(std::floor(std::fmax(std::fmin(v1 + margin, limit_y), -1)));
  return out;
}

static void bin_out_of_range(const Placed& p, uint32_t triangle) {
  const LwView& view = p.frame.view;
  const Lone lone = lone_triangle(p.frame, p.shape, p.cam_from_mesh, triangle);
  if (lone.e.flat[0] != 0) return;
  double x[3], y[3], z[3];
  for (int k = 0; k < 3; ++k) {
    x[k] = lone.t.x[k][0];
    y[k] = lone.t.y[k][0];
    z[k] = lone.t.z[k][0];
  }
  const double nearest = std::fmin(std::fmin(z[0], z[1]), z[2]);
  const double farthest = std::fmax(std::fmax(z[0], z[1]), z[2]);
  if (farthest < view.z_near || nearest > view.z_far) return;
  const Extent box = long_way(p.frame, x, y, z);
  if (box.x0 > box.x1 || box.y0 > box.y1) return;
  Candidate candidate{};
  candidate.nearest = static_cast<float>(std::fmax(nearest, view.z_near) * view.depth_scale);
  candidate.triangle = triangle;
  candidate.placement = p.placement;
  bin_by_edges(p, box, candidate, lone.e);
}

// Whether earlier rounds hide all of a triangle; its tiles answer for one too large to be asked here.
static inline bool is_behind(const SoFar& so_far, const Bounds& box, float nearest) {
  const int32_t columns = box.x1 - box.x0, rows = box.y1 - box.y0;
  if (columns < 4 && rows < 4) return so_far.hides_pixels(box, nearest);
  return columns < kTile && rows < kTile &&
         so_far.hides(Extent{box.x0, box.x1, box.y0, box.y1}, nearest);
}

static inline void take_triangle(const Placed& p, const Vd m[12], Few& few, uint32_t triangle,
                                 uint64_t packed) {
  const Bounds box(packed);
  if (box.x0 < 0) {
    const int32_t* index = p.shape.triangles + 3 * static_cast<int64_t>(triangle);
    const float *d = p.depths, low = static_cast<float>(p.frame.view.z_near * p.frame.view.depth_scale);
    if (d[index[0]] < low && d[index[1]] < low && d[index[2]] < low) return;
    bin_out_of_range(p, triangle);
    return;
  }
  const auto nearest = [&] {
    const int32_t* index = p.shape.triangles + 3 * static_cast<int64_t>(triangle);
    const float d0 = p.depths[index[0]], d1 = p.depths[index[1]], d2 = p.depths[index[2]];
    const float lower = d0 < d1 ? d0 : d1;
    return lower < d2 ? lower : d2;
  };
  if (p.so_far.depth != nullptr && is_behind(p.so_far, box, nearest())) {
    ++p.worker.left_out;
    return;
  }
  const bool cut = p.cutout != nullptr && p.cutout[triangle] >= 0;
  if (box.x1 - box.x0 < 2 && box.y1 - box.y0 < 2 && !cut) {
    few.triangle[few.count] = triangle;
    few.bounds[few.count] = packed;
    if (++few.count == Few::kSize) sample_few(p, m, few);
    return;
  }
  Candidate candidate{};
  candidate.nearest = nearest();
  candidate.triangle = triangle;
  candidate.placement = p.placement;
  bin_box(p, Extent{box.x0, box.x1, box.y0, box.y1}, candidate);
}

// Triangles [begin, end) of a placement whose vertices are bounded.
static void cull_triangles(const Placed& p, int64_t begin, int64_t end) {
  Vd m[12];
  spread_matrix(p.cam_from_mesh, m);
  Few few;
  const uint64_t* bounds = p.bounds;
  for (int64_t i = begin; i < end; i += kLanes) {
    const int32_t* index = p.shape.triangles + 3 * i;
    const int64_t last = 3 * (end - 1 - i);
    Vh low;
    for (int k = 0; k < 3; ++k) {
#define LW_BOUNDS(L) bounds[index[(3 * L < last ? 3 * L : last) + k]]
      const Vu corner = {LW_EACH(LW_BOUNDS)};
#undef LW_BOUNDS
      low = k == 0 ? (Vh)corner : ((Vh)corner < low ? (Vh)corner : low);
    }
    // first - (last + 1) is negative in both directions where a pixel centre may be covered.
    const Vu spans = (Vu)(low + (Vh)((Vu)low >> 16));
    unsigned mask = bits((Vm)((spans & (spans >> 32)) << 48));
    if (end - i < kLanes) mask &= (1u << (end - i)) - 1;
    for (; mask != 0; mask &= mask - 1) {
      const int lane = __builtin_ctz(mask);
      take_triangle(p, m, few, static_cast<uint32_t>(i + lane), ((Vu)low)[lane]);
    }
  }
  sample_few(p, m, few);
}
