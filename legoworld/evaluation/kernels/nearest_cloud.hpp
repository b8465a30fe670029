// Points of a depth raster in leaves: those of one label in one tile, apart where depth jumps, each
// leaf in a box along its own plane. A plane's depth is linear in 1 / z, so the fit is closed form.

#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

struct LwGrid {
    double fx, fy, cx, cy;  // pixels; pixel (r, c) is sampled at (c + 0.5, r + 0.5)
    int32_t width, height;
    int32_t labels;  // points are compared within a label; label -1 takes no part
};

// One surface: planar z at each pixel, no point where it is not finite and positive; the label of
// each pixel; and a rigid motion (3 rows of 4) that its points go through, null for none.
struct LwSurface {
    LwGrid grid;
    const float *depth;
    const int32_t *label;
    const double *motion;
};

namespace nearest {

constexpr int kTile = 8, kNode = 8;  // pixels of a tile's side, tiles of a node's side
constexpr int kChunk = 16;             // points of a leaf that share a box
constexpr double kJump = 1.05;       // of neighbouring depths in a tile: two surfaces
// Boxes are larger than their points by more than rounding can make a distance.
constexpr double kSlack = 1e-12;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

struct Point {
    double x, y, z;
    float depth;    // before the motion: where it jumps is another surface
    int32_t index;  // row * width + column
};

// Boxes of leaves, field by field, so that a loop over leaves runs in lanes: a point p is inside
// where |axis[k] . (p - centre)| <= half[k] for k = 0, 1, 2.
struct Boxes {
    std::vector<double> centre[3], axis[3][3], half[3], radius;

    void resize(std::size_t n) {
        radius.resize(n);
        for (int k = 0; k < 3; ++k) {
            centre[k].resize(n);
            half[k].resize(n);
            for (auto &part : axis[k]) part.resize(n);
        }
    }
};

struct Leaf {
    int32_t label, node, begin, end;  // of points
    int32_t chunk;                    // its first
};

struct Bounds {
    double low[3], high[3];
};

constexpr Bounds kNowhere = {{kInfinity, kInfinity, kInfinity},
                             {-kInfinity, -kInfinity, -kInfinity}};

// Leaves [begin, end) of one label in one node, and the bounds of their points.
struct Node {
    int32_t begin, end;
    Bounds bounds;
};

struct Cloud {
    std::vector<double> x, y, z;
    std::vector<int32_t> index;
    std::vector<Leaf> leaves;         // by label, then node
    std::vector<Node> nodes;          // by label
    std::vector<int32_t> node_start;  // (labels + 1,)
    std::vector<int32_t> place;       // (height * width,) of a pixel's point, -1 for none
    const int32_t *label;             // (height * width,) the surface's own
    Boxes boxes;                      // of leaves
    std::vector<Bounds> chunks;       // of every kChunk points of a leaf, in its box's frame

    int64_t size() const { return static_cast<int64_t>(index.size()); }
};

inline int tiles_across(int pixels) { return (pixels + kTile - 1) / kTile; }

class Builder {
public:
    explicit Builder(const LwSurface &surface)
        : grid_(surface.grid), depth_(surface.depth), label_(surface.label),
          motion_(surface.motion) {
        const LwGrid &grid = surface.grid;
        ray_x_.resize(grid.width);
        ray_y_.resize(grid.height);
        for (int c = 0; c < grid.width; ++c) ray_x_[c] = (c + 0.5 - grid.cx) / grid.fx;
        for (int r = 0; r < grid.height; ++r) ray_y_[r] = (r + 0.5 - grid.cy) / grid.fy;
    }

    Cloud build() {
        const int across = tiles_across(grid_.width), down = tiles_across(grid_.height);
        reserve();
        int node = 0;
        for (int top = 0; top < down; top += kNode)
            for (int left = 0; left < across; left += kNode, ++node)
                for (int r = top; r < std::min(top + kNode, down); ++r)
                    for (int c = left; c < std::min(left + kNode, across); ++c)
                        add_tile(r, c, node);
        for (auto *values : {&cloud_.x, &cloud_.y, &cloud_.z}) values->resize(count_);
        cloud_.index.resize(count_);
        order_leaves();
        make_boxes();
        make_nodes();
        return std::move(cloud_);
    }

private:
    void reserve() {
        std::size_t pixels = static_cast<std::size_t>(grid_.width) * grid_.height;
        for (auto *values : {&cloud_.x, &cloud_.y, &cloud_.z}) values->resize(pixels);
        cloud_.index.resize(pixels);
        cloud_.place.assign(pixels, -1);
        cloud_.label = label_;
    }

    static int even_bits(int k) { return (k & 1) | (k >> 1 & 2) | (k >> 2 & 4); }

