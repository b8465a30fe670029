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

// Of a squared distance, more than the rounding of a tolerance to floats.
constexpr double kFloatTolerance = 1.0 + 1e-6;
constexpr int kMostTolerances = 16;

// Tolerances tau(g) = relative * z_g + absolute of the reference points g that are to be decided;
// none asks for the nearest, wherever it is. The reference points are the queries (moving 0: z_g is
// the query's own z) or the targets (moving 1: z_g is as far from the query's z as g is, at most).
struct Asked {
    float relative[kMostTolerances], absolute[kMostTolerances], moving;
    int count;

    // Nothing farther is a hit: d <= r z_g + a and z_g <= z + d give d <= (r z + a) / (1 - r).
    double reach_squared(double z) const {
        double most = count ? 0.0 : kInfinity;
        for (int k = 0; k < count; ++k) {
            double share = 1.0 - moving * relative[k];
            double tau = share > 0.0 ? (relative[k] * z + absolute[k]) / share : kInfinity;
            most = tau > most ? tau : most;
        }
        return most * most * kFloatTolerance;
    }
};

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

void search(const Cloud &queries, const Cloud &targets, const Asked &asked, int lanes, double *squared,
            int32_t *index) {
#if defined(__x86_64__)
    if (lanes >= 8) return avx512::Search(queries, targets, asked, squared, index).run();
    if (lanes >= 4) return avx2::Search(queries, targets, asked, squared, index).run();
#endif
    static_cast<void>(lanes);
    baseline::Search(queries, targets, asked, squared, index).run();
}

// Kept from call to call: fresh pages take longer than what is written to them.
struct Scratch {
    Cloud a, b;
};

}  // namespace nearest

// Of each point of a the nearest of b with its label, and the other way round. With `count`
// tolerances, tau = relative * z + absolute at planar z of points of a, only what decides each of
// them: an answer is a hit where the nearest is one and a miss where that is, whether a's own z or
// the answer's is asked, and no answer is a miss. squared, index: (height, width), filled by the
// caller with what stands where there is no answer. The grids are of one size, and a does not move
// where there are tolerances. lanes: of a vector of float64 at most.
LW_API int32_t lw_nearest(const LwSurface *surface_a, const LwSurface *surface_b,
                          const double *relative, const double *absolute, int32_t count,
                          int32_t lanes, double *squared_a, int32_t *index_a, double *squared_b,
                          int32_t *index_b) {
    if (count > nearest::kMostTolerances) return kTooMany;
    try {
        thread_local nearest::Scratch scratch;
        const int wide = std::min(static_cast<int>(lanes), nearest::widest());
        nearest::Cloud &a = scratch.a, &b = scratch.b;
        nearest::Builder(*surface_a, a).build();
        nearest::Builder(*surface_b, b).build();
        nearest::Asked asked = {{}, {}, 0.0f, count};
        for (int k = 0; k < count; ++k) {
            asked.relative[k] = static_cast<float>(relative[k]);
            asked.absolute[k] = static_cast<float>(absolute[k]);
        }
        nearest::search(a, b, asked, wide, squared_a, index_a);
        asked.moving = 1.0f;
        nearest::search(b, a, asked, wide, squared_b, index_b);
    } catch (const std::bad_alloc &) {
        return kNoMemory;
    }
    return kDone;
}
