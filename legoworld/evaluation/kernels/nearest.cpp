// Nearest points between two depth rasters of one grid, label by label, both ways. Exact: the same
// as every pair in float64, the lower raster index where distances are equal.

#include <cmath>
#include <cstdint>
#include <new>

#if defined(__x86_64__)
#include <cpuid.h>
#include <immintrin.h>
#endif

#include "api.hpp"
#include "nearest_cloud.hpp"

namespace nearest {

namespace baseline {
#define LW_LANES 2
#include "nearest_search.hpp"
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
#include "nearest_search.hpp"
#undef LW_LANES
}  // namespace avx2
#if defined(__clang__)
#pragma clang attribute pop
#else
#pragma GCC pop_options
#endif
#endif

// Asked of the CPU itself: __builtin_cpu_supports does not link everywhere (zig's compiler-rt).
bool has_avx2() {
#if defined(__x86_64__)
    constexpr uint32_t kXmmAndYmmSaved = 6;
    uint32_t a = 0, b = 0, c = 0, d = 0;
    if (!__get_cpuid(1, &a, &b, &c, &d) || (c & bit_OSXSAVE) == 0) return false;
    uint32_t saved = 0, high = 0;
    __asm__ volatile("xgetbv" : "=a"(saved), "=d"(high) : "c"(0));
    if ((saved & kXmmAndYmmSaved) != kXmmAndYmmSaved) return false;
    return __get_cpuid_count(7, 0, &a, &b, &c, &d) && (b & bit_AVX2) != 0;
#else
    return false;
#endif
}

void search(const LwGrid &grid, const Cloud &queries, const Cloud &targets, bool wide,
            double *squared, int32_t *index) {
#if defined(__x86_64__)
    if (wide) return avx2::Search(grid, queries, targets, squared, index).run();
#endif
    static_cast<void>(wide);
    baseline::Search(grid, queries, targets, squared, index).run();
}

}  // namespace nearest

// Of each point of a the nearest of b with its label, and the other way round. depth: planar z, no
// point where it is not finite and positive. squared, index: (height, width), filled by the caller
// with what stands where there is no answer. plain: without AVX2.
LW_API int32_t lw_nearest(const LwGrid *grid, const int32_t *label, const float *depth_a,
                          const float *depth_b, int32_t plain, double *squared_a, int32_t *index_a,
                          double *squared_b, int32_t *index_b) {
    try {
        bool wide = !plain && nearest::has_avx2();
        nearest::Cloud a = nearest::Builder(*grid, depth_a, label).build();
        nearest::Cloud b = nearest::Builder(*grid, depth_b, label).build();
        nearest::search(*grid, a, b, wide, squared_a, index_a);
        nearest::search(*grid, b, a, wide, squared_b, index_b);
    } catch (const std::bad_alloc &) {
        return kNoMemory;
    }
    return kDone;
}
