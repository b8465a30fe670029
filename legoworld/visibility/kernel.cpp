// The visibility kernel: instance and depth of what each pixel centre's ray hits first.
// On request its triangle, weights and normal too (hits.hpp), or every instance as if alone (layers.hpp).
// One translation unit; the hot part is compiled once per instruction set and chosen at run time.
// Must be compiled without contraction of a*b+c (-ffp-contract=off): edge functions rely on it.
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <memory>
#include <vector>

#include "cutout.hpp"
#include "exported.hpp"
#include "frame.hpp"
#include "instruction_sets.hpp"
#include "scene.hpp"
#include "runs.hpp"
#include "team.hpp"

namespace lw {

namespace baseline {
#define LW_LANES 2
#include "variant.hpp"
#undef LW_LANES
}  // namespace baseline

#if defined(__x86_64__)
LW_BEGIN_AVX2
namespace avx2 {
#define LW_LANES 4
#include "variant.hpp"
#undef LW_LANES
}  // namespace avx2
LW_END_AVX2
LW_BEGIN_AVX512
namespace avx512 {
#define LW_LANES 8
#include "variant.hpp"
#undef LW_LANES
}  // namespace avx512
LW_END_AVX512
#endif

}  // namespace lw

LW_API const char* lw_source_hash() { return LEGOWORLD_SOURCE_HASH; }

// 0 the baseline of the platform, 1 AVX2, 2 AVX-512.
LW_API int32_t lw_best_level() { return lw::has_avx512() ? 2 : lw::has_avx2() ? 1 : 0; }

// Calls what the level's variant has under a name; a status, also when memory runs out.
#if defined(__x86_64__)
#define LW_VARIANT(level, call)                   \
  try {                                           \
    if ((level) > 1) return lw::avx512::call;     \
    if ((level) > 0) return lw::avx2::call;       \
    return lw::baseline::call;                    \
  } catch (const std::bad_alloc&) {               \
    return lw::kNoMemory;                         \
  }
#else
#define LW_VARIANT(level, call)                   \
  try {                                           \
    static_cast<void>(level);                     \
    return lw::baseline::call;                    \
  } catch (const std::bad_alloc&) {               \
    return lw::kNoMemory;                         \
  }
#endif

// hits: null, or more arrays to be filled.
LW_API int32_t lw_render(const LwSurfaces* surfaces, const LwView* view, int32_t threads, int32_t level,
                         int32_t* instance, float* depth, LwHits* hits) {
  LW_VARIANT(level, render(*surfaces, *view, threads, instance, depth, hits))
}

LW_API int32_t lw_layers(const LwSurfaces* surfaces, const LwView* view, int32_t threads, int32_t level,
                         const LwLayers* layers) {
  LW_VARIANT(level, layers(*surfaces, *view, threads, *layers))
}

LW_API int32_t lw_coverage(const LwSurfaces* surfaces, const LwView* view, int32_t threads,
                           uint8_t* reach) {
  try {
    return lw::baseline::coverage(*surfaces, *view, threads, reach);
  } catch (const std::bad_alloc&) {
    return lw::kNoMemory;
  }
}

LW_API int32_t lw_extents(const int32_t* instance, int32_t width, int32_t height, int64_t instances,
                          int64_t* area, int64_t* extent) {
  return lw::extents(instance, width, height, instances, area, extent);
}

// start: null, and instance a picture of ids; or both as LwLayers has them. Below 0: the negative of a
// status.
LW_API int64_t lw_masks(const int64_t* start, const int32_t* instance, int32_t width, int32_t height,
                        int64_t instances, char* text, int64_t space, int64_t* ends) {
  try {
    return lw::masks(start == nullptr ? lw::column_runs(instance, width, height)
                                      : lw::layer_runs(start, instance, width, height, instances),
                     static_cast<int64_t>(width) * height, instances, text, space, ends);
  } catch (const std::bad_alloc&) {
    return -lw::kNoMemory;
  }
}
