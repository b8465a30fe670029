// Why a placement, on its own, shows nothing. Included once per instruction set.

enum Reach : uint8_t {
  kNoArea = 0, kTooNear = 1, kTooFar = 2, kOutsideView = 3, kBetweenCentres = 4, kCovers = 5
};

struct Point {
  double x, y, z;
};

// A convex polygon cut by one plane keeps at most one corner more.
struct Polygon {
  int count;
  Point corners[16];

  // Keeps where a*x + b*y + c*z + d >= 0.
  void cut(double a, double b, double c, double d) {
    double at[16];
    int inside = 0;
    for (int i = 0; i < count; ++i) {
      at[i] = ((a * corners[i].x + b * corners[i].y) + c * corners[i].z) + d;
      inside += at[i] >= 0;
    }
    if (inside == count) return;
    Polygon out{0, {}};
    for (int i = 0; i < count && inside > 0; ++i) {
      const Point &p = corners[i], &q = corners[(i + 1) % count];
      const double at_p = at[i], at_q = at[(i + 1) % count];
      if (at_p >= 0) out.corners[out.count++] = p;
      if ((at_p >= 0) != (at_q >= 0)) {
        const double t = at_p / (at_p - at_q);
        out.corners[out.count++] = {p.x + t * (q.x - p.x), p.y + t * (q.y - p.y), p.z + t * (q.z - p.z)};
      }
    }
    *this = out;
  }
};

struct Rectangle {  // the picture's, at z = 1; orthographic: in scene units
  double left, right, top, bottom, widest;

  explicit Rectangle(const Frame& frame)
      : left(-frame.view.cx / frame.view.fx), right((frame.width - frame.view.cx) / frame.view.fx),
        top(-frame.view.cy / frame.view.fy), bottom((frame.height - frame.view.cy) / frame.view.fy),
        widest(std::fmax(std::fmax(std::fabs(left), std::fabs(right)),
                         std::fmax(std::fabs(top), std::fabs(bottom)))) {}
};

// Whether the part of a triangle within near..far projects into the picture's rectangle.
static bool in_view(const Frame& frame, const Rectangle& r, const Lone& lone) {
  const LwView& view = frame.view;
  Polygon polygon{3, {}};
  for (int k = 0; k < 3; ++k) polygon.corners[k] = {lone.t.x[k][0], lone.t.y[k][0], lone.t.z[k][0]};
  polygon.cut(0, 0, 1, -view.z_near);
  polygon.cut(0, 0, -1, view.z_far);
  const double c = frame.orthographic ? 0 : 1, d = frame.orthographic ? 1 : 0;
  polygon.cut(1, 0, -r.left * c, -r.left * d);
  polygon.cut(-1, 0, r.right * c, r.right * d);
  polygon.cut(0, 1, -r.top * c, -r.top * d);
  polygon.cut(0, -1, r.bottom * c, r.bottom * d);
  return polygon.count > 0;
}

static bool has_area(const Shape& shape, int64_t triangle, const Lone& lone) {
  const int32_t* index = shape.triangles + 3 * triangle;
  double mesh[2][3], camera[2][3];
  for (int i = 0; i < 2; ++i) {
    for (int k = 0; k < 3; ++k) {
      mesh[i][k] = static_cast<double>(shape.vertices[3 * static_cast<int64_t>(index[i + 1]) + k]) -
                   shape.vertices[3 * static_cast<int64_t>(index[0]) + k];
    }
    camera[i][0] = lone.t.x[i + 1][0] - lone.t.x[0][0];
    camera[i][1] = lone.t.y[i + 1][0] - lone.t.y[0][0];
    camera[i][2] = lone.t.z[i + 1][0] - lone.t.z[0][0];
  }
  const auto spans = [](const double e[2][3]) {
    return e[0][1] * e[1][2] != e[0][2] * e[1][1] || e[0][2] * e[1][0] != e[0][0] * e[1][2] ||
           e[0][0] * e[1][1] != e[0][1] * e[1][0];
  };
  return spans(mesh) && spans(camera);
}

// Whether some pixel centre of the box has a sample, for edges whose inside has the given sign.
static bool any_sample(const Frame& frame, const Lone& lone, const Extent& box, double sign) {
  const double *rx = frame.ray_x.data(), *ry = frame.ray_y.data();
  const Edges& e = lone.e;
  double a[3], b[3], c[3], z[3];
  for (int k = 0; k < 3; ++k) {
    a[k] = sign * e.a[k][0];
    b[k] = sign * e.b[k][0];
    c[k] = sign * e.c[k][0];
    z[k] = lone.t.z[k][0];
  }
  const double low = std::fmin(std::fmin(z[0], z[1]), z[2]);
  const double high = std::fmax(std::fmax(z[0], z[1]), z[2]);
  for (int32_t top = box.y0; top <= box.y1; top += kBlock) {
    const int32_t y1 = top + kBlock - 1 < box.y1 ? top + kBlock - 1 : box.y1;
    for (int32_t left = box.x0; left <= box.x1; left += kBlock) {
      const int32_t x1 = left + kBlock - 1 < box.x1 ? left + kBlock - 1 : box.x1;
      if (!may_hit(a, b, c, rx[left], rx[x1], ry[top], ry[y1])) continue;
      for (int32_t y = top; y <= y1; ++y) {
        for (int32_t x = left; x <= x1; ++x) {
          double value[3];
          for (int k = 0; k < 3; ++k) value[k] = a[k] * rx[x] + (b[k] * ry[y] + c[k]);
          const double sum = (value[0] + value[1]) + value[2];
          if (!(value[0] >= 0 && value[1] >= 0 && value[2] >= 0 && sum > e.tiny[0])) continue;
          const double at =
              sample_z(spread(value[0]), spread(value[1]), spread(value[2]), spread(sum),
                       spread(z[0]), spread(z[1]), spread(z[2]), spread(low), spread(high))[0];
          if (at >= frame.view.z_near && at <= frame.view.z_far) return true;
        }
      }
    }
  }
  return false;
}

