// What no renderer of these arrays can avoid: read them, transform every placed vertex, look at the
// corners of every placed triangle, write two pictures. One thread; nothing is drawn.
#include <cstddef>
#include <cstdint>
#include <vector>

extern "C" double floor_pass(const float* vertices, const int32_t* triangles, const int64_t* vertex_start,
                             const int64_t* triangle_start, const int32_t* placement_mesh,
                             const double* cam_from_mesh, int64_t placements, int64_t pixels,
                             int32_t* instance, float* depth) {
  struct Point {
    double x, y, z;
  };
  std::vector<Point> scratch;
  double seen = 0;
  for (int64_t p = 0; p < placements; ++p) {
    const int64_t mesh = placement_mesh[p];
    const double* m = cam_from_mesh + 12 * p;
    const float* v = vertices + 3 * vertex_start[mesh];
    const int64_t count = vertex_start[mesh + 1] - vertex_start[mesh];
    if (scratch.size() < static_cast<std::size_t>(count)) scratch.resize(static_cast<std::size_t>(count));
    Point* to = scratch.data();
    for (int64_t i = 0; i < count; ++i) {
      const double x = v[3 * i], y = v[3 * i + 1], z = v[3 * i + 2];
      to[i] = {m[0] * x + m[1] * y + m[2] * z + m[3], m[4] * x + m[5] * y + m[6] * z + m[7],
               m[8] * x + m[9] * y + m[10] * z + m[11]};
    }
    for (int64_t t = triangle_start[mesh]; t < triangle_start[mesh + 1]; ++t) {
      const Point &a = to[triangles[3 * t]], &b = to[triangles[3 * t + 1]], &c = to[triangles[3 * t + 2]];
      const double low = a.x < b.x ? (a.x < c.x ? a.x : c.x) : (b.x < c.x ? b.x : c.x);
      const double top = a.y < b.y ? (a.y < c.y ? a.y : c.y) : (b.y < c.y ? b.y : c.y);
      seen += (low > 0) + (top > 0) + (a.z > 0);
    }
  }
  for (int64_t i = 0; i < pixels; ++i) instance[i] = static_cast<int32_t>(seen);
  for (int64_t i = 0; i < pixels; ++i) depth[i] = static_cast<float>(seen);
  return seen;
}
