// nanoflann's k-d tree over a cloud of float64 points, asked for the nearest of each query.
// nearest.py compiles this with -O3 -march=native: its own best case.

#include <cstddef>
#include <cstdint>
#include <nanoflann.hpp>

struct Points {
    const double *at;
    std::size_t count;
    std::size_t kdtree_get_point_count() const { return count; }
    double kdtree_get_pt(std::size_t point, std::size_t axis) const { return at[3 * point + axis]; }
    template <class Box> bool kdtree_get_bbox(Box &) const { return false; }
};

extern "C" void nanoflann_nearest(const double *points, std::size_t count, const double *queries,
                                  std::size_t many, double *squared) {
    using Metric = nanoflann::L2_Simple_Adaptor<double, Points>;
    const Points cloud{points, count};
    nanoflann::KDTreeSingleIndexAdaptor<Metric, Points, 3, std::uint32_t> tree(3, cloud, {10});
    for (std::size_t k = 0; k < many; ++k) {
        std::uint32_t index;
        tree.knnSearch(queries + 3 * k, 1, &index, squared + k);
    }
}
