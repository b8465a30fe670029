// Nearest points between two depth rasters of one grid, label by label, both ways. Exact: the same
// as every pair in float64, the lower raster index where distances are equal.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <new>

#include "api.hpp"
#include "instruction_sets.hpp"
#include "nearest_cloud.hpp"

namespace nearest {

// How far an answer may be: of_z times the query's planar z or `least` metres, whichever is more.
struct Reach {
    double of_z, least;
};

// Of a squared distance: more than rounding can make of it.
constexpr double kLooser = 1.0 + 1e-9;

namespace baseline {
#define LW_LANES 2
#include "nearest_search.hpp"
#undef LW_LANES
}  // namespace baseline

#if defined(__x86_64__)
LW_BEGIN_AVX2
namespace avx2 {
#define LW_LANES 4
#include "nearest_search.hpp"
#undef LW_LANES
}  // namespace avx2
#if defined(__clang__)
#pragma clang attribute pop
#pragma clang attribute push(__attribute__((target("avx512f"))), apply_to = function)
#else
#pragma GCC pop_options
#pragma GCC push_options
#pragma GCC target("avx512f")
#endif
namespace avx512 {
#define LW_LANES 8
#include "nearest_search.hpp"
#undef LW_LANES
}  // namespace avx512
#if defined(__clang__)
#pragma clang attribute pop
#else
#pragma GCC pop_options
#endif
#endif

// Doubles in the widest vector that this CPU and its system have. Asked of the CPU itself:
// __builtin_cpu_supports does not link everywhere (zig's compiler-rt).
int widest() {
#if defined(__x86_64__)
    constexpr uint32_t kYmmSaved = 0x6, kZmmSaved = 0xe6;
    uint32_t a = 0, b = 0, c = 0, d = 0;
    if (!__get_cpuid(1, &a, &b, &c, &d) || (c & bit_OSXSAVE) == 0) return 2;
    uint32_t saved = 0, high = 0;
    __asm__ volatile("xgetbv" : "=a"(saved), "=d"(high) : "c"(0));
    if (!__get_cpuid_count(7, 0, &a, &b, &c, &d)) return 2;
    if ((saved & kZmmSaved) == kZmmSaved && (b & bit_AVX512F) != 0) return 8;
    return (saved & kYmmSaved) == kYmmSaved && (b & bit_AVX2) != 0 ? 4 : 2;
#else
    return 2;
#endif
}

void search(const Cloud &queries, const Cloud &targets, Reach reach, int lanes, double *squared,
            int32_t *index) {
#if defined(__x86_64__)
    if (lanes >= 8) return avx512::Search(queries, targets, reach, squared, index).run();
    if (lanes >= 4) return avx2::Search(queries, targets, reach, squared, index).run();
#endif
    static_cast<void>(lanes);
    baseline::Search(queries, targets, reach, squared, index).run();
}

// Kept from call to call: fresh pages take longer than what is written to them.
struct Scratch {
    Cloud a, b;
};

}  // namespace nearest

// Of each point of a the nearest of b with its label, and the other way round, where it is within
// reach: relative of a's planar z or absolute metres, whichever is more; of b's points, whatever
// may be within that of a point of a. squared, index: (height, width), filled by the caller with
// what stands where there is no answer. The grids are of one size. lanes: of a vector at most.
LW_API int32_t lw_nearest(const LwSurface *surface_a, const LwSurface *surface_b, double relative,
                          double absolute, int32_t lanes, double *squared_a, int32_t *index_a,
                          double *squared_b, int32_t *index_b) {
    try {
        thread_local nearest::Scratch scratch;
        const int wide = std::min(static_cast<int>(lanes), nearest::widest());
        nearest::Cloud &a = scratch.a, &b = scratch.b;
        nearest::Builder(*surface_a, a).build();
        nearest::Builder(*surface_b, b).build();
        // |q - g| <= r z_g and z_g <= z_q + |q - g| give |q - g| <= r / (1 - r) z_q.
        nearest::Reach of_a = {relative, absolute}, of_b = {relative / (1.0 - relative), absolute};
        nearest::search(a, b, of_a, wide, squared_a, index_a);
        nearest::search(b, a, of_b, wide, squared_b, index_b);
    } catch (const std::bad_alloc &) {
        return kNoMemory;
    }
    return kDone;
}
