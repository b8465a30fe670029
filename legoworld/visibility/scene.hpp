// The plain C structs that cross the border to kernel.py. Field order and types are mirrored there.
#pragma once
#include <cstdint>

extern "C" {

struct LwAlpha {           // one alpha channel, row 0 is the top row of the image
  const uint8_t* texels;
  int32_t width, height;
  int32_t wrap;            // 0 repeat, 1 extend, 2 clip, 3 mirror
  int32_t linear;          // 0 closest, 1 linear
  int32_t sides;           // 0 both, 1 seen from the front only, 2 from the back only
};

struct LwSurfaces {
  const float* vertices;          // (V,3), each mesh in its own frame
  const int32_t* triangles;       // (T,3), indices local to the mesh
  const int64_t* vertex_start;    // (M+1)
  const int64_t* triangle_start;  // (M+1)
  int64_t meshes;
  const int32_t* placement_mesh;  // (P)
  const double* cam_from_mesh;    // (P,3,4)
  const int32_t* placement_id;    // (P), -2 is a holdout
  int64_t placements;
  const int32_t* triangle_cutout; // (T) or null
  const float* corner_uv;         // (T,3,2) or null
  const float* corner_alpha;      // (T,3) or null: multiplies the image's alpha
  const LwAlpha* alphas;
  double threshold;
};

struct LwView {
  double fx, fy, cx, cy;    // pixels (orthographic: pixels per scene unit)
  double z_near, z_far;     // scene units along camera z, inclusive
  double depth_scale;       // metres per scene unit
  int32_t width, height;
  int32_t orthographic;
};
}

namespace lw {

constexpr int32_t kNothing = -1;
constexpr int32_t kHoldout = -2;

// What a call found out about its input, besides its result.
enum Status : int32_t { kOk = 0, kNoMemory = 1, kVertexNotFinite = 2, kIndexOutOfRange = 3 };

constexpr int kTile = 64;       // pixels along a side of a tile: its buffers stay in the L1 and L2 caches
constexpr int kBlock = 8;       // pixels along a side of a block, the unit of rejection by depth
constexpr int kStride = kTile + 8;  // floats from one row of a tile to the next
constexpr int kPadding = 16;    // ray tables and tile rows may be read this far past their end
constexpr int kMaxSide = 8192;  // bounds are int16

}  // namespace lw
