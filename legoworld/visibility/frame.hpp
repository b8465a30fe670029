// What is fixed during one call: the picture, its rays, and each mesh's bounds.
#pragma once
#include <limits>

#include "bins.hpp"
#include "scene.hpp"

namespace lw {

// A rounding error bound in units of the largest terms: see docs/decisions/003-own-z-buffer.md.
constexpr double kRounding = 32 * std::numeric_limits<double>::epsilon() / 2;

struct Box {  // of a mesh, in its own frame; empty when low > high
  float low[3], high[3];
};

struct Portion {
  int64_t mesh, vertex_begin, vertex_end, triangle_begin, triangle_end;
};

struct Frame {
  const LwSurfaces& surfaces;
  const LwView& view;
  int32_t width, height;
  int64_t tiles_x, tiles_y;
  bool orthographic;
  // Ray of pixel column c: (ray_x[c], ray_y[r], 1). It crosses the plane z = 1 at the pixel's centre.
  Buffer<double> ray_x, ray_y;
  double longest = 1;  // the largest component of any ray
  double reach;        // kRounding times that
  std::vector<Portion> portions;  // the meshes, in pieces to be validated
  Buffer<Box> portion_boxes, boxes;  // of each piece; of each mesh
  Queue validation_queue;
  std::atomic<int32_t> status{kOk};

  Frame(const LwSurfaces& all, const LwView& seen)
      : surfaces(all),
        view(seen),
        width(seen.width),
        height(seen.height),
        tiles_x((seen.width + kTile - 1) / kTile),
        tiles_y((seen.height + kTile - 1) / kTile),
        orthographic(seen.orthographic != 0) {
    fill(ray_x, width, view.cx, view.fx, longest);
    fill(ray_y, height, view.cy, view.fy, longest);
    reach = kRounding * longest;
  }

  int64_t tiles() const { return tiles_x * tiles_y; }

 private:
  static void fill(Buffer<double>& ray, int32_t count, double centre, double focal, double& longest) {
    const int32_t padded = (count + kTile - 1) / kTile * kTile + kPadding;
    double* out = ray.at_least(static_cast<size_t>(padded));
    for (int32_t i = 0; i < padded; ++i) {
      out[i] = (i + 0.5 - centre) / focal;
      const double length = out[i] < 0 ? -out[i] : out[i];
      if (length > longest) longest = length;
    }
  }
};

struct Shape {  // one mesh
  const float* vertices;
  const int32_t* triangles;
  int64_t vertex_count, triangle_count;
  int64_t first_triangle;

  Shape(const LwSurfaces& all, int64_t mesh)
      : vertices(all.vertices + 3 * all.vertex_start[mesh]),
        triangles(all.triangles + 3 * all.triangle_start[mesh]),
        vertex_count(all.vertex_start[mesh + 1] - all.vertex_start[mesh]),
        triangle_count(all.triangle_start[mesh + 1] - all.triangle_start[mesh]),
        first_triangle(all.triangle_start[mesh]) {}
};

struct Worker {
  Arena arena;
  Buffer<TileBins> bins;
  Buffer<uint64_t> bounds;  // per vertex of the placement at hand
  Buffer<float> depths;     // per vertex, as a sample there would be stored
  Buffer<Candidate> near_first;
  int64_t left_out = 0;     // triangles of this round that lie behind earlier ones
};

// Pixel bounds of a vertex or triangle: four int16, so that a triangle's are the minimum of its
// vertices': first column, -(last column + 1), first row, -(last row + 1), clamped to the picture.
struct Bounds {
  int32_t x0, x1, y0, y1;  // both ends included
  explicit Bounds(uint64_t packed)
      : x0(static_cast<int16_t>(packed)),
        x1(-static_cast<int16_t>(packed >> 16) - 1),
        y0(static_cast<int16_t>(packed >> 32)),
        y1(-static_cast<int16_t>(packed >> 48) - 1) {}
};
// A vertex nearer than z_near or beyond z_far: its triangles take the long way.
constexpr uint64_t kOutOfRange = 0xC000C000C000C000u;

}  // namespace lw
