// Which points of one cloud have a point of another within a distance.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <new>
#include <vector>

#include "api.hpp"

namespace {

// Cells along an axis at most: a cloud much wider than the distance gets wider cells.
constexpr double kMost = 64;

// The targets by the cell that holds them: cells are at least as wide as the distance.
class Cells {
public:
    Cells(const float *targets, int64_t n, double distance) : targets_(targets) {
        double high[3];
        for (int a = 0; a < 3; ++a) {
            low_[a] = high[a] = targets[a];
            for (int64_t k = 1; k < n; ++k) {
                low_[a] = std::min<double>(low_[a], targets[3 * k + a]);
                high[a] = std::max<double>(high[a], targets[3 * k + a]);
            }
            // A little wider, so that rounding hides no neighbour.
            edge_ = std::max({edge_, distance * (1 + 1e-9), (high[a] - low_[a]) / kMost});
        }
        for (int a = 0; a < 3; ++a)
            size_[a] = static_cast<int64_t>((high[a] - low_[a]) / edge_) + 1;
        first_.assign(size_[0] * size_[1] * size_[2] + 1, 0);
        std::vector<int64_t> cell(n);
        for (int64_t k = 0; k < n; ++k) {
            const float *p = targets + 3 * k;
            cell[k] = (place(p, 2) * size_[1] + place(p, 1)) * size_[0] + place(p, 0);
            ++first_[cell[k] + 1];
        }
        for (std::size_t c = 1; c < first_.size(); ++c) first_[c] += first_[c - 1];
        std::vector<int64_t> next(first_.begin(), first_.end() - 1);
        order_.resize(n);
        for (int64_t k = 0; k < n; ++k) order_[next[cell[k]]++] = k;
    }

    bool has(const float *p, double squared) const {
        int64_t from[3], to[3];
        for (int a = 0; a < 3; ++a) {
            const double at = std::floor((p[a] - low_[a]) / edge_);
            if (!(at >= -1 && at <= size_[a])) return false;  // NaN, too
            from[a] = std::max<int64_t>(static_cast<int64_t>(at) - 1, 0);
            to[a] = std::min(static_cast<int64_t>(at) + 1, size_[a] - 1);
        }
        for (int64_t z = from[2]; z <= to[2]; ++z)
            for (int64_t y = from[1]; y <= to[1]; ++y) {
                const int64_t row = (z * size_[1] + y) * size_[0];
                for (int64_t k = first_[row + from[0]]; k < first_[row + to[0] + 1]; ++k) {
                    const float *q = targets_ + 3 * order_[k];
                    const double x = double(p[0]) - q[0], v = double(p[1]) - q[1],
                                 w = double(p[2]) - q[2];
                    if (x * x + v * v + w * w <= squared) return true;
                }
            }
        return false;
    }

private:
    int64_t place(const float *p, int a) const {
        return std::min(static_cast<int64_t>((p[a] - low_[a]) / edge_), size_[a] - 1);
    }

    const float *targets_;
    double low_[3], edge_ = 0;
    int64_t size_[3];
    std::vector<int64_t> first_, order_;
};

}  // namespace

// points: (n, 3), targets: (m, 3), finite; m and distance above 0. near: (n,) 1 where a target is
// within the distance.
LW_API int32_t lw_within(const float *points, int64_t n, const float *targets, int64_t m,
                         double distance, uint8_t *near) try {
    const Cells cells(targets, m, distance);
    for (int64_t k = 0; k < n; ++k) near[k] = cells.has(points + 3 * k, distance * distance);
    return kDone;
} catch (const std::bad_alloc &) {
    return kNoMemory;
}