static uint8_t triangle_reach(const Frame& frame, const Rectangle& rectangle, const Shape& shape,
                              const double* cam_from_mesh, int64_t triangle) {
  const Lone lone = lone_triangle(frame, shape, cam_from_mesh, static_cast<uint32_t>(triangle));
  if (!has_area(shape, triangle, lone)) return kNoArea;
  double x[3], y[3], z[3];
  bool near = true, far = true;
  for (int k = 0; k < 3; ++k) {
    x[k] = lone.t.x[k][0];
    y[k] = lone.t.y[k][0];
    z[k] = lone.t.z[k][0];
    near &= z[k] < frame.view.z_near;
    far &= z[k] > frame.view.z_far;
  }
  if (near) return kTooNear;
  if (far) return kTooFar;
  const Extent box = long_way(frame, x, y, z);
  const double sign = lone.e.side[0] < 0 ? -1.0 : 1.0;
  if (any_sample(frame, lone, box, sign)) return kCovers;
  if (lone.e.unsure[0] != 0 && any_sample(frame, lone, box, -sign)) return kCovers;
  return in_view(frame, rectangle, lone) ? kBetweenCentres : kOutsideView;
}

// How far the nearest of some points lies beyond each plane of the view: near, far, four sides.
struct Beyond {
  double nearest[6] = {INFINITY, INFINITY, INFINITY, INFINITY, INFINITY, INFINITY};
  double size = 0;

  void add(const Frame& frame, const Rectangle& r, const double* m, const double point[3]) {
    double at[3];
    for (int k = 0; k < 3; ++k) {
      at[k] = m[4 * k + 3];
      double sum = std::fabs(at[k]);
      for (int j = 0; j < 3; ++j) {
        const double term = m[4 * k + j] * point[j];
        at[k] += term;
        sum += std::fabs(term);
      }
      size = sum > size ? sum : size;
    }
    const double scale = frame.orthographic ? 1.0 : at[2];
    const double beyond[6] = {frame.view.z_near - at[2],  at[2] - frame.view.z_far,
                              r.left * scale - at[0],     at[0] - r.right * scale,
                              r.top * scale - at[1],      at[1] - r.bottom * scale};
    for (int i = 0; i < 6; ++i) nearest[i] = beyond[i] < nearest[i] ? beyond[i] : nearest[i];
  }

  double margin(const Frame& frame, const Rectangle& r) const {
    return 1e-9 * (size + r.widest * (frame.orthographic ? 1.0 : size));
  }

  bool a_side(double margin) const {
    for (int i = 2; i < 6; ++i) {
      if (nearest[i] > margin) return true;
    }
    return false;
  }
};

// What no triangle of the placement can exceed, by the box of its mesh: a placement beside the view
// would otherwise be tested triangle by triangle.
static uint8_t most_reach(const Frame& frame, const Rectangle& r, int64_t placement) {
  const Box& box = frame.boxes.data()[frame.surfaces.placement_mesh[placement]];
  if (box.low[0] > box.high[0]) return kNoArea;
  const double* m = frame.surfaces.cam_from_mesh + 12 * placement;
  Beyond beyond;
  for (int corner = 0; corner < 8; ++corner) {
    const double at[3] = {(corner & 1) != 0 ? box.high[0] : box.low[0],
                          (corner & 2) != 0 ? box.high[1] : box.low[1],
                          (corner & 4) != 0 ? box.high[2] : box.low[2]};
    beyond.add(frame, r, m, at);
  }
  const double margin = beyond.margin(frame, r);
  if (beyond.nearest[0] > margin) return kTooNear;
  if (beyond.nearest[1] > margin) return kTooFar;
  return beyond.a_side(margin) ? kOutsideView : kCovers;
}

// Whether a triangle lies beside the view as a whole, told without its edges.
static bool is_beside(const Frame& frame, const Rectangle& r, const Shape& shape, const double* m,
                      int64_t triangle) {
  const int32_t* index = shape.triangles + 3 * triangle;
  Beyond beyond;
  for (int k = 0; k < 3; ++k) {
    const float* vertex = shape.vertices + 3 * static_cast<int64_t>(index[k]);
    const double at[3] = {vertex[0], vertex[1], vertex[2]};
    beyond.add(frame, r, m, at);
  }
  return beyond.a_side(beyond.margin(frame, r));
}

static int32_t coverage(const LwSurfaces& surfaces, const LwView& view, int threads, uint8_t* reach) {
  Frame frame(surfaces, view);
  const Rectangle rectangle(frame);
  Team team(threads);
  Queue queue;
  queue.reset(surfaces.placements, 1);
  prepare_validation(frame);
  team.run([&](int index) {
    validate_and_bound(frame, team, index);
    if (frame.status != kOk || team.failed()) return;
    for (int64_t placement, end; queue.take(placement, end);) {
      const Shape shape(surfaces, surfaces.placement_mesh[placement]);
      const double* matrix = surfaces.cam_from_mesh + 12 * placement;
      const uint8_t enough = most_reach(frame, rectangle, placement);
      uint8_t most = kNoArea;
      for (int64_t i = 0; i < shape.triangle_count && most < enough; ++i) {
        if (most >= kOutsideView && is_beside(frame, rectangle, shape, matrix, i)) continue;
        const uint8_t one = triangle_reach(frame, rectangle, shape, matrix, i);
        most = one > most ? one : most;
      }
      reach[placement] = most;
    }
  });
  return team.failed() ? static_cast<int32_t>(kNoMemory) : frame.status.load();
}
