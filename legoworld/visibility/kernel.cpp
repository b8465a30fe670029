// The visibility kernel: instance and depth of what each pixel centre's ray hits first.
// One translation unit; the hot part is compiled once per instruction set and chosen at run time.
// Must be compiled without contraction of a*b+c (-ffp-contract=off): edge functions rely on it.
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>

#if defined(__x86_64__)
#include <cpuid.h>
#include <immintrin.h>
#endif

#include "cutout.hpp"
#include "frame.hpp"
#include "scene.hpp"
#include "team.hpp"

namespace lw {

namespace baseline {
#define LW_LANES 2
#include "variant.hpp"
#undef LW_LANES
}  // namespace baseline

#if defined(__x86_64__)
#if defined(__clang__)
#pragma clang attribute push(__attribute__((target("avx2"))), apply_to = function)
#else
#pragma GCC push_options
#pragma GCC target("avx2")
#endif
namespace avx2 {
#define LW_LANES 4
#include "variant.hpp"
#undef LW_LANES
}  // namespace avx2
#if defined(__clang__)
#pragma clang attribute pop
#else
#pragma GCC pop_options
#endif
#endif

// Asked of the CPU itself: __builtin_cpu_supports does not link everywhere (zig's compiler-rt).
int best_level() {
#if defined(__x86_64__)
  constexpr uint32_t kXmmAndYmmSaved = 6;
  uint32_t a = 0, b = 0, c = 0, d = 0;
  if (!__get_cpuid(1, &a, &b, &c, &d) || (c & bit_OSXSAVE) == 0) return 0;
  uint32_t saved = 0, high = 0;
  __asm__ volatile("xgetbv" : "=a"(saved), "=d"(high) : "c"(0));
  if ((saved & kXmmAndYmmSaved) != kXmmAndYmmSaved) return 0;
  if (__get_cpuid_count(7, 0, &a, &b, &c, &d) && (b & bit_AVX2) != 0) return 1;
#endif
  return 0;
}

}  // namespace lw

#if defined(_WIN32)
#define LW_EXPORT extern "C" __declspec(dllexport)
#else
#define LW_EXPORT extern "C" __attribute__((visibility("default")))
#endif

#ifndef LEGOWORLD_SOURCE_HASH
#error "compile with -DLEGOWORLD_SOURCE_HASH=\"...\", as setup.py does"
#endif

LW_EXPORT const char* lw_source_hash() { return LEGOWORLD_SOURCE_HASH; }

// 0 the baseline of the platform, 1 AVX2.
LW_EXPORT int32_t lw_best_level() { return lw::best_level(); }

LW_EXPORT int32_t lw_render(const LwSurfaces* surfaces, const LwView* view, int32_t threads,
                            int32_t level, int32_t* instance, float* depth) {
  try {
#if defined(__x86_64__)
    if (level > 0) return lw::avx2::render(*surfaces, *view, threads, instance, depth);
#endif
    static_cast<void>(level);
    return lw::baseline::render(*surfaces, *view, threads, instance, depth);
  } catch (const std::bad_alloc&) {
    return lw::kNoMemory;
  }
}

LW_EXPORT int32_t lw_coverage(const LwSurfaces* surfaces, const LwView* view, int32_t threads,
                              uint8_t* reach) {
  try {
    return lw::baseline::coverage(*surfaces, *view, threads, reach);
  } catch (const std::bad_alloc&) {
    return lw::kNoMemory;
  }
}
