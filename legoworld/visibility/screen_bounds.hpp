// Whole placements: where one can show at all, in which order they are drawn, and which lie behind
// what is drawn already. Included once per instruction set.
//
// Leaving out a sample that is farther than the stored depth of its pixel changes nothing: minima do
// not care how often, or when, a larger value is offered. So neither order nor rounds show in the bytes.

constexpr int kBlocks = kTile / kBlock;
// Measured: a round pays where it has a triangle for every six pixels of the picture.
constexpr int64_t kPixelsPerTriangle = 6;
constexpr int64_t kMostRounds = 12;
// A round that leaves out less than one triangle in so many is the last that is asked.
constexpr int64_t kWorthAsking = 64;

struct Extent {  // pixels, both ends included; nothing when x0 > x1 or y0 > y1
  int32_t x0, x1, y0, y1;
};

struct ScreenBounds {  // of a placement, by the box of its mesh
  Extent pixels;  // no other pixel can show it; empty when nothing can
  float nearest;  // no sample of it has a smaller stored depth
};

// What earlier rounds have drawn. Read while triangles are culled, written while tiles are drawn.
struct SoFar {
  const float* depth = nullptr;  // the picture; null while nothing is to be asked of it
  int64_t width = 0, tiles_x = 0;
  Buffer<float> blocks, tiles;   // the farthest depth of each, blocks tile by tile

  // Whether every pixel of the extent holds a smaller depth.
  bool hides(const Extent& at, float nearest) const {
    for (int32_t ty = at.y0 / kTile; ty <= at.y1 / kTile; ++ty) {
      for (int32_t tx = at.x0 / kTile; tx <= at.x1 / kTile; ++tx) {
        const int64_t tile = ty * tiles_x + tx;
        if (!(nearest > tiles.data()[tile]) && !hides_in(tile, ty * kTile, tx * kTile, at, nearest)) {
          return false;
        }
      }
    }
    return true;
  }

  // The same for a few pixels, looked at one by one.
  bool hides_pixels(const Bounds& at, float nearest) const {
    for (int64_t y = at.y0; y <= at.y1; ++y) {
      for (int64_t x = at.x0; x <= at.x1; ++x) {
        if (!(nearest > depth[y * width + x])) return false;
      }
    }
    return true;
  }

 private:
  bool hides_in(int64_t tile, int32_t top, int32_t left, const Extent& at, float nearest) const {
    const float* farthest = blocks.data() + tile * (kBlocks * kBlocks);
    const int32_t by0 = at.y0 > top ? (at.y0 - top) / kBlock : 0;
    const int32_t by1 = at.y1 < top + kTile ? (at.y1 - top) / kBlock : kBlocks - 1;
    const int32_t bx0 = at.x0 > left ? (at.x0 - left) / kBlock : 0;
    const int32_t bx1 = at.x1 < left + kTile ? (at.x1 - left) / kBlock : kBlocks - 1;
    for (int32_t by = by0; by <= by1; ++by) {
      for (int32_t bx = bx0; bx <= bx1; ++bx) {
        if (!(nearest > farthest[by * kBlocks + bx])) return false;
      }
    }
    return true;
  }
};

static const ScreenBounds kUnseen = {{0, -1, 0, -1}, INFINITY};

