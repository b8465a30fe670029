// Voxels that two clouds occupy, at several edges: integers, so that no order of points matters.

#include <cstdint>
#include <new>
#include <vector>

#include "api.hpp"

namespace {

// Voxels from the camera in each direction; what lies beyond is in the outermost one.
constexpr double kReach = 1 << 20;

// floor(value / edge), bounded, counted from the outermost voxel: 21 bits.
uint64_t cell(double value, double edge) {
    double of = value / edge;
    of = of > -kReach ? of : -kReach;
    of = of < kReach - 1 ? of : kReach - 1;
    const int32_t below = static_cast<int32_t>(of);
    return static_cast<uint64_t>(below - (below > of ? 1 : 0) + (1 << 20));
}

// Voxels by number, with who has been there: open addressing, at most half full.
class Seen {
public:
    Seen() { resize(std::size_t{1} << 12); }

    // Marks the voxel; gives who had been there before.
    uint8_t mark(uint64_t voxel, uint8_t who) {
        std::size_t at = place(voxel);
        const uint8_t before = who_[at];
        if (!before) {
            if (2 * ++count_ > who_.size()) {
                grow();
                at = place(voxel);
            }
            voxel_[at] = voxel;
        }
        who_[at] = before | who;
        return before;
    }

private:
    std::size_t place(uint64_t voxel) const {
        std::size_t at = (voxel * 0x9E3779B97F4A7C15u) >> shift_;
        while (who_[at] && voxel_[at] != voxel) at = (at + 1) & (who_.size() - 1);
        return at;
    }

    void resize(std::size_t size) {
        who_.assign(size, 0);
        voxel_.resize(size);
        for (shift_ = 64; size > 1; size /= 2) --shift_;
    }

    void grow() {
        const std::vector<uint8_t> who = who_;
        const std::vector<uint64_t> voxel = voxel_;
        resize(2 * who.size());
        for (std::size_t k = 0; k < who.size(); ++k) {
            if (!who[k]) continue;
            const std::size_t at = place(voxel[k]);
            who_[at] = who[k];
            voxel_[at] = voxel[k];
        }
    }

    std::vector<uint8_t> who_;
    std::vector<uint64_t> voxel_;
    std::size_t count_ = 0;
    int shift_ = 0;
};

// Voxels that `who` is the first to mark, and those that another had marked before.
struct Found {
    int64_t fresh = 0, shared = 0;
};

Found mark(const double *points, int64_t n, double edge, uint8_t who, Seen &seen) {
    Found found;
    uint64_t last = ~uint64_t{0};  // none: a number has 63 bits
    for (const double *p = points; p != points + 3 * n; p += 3) {
        const uint64_t voxel = cell(p[0], edge) << 42 | cell(p[1], edge) << 21 | cell(p[2], edge);
        if (voxel == last) continue;  // as neighbours on a raster mostly have
        last = voxel;
        const uint8_t before = seen.mark(voxel, who);
        found.fresh += !before;
        found.shared += before && !(before & who);
    }
    return found;
}

}  // namespace

// a: (n_a, 3), b: (n_b, 3), finite; voxel k spans [k edge, (k + 1) edge) on each axis. both, either:
// (edges,) voxels that both occupy, and that either does.
LW_API int32_t lw_voxels(const double *a, int64_t n_a, const double *b, int64_t n_b,
                         const double *edge, int64_t edges, int64_t *both, int64_t *either) try {
    for (int64_t k = 0; k < edges; ++k) {
        Seen seen;
        const Found of_a = mark(a, n_a, edge[k], 1, seen), of_b = mark(b, n_b, edge[k], 2, seen);
        both[k] = of_b.shared;
        either[k] = of_a.fresh + of_b.fresh;
    }
    return kDone;
} catch (const std::bad_alloc &) {
    return kNoMemory;
}