    // The tile's points in Morton order, so that neighbours in memory are neighbours.
    void add_tile(int tile_row, int tile_column, int node) {
        points_.clear();
        labels_.clear();
        int top = tile_row * kTile, left = tile_column * kTile;
        for (int k = 0; k < kTile * kTile; ++k) {
            int r = top + even_bits(k >> 1), c = left + even_bits(k);
            if (r < grid_.height && c < grid_.width) add_pixel(r, c);
        }
        while (!points_.empty()) {
            std::size_t others = 0;
            one_.clear();
            int32_t label = labels_[0];
            for (std::size_t k = 0; k < points_.size(); ++k)
                if (labels_[k] == label) {
                    one_.push_back(points_[k]);
                } else {
                    points_[others] = points_[k];
                    labels_[others++] = labels_[k];
                }
            points_.resize(others);
            labels_.resize(others);
            add_surfaces(label, node);
        }
    }

    void add_pixel(int row, int column) {
        int32_t index = row * grid_.width + column;
        float depth = depth_[index];
        int32_t label = label_[index];
        if (label < 0 || !(depth > 0.0f) || depth > std::numeric_limits<float>::max()) return;
        double z = depth, x = ray_x_[column] * z, y = ray_y_[row] * z;
        if (motion_ != nullptr) {
            const double *m = motion_;
            double moved[3];
            for (int d = 0; d < 3; ++d, m += 4) moved[d] = m[0] * x + m[1] * y + m[2] * z + m[3];
            x = moved[0], y = moved[1], z = moved[2];
        }
        points_.push_back({x, y, z, depth, index});
        labels_.push_back(label);
    }

    void add_surfaces(int32_t label, int node) {
        double low = kInfinity, high = 0.0;
        for (const Point &p : one_) {
            low = p.depth < low ? p.depth : low;
            high = p.depth > high ? p.depth : high;
        }
        double from = 0.0;
        if (high > low * kJump) {
            sorted_.clear();
            for (const Point &p : one_) sorted_.push_back(p.depth);
            std::sort(sorted_.begin(), sorted_.end());
            for (std::size_t k = 1; k < sorted_.size(); ++k)
                if (sorted_[k] > sorted_[k - 1] * kJump) {
                    add_leaf(label, node, from, sorted_[k]);
                    from = sorted_[k];
                }
        }
        add_leaf(label, node, from, kInfinity);
    }

    void add_leaf(int32_t label, int node, double from, double to) {
        auto begin = static_cast<int32_t>(count_);
        for (const Point &p : one_) {
            if (p.depth < from || p.depth >= to) continue;
            cloud_.place[p.index] = static_cast<int32_t>(count_);
            cloud_.x[count_] = p.x;
            cloud_.y[count_] = p.y;
            cloud_.z[count_] = p.z;
            cloud_.index[count_++] = p.index;
        }
        auto end = static_cast<int32_t>(count_);
        cloud_.leaves.push_back({label, node, begin, end, chunks_});
        chunks_ += (end - begin + kChunk - 1) / kChunk;
    }

    // Leaves were added node by node: by label alone, in the order they came.
    void order_leaves() {
        std::vector<int32_t> start(grid_.labels + 1, 0);
        for (const Leaf &leaf : cloud_.leaves) ++start[leaf.label + 1];
        for (int k = 0; k < grid_.labels; ++k) start[k + 1] += start[k];
        std::vector<Leaf> ordered(cloud_.leaves.size());
        for (const Leaf &leaf : cloud_.leaves) ordered[start[leaf.label]++] = leaf;
        cloud_.leaves = std::move(ordered);
    }

    void make_boxes() {
        cloud_.boxes.resize(cloud_.leaves.size());
        cloud_.chunks.resize(chunks_);
        for (std::size_t k = 0; k < cloud_.leaves.size(); ++k) make_box(k);
    }