// Empty only when no sample of the placement can exist: its box lies outside the range of z, or the
// box's projection holds no pixel centre.
static ScreenBounds screen_bounds_of(const Frame& frame, int64_t placement) {
  const LwView& view = frame.view;
  const Box& box = frame.boxes.data()[frame.surfaces.placement_mesh[placement]];
  if (box.low[0] > box.high[0]) return kUnseen;
  const double* m = frame.surfaces.cam_from_mesh + 12 * placement;
  double z0 = INFINITY, z1 = -INFINITY, u0 = INFINITY, u1 = -INFINITY, v0 = INFINITY, v1 = -INFINITY;
  double slack = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const double x = (corner & 1) != 0 ? box.high[0] : box.low[0];
    const double y = (corner & 2) != 0 ? box.high[1] : box.low[1];
    const double z = (corner & 4) != 0 ? box.high[2] : box.low[2];
    double out[3];
    for (int k = 0; k < 3; ++k) {
      out[k] = m[4 * k] * x + m[4 * k + 1] * y + m[4 * k + 2] * z + m[4 * k + 3];
      slack = std::fmax(slack, std::fabs(m[4 * k] * x) + std::fabs(m[4 * k + 1] * y) +
                                   std::fabs(m[4 * k + 2] * z) + std::fabs(m[4 * k + 3]));
    }
    const double inverse = frame.orthographic ? 1.0 : 1.0 / out[2];
    const double u = view.fx * (out[0] * inverse) + view.cx;
    const double v = view.fy * (out[1] * inverse) + view.cy;
    z0 = std::fmin(z0, out[2]);
    z1 = std::fmax(z1, out[2]);
    u0 = std::fmin(u0, u);
    u1 = std::fmax(u1, u);
    v0 = std::fmin(v0, v);
    v1 = std::fmax(v1, v);
  }
  slack *= 1e-14;  // above the rounding of a transformed vertex
  if (z1 + slack < view.z_near || z0 - slack > view.z_far) return kUnseen;
  ScreenBounds out = {{0, frame.width - 1, 0, frame.height - 1}, 0};
  // A transformed vertex is not below z0 - slack, and both are scaled and rounded alike.
  out.nearest = static_cast<float>(std::fmax(z0 - slack, view.z_near) * view.depth_scale);
  if (!frame.orthographic && z0 - slack < view.z_near) return out;
  const double depth = frame.orthographic ? 1.0 : z0;
  const double margin_x = 0.01 + 4 * slack * view.fx / depth * (1 + std::fabs(u0) + std::fabs(u1));
  const double margin_y = 0.01 + 4 * slack * view.fy / depth * (1 + std::fabs(v0) + std::fabs(v1));
  const double first_x = std::ceil(std::fmax(u0 - margin_x, 0.0) - 0.5);
  const double last_x = std::floor(std::fmin(u1 + margin_x, frame.width) - 0.5);
  const double first_y = std::ceil(std::fmax(v0 - margin_y, 0.0) - 0.5);
  const double last_y = std::floor(std::fmin(v1 + margin_y, frame.height) - 0.5);
  if (first_x > last_x || first_y > last_y) return kUnseen;
  out.pixels = {static_cast<int32_t>(first_x), static_cast<int32_t>(last_x),
                static_cast<int32_t>(first_y), static_cast<int32_t>(last_y)};
  return out;
}

// The placements in sight, and where each round of them ends. One round keeps their order; more than
// one are drawn nearest first, each about as many triangles as drawing all tiles again is worth.
struct Schedule {
  Buffer<ScreenBounds> bounds;  // of every placement
  std::vector<int64_t> order, ends;
};

static void schedule(const Frame& frame, Schedule& plan) {
  const LwSurfaces& all = frame.surfaces;
  int64_t triangles = 0;
  for (int64_t i = 0; i < all.placements; ++i) {
    if (plan.bounds.data()[i].pixels.x0 > plan.bounds.data()[i].pixels.x1) continue;
    plan.order.push_back(i);
    triangles += Shape(all, all.placement_mesh[i]).triangle_count;
  }
  const int64_t pixels = static_cast<int64_t>(frame.width) * frame.height;
  int64_t rounds = triangles * kPixelsPerTriangle / pixels;
  rounds = rounds < kMostRounds ? rounds : kMostRounds;
  if (rounds > 1) {
    std::sort(plan.order.begin(), plan.order.end(), [&](int64_t a, int64_t b) {
      const float za = plan.bounds.data()[a].nearest, zb = plan.bounds.data()[b].nearest;
      return za < zb || (za == zb && a < b);
    });
    int64_t taken = 0;
    for (size_t i = 0; i + 1 < plan.order.size(); ++i) {
      taken += Shape(all, all.placement_mesh[plan.order[i]]).triangle_count;
      const auto share = triangles * static_cast<int64_t>(plan.ends.size() + 1) / rounds;
      if (taken >= share && share < triangles) plan.ends.push_back(static_cast<int64_t>(i + 1));
    }
  }
  plan.ends.push_back(static_cast<int64_t>(plan.order.size()));
}
