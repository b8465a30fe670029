// Volumes of boxes, and of what two of them have in common: one box is cut by the planes of the
// other. A cut makes one new corner on each edge that it crosses, which both of the edge's faces
// share, so the solid stays closed and its volume has no other error than that of its corners.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <new>
#include <vector>

#include "api.hpp"

namespace {

struct Point {
    double x, y, z;
    Point operator+(const Point &o) const { return {x + o.x, y + o.y, z + o.z}; }
    Point operator-(const Point &o) const { return {x - o.x, y - o.y, z - o.z}; }
    Point operator*(double s) const { return {x * s, y * s, z * s}; }
};

double dot(const Point &a, const Point &b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

Point cross(const Point &a, const Point &b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

constexpr int kCorners = 8, kFaces = 6;
// Omni3D's corners: 0 1 2 3 around the side of smaller local z, 4 5 6 7 behind them.
constexpr int kLoops[kFaces][4] = {{0, 3, 2, 1}, {4, 5, 6, 7}, {0, 1, 5, 4},
                                   {3, 7, 6, 2}, {0, 4, 7, 3}, {1, 2, 6, 5}};
// Below this share of a cube of its diagonal, a box is flat; below this share of the smaller
// volume, what two boxes have in common is a touch.
constexpr double kFlat = 1e-13, kTouch = 1e-12;

struct Plane {
    Point normal;  // outwards, any length
    Point on;
};

struct Box {
    std::array<Point, kCorners> corners;
    std::array<Plane, kFaces> planes;
    Point low, high;
    double volume;  // 0 for a flat one
    bool mirrored;
};

double volume_of_loop(const Point *points, int n) {
    double sum = 0;
    for (int k = 2; k < n; ++k) sum += dot(points[0], cross(points[k - 1], points[k]));
    return sum / 6;
}

Box read_box(const double *numbers) {
    Box box;
    for (int k = 0; k < kCorners; ++k)
        box.corners[k] = {numbers[3 * k], numbers[3 * k + 1], numbers[3 * k + 2]};
    box.low = box.high = box.corners[0];
    for (const Point &p : box.corners) {
        box.low = {std::min(box.low.x, p.x), std::min(box.low.y, p.y), std::min(box.low.z, p.z)};
        box.high = {std::max(box.high.x, p.x), std::max(box.high.y, p.y), std::max(box.high.z, p.z)};
    }
    double volume = 0;
    for (int f = 0; f < kFaces; ++f) {
        std::array<Point, 4> loop;
        for (int k = 0; k < 4; ++k) loop[k] = box.corners[kLoops[f][k]] - box.corners[0];
        volume += volume_of_loop(loop.data(), 4);
        const Point normal = cross(loop[2] - loop[0], loop[3] - loop[1]);
        box.planes[f] = {normal, (box.corners[kLoops[f][0]] + box.corners[kLoops[f][2]]) * 0.5};
    }
    const Point size = box.high - box.low;
    const double diagonal = std::sqrt(dot(size, size));
    box.mirrored = volume < 0;
    box.volume = std::abs(volume);
    if (!(box.volume > kFlat * diagonal * diagonal * diagonal)) box.volume = 0;
    if (box.mirrored)
        for (Plane &plane : box.planes) plane.normal = plane.normal * -1;
    return box;
}

bool apart(const Box &a, const Box &b) {
    return a.high.x <= b.low.x || b.high.x <= a.low.x || a.high.y <= b.low.y ||
           b.high.y <= a.low.y || a.high.z <= b.low.z || b.high.z <= a.low.z;
}

// A closed solid as loops of corners; scratch space of all pairs of a call.
class Solid {
public:
    void begin(const Box &box, const Point &origin) {
        points_.clear();
        for (const Point &p : box.corners) points_.push_back(p - origin);
        loops_.resize(kFaces);
        for (int f = 0; f < kFaces; ++f) {
            loops_[f].assign(kLoops[f], kLoops[f] + 4);
            if (box.mirrored) std::reverse(loops_[f].begin(), loops_[f].end());
        }
    }

    // Keeps what lies behind a plane. False when nothing is left.
    bool cut(const Point &normal, const Point &on) {
        const int n = static_cast<int>(points_.size());
        above_.resize(n);
        bool any_above = false, any_below = false;
        for (int i = 0; i < n; ++i) {
            above_[i] = dot(normal, points_[i] - on);
            any_above |= above_[i] > 0;
            any_below |= above_[i] <= 0;
        }
        if (!any_above) return true;
        if (!any_below) return false;
        edges_.clear();
        next_.clear();
        kept_.clear();
        for (const std::vector<int> &loop : loops_) cut_loop(loop, n);
        close(n);
        std::swap(loops_, kept_);
        return !loops_.empty();
    }

    double volume() const {
        double sum = 0;
        for (const std::vector<int> &loop : loops_)
            for (size_t k = 2; k < loop.size(); ++k)
                sum += dot(points_[loop[0]], cross(points_[loop[k - 1]], points_[loop[k]]));
        return sum / 6;
    }

private:
    struct Edge {
        int low, high, corner;
    };

    void cut_loop(const std::vector<int> &loop, int n) {
        std::vector<int> left;
        int leaves = -1, first_entry = -1;
        for (size_t k = 0; k < loop.size(); ++k) {
            const int from = loop[k], to = loop[(k + 1) % loop.size()];
            if (!(above_[from] > 0)) left.push_back(from);
            if ((above_[from] > 0) == (above_[to] > 0)) continue;
            const int corner = crossing(std::min(from, to), std::max(from, to));
            left.push_back(corner);
            if (above_[to] > 0) {
                leaves = corner;
            } else if (leaves < 0) {
                first_entry = corner;
            } else {
                link(corner, leaves, n);
                leaves = -1;
            }
        }
        if (first_entry >= 0) link(first_entry, leaves, n);
        if (left.size() > 2) kept_.push_back(std::move(left));
    }

    // The lid runs against the loops it closes: from where one is entered to where it was left.
    void link(int entry, int leave, int n) {
        next_.resize(points_.size() - n, -1);
        next_[entry - n] = leave;
    }

    int crossing(int low, int high) {
        for (const Edge &edge : edges_)
            if (edge.low == low && edge.high == high) return edge.corner;
        const double a = above_[low], b = above_[high];
        const Point &p = points_[low], &q = points_[high];
        const int corner = static_cast<int>(points_.size());
        points_.push_back(p + (q - p) * (a / (a - b)));
        edges_.push_back({low, high, corner});
        return corner;
    }

    void close(int n) {
        next_.resize(points_.size() - n, -1);
        for (size_t start = 0; start < next_.size(); ++start) {
            std::vector<int> lid;
            for (int at = static_cast<int>(start); at >= 0 && next_[at] >= 0;) {
                lid.push_back(at + n);
                const int to = next_[at] - n;
                next_[at] = -1;
                at = to;
            }
            if (lid.size() > 2) kept_.push_back(std::move(lid));
        }
    }

    std::vector<Point> points_;
    std::vector<std::vector<int>> loops_, kept_;
    std::vector<double> above_;
    std::vector<Edge> edges_;
    std::vector<int> next_;
};

double common_volume(const Box &a, const Box &b, Solid &solid) {
    if (!(a.volume > 0) || !(b.volume > 0) || apart(a, b)) return 0;
    const Point origin = (a.low + a.high) * 0.5;
    solid.begin(a, origin);
    for (const Plane &plane : b.planes)
        if (!solid.cut(plane.normal, plane.on - origin)) return 0;
    const double smaller = std::min(a.volume, b.volume);
    const double volume = std::min(solid.volume(), smaller);
    return volume > kTouch * smaller ? volume : 0;
}

std::vector<Box> read_boxes(const double *corners, int64_t n) {
    std::vector<Box> boxes;
    for (int64_t k = 0; k < n; ++k) boxes.push_back(read_box(corners + k * kCorners * 3));
    return boxes;
}

}  // namespace

// corners: (n, 8, 3). volume: (n,), 0 for flat boxes.
LW_API int32_t lw_box_volumes(const double *corners, int64_t n, double *volume) {
    for (int64_t k = 0; k < n; ++k) volume[k] = read_box(corners + k * kCorners * 3).volume;
    return kDone;
}

// corners: (n, 8, 3) and (m, 8, 3). iou: (n, m).
LW_API int32_t lw_box_ious(const double *corners, int64_t n, const double *others, int64_t m,
                           double *iou) try {
    const std::vector<Box> mine = read_boxes(corners, n), theirs = read_boxes(others, m);
    Solid solid;
    for (const Box &a : mine)
        for (const Box &b : theirs) {
            const double common = common_volume(a, b, solid);
            *iou++ = common > 0 ? common / (a.volume + b.volume - common) : 0;
        }
    return kDone;
} catch (const std::bad_alloc &) {
    return kNoMemory;
}