    void make_box(std::size_t k) {
        const Leaf &leaf = cloud_.leaves[k];
        double axis[3][3];
        normal_of(leaf, axis[2]);
        double *n = axis[2];
        // The tangent across the picture, and the one down it.
        double scale = 1.0 / std::sqrt(n[0] * n[0] + n[2] * n[2]);
        if (!(scale < 1e6)) {
            n[0] = n[1] = 0.0;
            n[2] = scale = 1.0;
        }
        axis[0][0] = n[2] * scale, axis[0][1] = 0.0, axis[0][2] = -n[0] * scale;
        axis[1][0] = n[1] * axis[0][2];
        axis[1][1] = n[2] * axis[0][0] - n[0] * axis[0][2];
        axis[1][2] = -n[1] * axis[0][0];
        double centre[3] = {0.0, 0.0, 0.0}, size = 0.0;
        for (int32_t p = leaf.begin; p < leaf.end; ++p) {
            double most = std::abs(cloud_.z[p]) + std::abs(cloud_.x[p]) + std::abs(cloud_.y[p]);
            size = most > size ? most : size;
        }
        for (int a = 0; a < 3; ++a) {
            double low = kInfinity, high = -kInfinity;
            Bounds *chunk = &cloud_.chunks[leaf.chunk];
            for (int32_t p = leaf.begin; p < leaf.end; p += kChunk, ++chunk) {
                measure(axis[a], p, std::min(p + kChunk, leaf.end), chunk->low[a], chunk->high[a]);
                low = std::min(low, chunk->low[a]);
                high = std::max(high, chunk->high[a]);
            }
            double middle = 0.5 * (low + high);
            cloud_.boxes.half[a][k] = 0.5 * (high - low) + kSlack * size;
            for (Bounds *part = &cloud_.chunks[leaf.chunk]; part < chunk; ++part) {
                part->low[a] -= middle + kSlack * size;
                part->high[a] -= middle - kSlack * size;
            }
            for (int d = 0; d < 3; ++d) {
                centre[d] += middle * axis[a][d];
                cloud_.boxes.axis[a][d][k] = axis[a][d];
            }
        }
        double squared = 0.0;
        for (int d = 0; d < 3; ++d) {
            cloud_.boxes.centre[d][k] = centre[d];
            squared += cloud_.boxes.half[d][k] * cloud_.boxes.half[d][k];
        }
        cloud_.boxes.radius[k] = std::sqrt(squared);
    }

    // The extent of points along an axis.
    void measure(const double *axis, int32_t begin, int32_t end, double &low, double &high) const {
        low = kInfinity, high = -kInfinity;
        for (int32_t p = begin; p < end; ++p) {
            double at = axis[0] * cloud_.x[p] + axis[1] * cloud_.y[p] + axis[2] * cloud_.z[p];
            low = at < low ? at : low;
            high = at > high ? at : high;
        }
    }

    // The plane's, by least squares of 1 / z = n . (x / z, y / z, 1).
    void normal_of(const Leaf &leaf, double *n) const {
        const int32_t many = leaf.end - leaf.begin;
        double across[kTile * kTile], down[kTile * kTile], disparity[kTile * kTile];
        double u = 0, v = 0, d = 0;
        for (int32_t k = 0; k < many; ++k) {
            disparity[k] = 1.0 / cloud_.z[leaf.begin + k];
            across[k] = cloud_.x[leaf.begin + k] * disparity[k];
            down[k] = cloud_.y[leaf.begin + k] * disparity[k];
            u += across[k], v += down[k], d += disparity[k];
        }
        u /= many, v /= many, d /= many;
        double uu = 0, uv = 0, vv = 0, ud = 0, vd = 0;
        for (int32_t k = 0; k < many; ++k) {
            double du = across[k] - u, dv = down[k] - v, dd = disparity[k] - d;
            uu += du * du, uv += du * dv, vv += dv * dv, ud += du * dd, vd += dv * dd;
        }
        double det = uu * vv - uv * uv;
        n[0] = n[1] = 0.0;
        n[2] = 1.0;
        if (!(det > 1e-9 * (uu + vv) * (uu + vv))) return;
        double a = (ud * vv - vd * uv) / det, b = (vd * uu - ud * uv) / det;
        double c = d - a * u - b * v, length = std::sqrt(a * a + b * b + c * c);
        if (!(length > 0.0) || length > 1e100) return;
        n[0] = a / length, n[1] = b / length, n[2] = c / length;
    }

    void make_nodes() {
        const auto &leaves = cloud_.leaves;
        cloud_.node_start.assign(grid_.labels + 1, 0);
        for (std::size_t k = 0; k < leaves.size(); ++k) {
            bool same = k && leaves[k].label == leaves[k - 1].label &&
                        leaves[k].node == leaves[k - 1].node;
            if (!same) {
                auto at = static_cast<int32_t>(k);
                cloud_.nodes.push_back({at, at, kNowhere});
                ++cloud_.node_start[leaves[k].label + 1];
            }
            Node &node = cloud_.nodes.back();
            node.end = static_cast<int32_t>(k) + 1;
            for (int d = 0; d < 3; ++d) {
                double half = 0.0;
                for (int a = 0; a < 3; ++a)
                    half += std::abs(cloud_.boxes.axis[a][d][k]) * cloud_.boxes.half[a][k];
                double centre = cloud_.boxes.centre[d][k];
                node.bounds.low[d] = std::min(node.bounds.low[d], centre - half);
                node.bounds.high[d] = std::max(node.bounds.high[d], centre + half);
            }
        }
        for (int k = 0; k < grid_.labels; ++k) cloud_.node_start[k + 1] += cloud_.node_start[k];
    }

    const LwGrid &grid_;
    const float *depth_;
    const int32_t *label_;
    const double *motion_;
    std::vector<double> ray_x_, ray_y_, sorted_;
    std::size_t count_ = 0;
    int32_t chunks_ = 0;
    std::vector<Point> points_, one_;
    std::vector<int32_t> labels_;
    Cloud cloud_;
};

}  // namespace nearest
