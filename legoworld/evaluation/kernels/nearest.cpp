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
    int count;
    float moving;
    double of_z[kMostTolerances], at_least[kMostTolerances];   // tau
    float relative[kMostTolerances], absolute[kMostTolerances];  // the same as floats
    double reach_of_z[kMostTolerances], reach[kMostTolerances];  // by the query's z

    // Nothing farther is a hit: d <= r z_g + a and z_g <= z + d give d <= (r z + a) / (1 - r).
    Asked(const double *r, const double *a, int32_t many, bool targets_are_reference)
        : count(many), moving(targets_are_reference ? 1.0f : 0.0f) {
        for (int k = 0; k < count; ++k) {
            of_z[k] = r[k];
            at_least[k] = a[k];
            relative[k] = static_cast<float>(r[k]);
            absolute[k] = static_cast<float>(a[k]);
            const double share = targets_are_reference ? 1.0 - r[k] : 1.0;
            reach_of_z[k] = share > 0.0 ? r[k] / share : 0.0;
            reach[k] = share > 0.0 ? a[k] / share : kInfinity;
        }
    }
};

// Where answers go: squared distance and index of each pixel's, or `hits`: (labels, tolerances) of
// how many are within each, by the depth of the reference where that is not the query's own.
struct Told {
    double *squared;
    int32_t *index;
    int64_t *hits;
    const float *depth;
};

namespace baseline {
#define LW_LANES 2
#include "nearest_lanes.hpp"
#include "nearest_search.hpp"
#undef LW_LANES
}  // namespace baseline

#if defined(__x86_64__)
LW_BEGIN_AVX2
namespace avx2 {
#define LW_LANES 4
#include "nearest_lanes.hpp"
#include "nearest_search.hpp"
#undef LW_LANES
}  // namespace avx2
LW_END_AVX2
LW_BEGIN_AVX512
namespace avx512 {
#define LW_LANES 8
#include "nearest_lanes.hpp"
#include "nearest_search.hpp"
#undef LW_LANES
}  // namespace avx512
LW_END_AVX512
#endif

void search(const Cloud &queries, const Cloud &targets, const Asked &asked, int lanes,
            const Told &told) {
#if defined(__x86_64__)
    if (lanes >= 8 && lw::has_avx512())
        return avx512::Search(queries, targets, asked, told).run();
    if (lanes >= 4 && lw::has_avx2())
        return avx2::Search(queries, targets, asked, told).run();
#endif
    static_cast<void>(lanes);
    baseline::Search(queries, targets, asked, told).run();
}

// Kept from call to call: fresh pages take longer than what is written to them.
struct Scratch {
    Cloud a, b;
};

struct Request {
    const double *relative, *absolute;
    int32_t count, lanes;
};

void both_ways(const LwSurface &surface_a, const LwSurface &surface_b, const Request &request,
               const Told &of_a, const Told &of_b, int64_t *sizes) {
    thread_local Scratch scratch;
    Cloud &a = scratch.a, &b = scratch.b;
    Builder(surface_a, a).build();
    Builder(surface_b, b).build();
    if (sizes != nullptr) {
        for (const Leaf &leaf : a.leaves) sizes[2 * leaf.label] += leaf.end - leaf.begin;
        for (const Leaf &leaf : b.leaves) sizes[2 * leaf.label + 1] += leaf.end - leaf.begin;
    }
    search(a, b, {request.relative, request.absolute, request.count, false}, request.lanes,
           of_a);
    search(b, a, {request.relative, request.absolute, request.count, true}, request.lanes,
           of_b);
}

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
        nearest::both_ways(*surface_a, *surface_b, {relative, absolute, count, lanes},
                           {squared_a, index_a, nullptr, nullptr},
                           {squared_b, index_b, nullptr, nullptr}, nullptr);
    } catch (const std::bad_alloc &) {
        return kNoMemory;
    }
    return kDone;
}

// How many points of each label there are, (labels, 2) of a and b, and how many of them are hits at
// each tolerance, (labels, count) each: all zero when called.
LW_API int32_t lw_hits(const LwSurface *surface_a, const LwSurface *surface_b,
                       const double *relative, const double *absolute, int32_t count,
                       int32_t lanes, int64_t *sizes, int64_t *hits_a, int64_t *hits_b) {
    if (count > nearest::kMostTolerances) return kTooMany;
    try {
        nearest::both_ways(*surface_a, *surface_b, {relative, absolute, count, lanes},
                           {nullptr, nullptr, hits_a, nullptr},
                           {nullptr, nullptr, hits_b, surface_a->depth}, sizes);
    } catch (const std::bad_alloc &) {
        return kNoMemory;
    }
    return kDone;
}
