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

struct LwHits {           // of each pixel's hit, besides instance and depth
  int32_t* placement;     // (H,W) or null, -1 without a hit
  int32_t* triangle;      // (H,W) or null as placement, local to its mesh, -1 without a hit
  float* barycentric;     // (H,W,2) or null: the weights of corners 1 and 2, NaN without a hit
  float* normal;          // (H,W,3) or null: camera frame, towards the camera, NaN without a hit
  const float* corner_normal;  // (T,3,3) or null: interpolated into normal where all three are not 0
  int64_t flipped;        // written: normals of faces that pointed away from the camera
};

// Makes room for that many entries and sets both pointers; 0 when it could.
typedef int32_t (*LwAllocate)(int64_t entries, int32_t** instance, float** depth);

struct LwLayers {
  int64_t instances;      // the placements' ids are 0..instances - 1
  const int32_t* ident;   // (instances), ascending: what is written for each id
  int64_t most;           // entries; with more, nothing is written
  LwAllocate allocate;
  int64_t* start;         // (H*W+1): pixel p has the entries start[p]..start[p + 1] - 1
};
}

namespace lw {

constexpr int32_t kNothing = -1;
constexpr int32_t kHoldout = -2;

// What a call found out about its input, besides its result.
enum Status : int32_t { kOk = 0, kNoMemory = 1, kVertexNotFinite = 2, kIndexOutOfRange = 3, kTooManyLayers = 4 };

constexpr int kTile = 64;       // pixels along a side of a tile: its buffers stay in the L1 and L2 caches
constexpr int kBlock = 8;       // pixels along a side of a block, the unit of rejection by depth
constexpr int kStride = kTile + 8;  // floats from one row of a tile to the next
constexpr int kPadding = 16;    // ray tables and tile rows may be read this far past their end
constexpr int kMaxSide = 8192;  // bounds are int16

}  // namespace lw
