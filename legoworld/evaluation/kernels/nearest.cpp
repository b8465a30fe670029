// Nearest points between two depth rasters of one grid, label by label, both ways. Exact: the same
// as every pair in float64, the lower raster index where distances are equal.

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
LW_END_AVX2
#endif

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
        bool wide = !plain && lw::has_avx2();
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
