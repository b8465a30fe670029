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

// How far an answer may be: of_z times the query's planar z or `least` metres, whichever is more.
struct Reach {
    double of_z, least;
};

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

void search(const Cloud &queries, const Cloud &targets, Reach reach, bool wide, double *squared,
            int32_t *index) {
#if defined(__x86_64__)
    if (wide) return avx2::Search(queries, targets, reach, squared, index).run();
#endif
    static_cast<void>(wide);
    baseline::Search(queries, targets, reach, squared, index).run();
}

}  // namespace nearest

// Of each point of a the nearest of b with its label, and the other way round, where it is within
// reach: relative of a's planar z or absolute metres, whichever is more; of b's points, whatever
// may be within that of a point of a. squared, index: (height, width), filled by the caller with
// what stands where there is no answer. The grids are of one size. plain: without AVX2.
LW_API int32_t lw_nearest(const LwSurface *surface_a, const LwSurface *surface_b, double relative,
                          double absolute, int32_t plain, double *squared_a, int32_t *index_a,
                          double *squared_b, int32_t *index_b) {
    try {
        bool wide = !plain && nearest::has_avx2();
        nearest::Cloud a = nearest::Builder(*surface_a).build();
        nearest::Cloud b = nearest::Builder(*surface_b).build();
        // |q - g| <= r z_g and z_g <= z_q + |q - g| give |q - g| <= r / (1 - r) z_q.
        nearest::Reach of_a = {relative, absolute}, of_b = {relative / (1.0 - relative), absolute};
        nearest::search(a, b, of_a, wide, squared_a, index_a);
        nearest::search(b, a, of_b, wide, squared_b, index_b);
    } catch (const std::bad_alloc &) {
        return kNoMemory;
    }
    return kDone;
}
