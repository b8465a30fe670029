// Points of a depth raster in leaves: those of one label in one block of 4 x 4 pixels, apart where
// depth jumps. Sixteen points fill the lanes of a vector, and their box is as good as a plane's.

#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
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

constexpr int kSide = 4, kLeaf = kSide * kSide;  // pixels of a block's side, points of a leaf at most
constexpr int kNode = 8;                         // blocks of a node's side
constexpr float kJump = 1.05f;                   // of neighbouring depths in a block: two surfaces
constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Floats are kept within this, so that no square of theirs overflows. Points only come closer.
constexpr double kFarthest = 1e18;
// A float and a sum of two are off by less than this share.
constexpr float kOff = 0x1p-22f;
constexpr int32_t kTaken = INT32_MAX;  // behind the bits of any depth
constexpr int kBeyond = 32;  // what a vector may read behind the last element

inline float nearby(double v) {
    return static_cast<float>(v < -kFarthest ? -kFarthest : v > kFarthest ? kFarthest : v);
}

// Axis-aligned boxes, field by field, so that a loop over boxes runs in lanes.
struct Boxes {
    std::vector<float> low[3], high[3];

    void clear() {
        for (auto *side : {low, high})
            for (int d = 0; d < 3; ++d) side[d].clear();
    }

    void resize(std::size_t n) {
        for (auto *side : {low, high})
            for (int d = 0; d < 3; ++d) side[d].resize(n + kBeyond);
    }
};

struct Leaf {
    int32_t label, node, block, begin, end;  // of points
    float low[3], high[3];
};

struct Cloud {
    std::vector<double> x, y, z;  // a leaf's in raster order
    std::vector<float> near_x, near_y, near_z;  // the same as floats
    std::vector<int64_t> index;                 // of a point's pixel
    std::vector<Leaf> leaves;                   // by label, then node
    std::vector<Leaf> unordered;                // in the order they are made
    Boxes boxes, node_boxes;
    std::vector<int32_t> node_begin;            // of leaves; one more than nodes
    std::vector<int32_t> node_start;            // (labels + 1,) of nodes, by label
    std::vector<int32_t> first_leaf, next_leaf; // of a block, of the same block; -1 for none
    int32_t across, down;                       // blocks
};

inline int blocks_across(int pixels) { return (pixels + kSide - 1) / kSide; }

class Builder {
public:
    // The cloud's memory is used again.
    Builder(const LwSurface &surface, Cloud &cloud)
        : grid_(surface.grid), depth_(surface.depth), label_(surface.label),
          motion_(surface.motion), leaves_(cloud.unordered), cloud_(cloud) {
        ray_x_.resize(grid_.width);
        ray_y_.resize(grid_.height);
        for (int c = 0; c < grid_.width; ++c) ray_x_[c] = (c + 0.5 - grid_.cx) / grid_.fx;
        for (int r = 0; r < grid_.height; ++r) ray_y_[r] = (r + 0.5 - grid_.cy) / grid_.fy;
    }

    void build() {
        const int across = blocks_across(grid_.width), down = blocks_across(grid_.height);
        cloud_.across = across, cloud_.down = down;
        reserve(across * down);
        int node = 0;
        for (int top = 0; top < down; top += kNode)
            for (int left = 0; left < across; left += kNode, ++node)
                for (int r = top; r < std::min(top + kNode, down); ++r)
                    for (int c = left; c < std::min(left + kNode, across); ++c)
                        add_block(r, c, r * across + c, node);
        order_leaves();
        make_nodes();
        chain_blocks(across * down);
    }

private:
    void reserve(int blocks) {
        std::size_t pixels = static_cast<std::size_t>(grid_.width) * grid_.height;
        for (auto *values : {&cloud_.x, &cloud_.y, &cloud_.z}) values->resize(pixels + kBeyond);
        for (auto *values : {&cloud_.near_x, &cloud_.near_y, &cloud_.near_z})
            values->resize(pixels + kBeyond);
        cloud_.index.resize(pixels + kBeyond);
        leaves_.clear();
        leaves_.reserve(blocks + blocks / 4);
    }

    void add_block(int block_row, int block_column, int block, int node) {
        const int top = block_row * kSide, left = block_column * kSide;
        const int bottom = std::min(top + kSide, grid_.height);
        const int right = std::min(left + kSide, grid_.width);
        const int32_t label = label_[top * grid_.width + left];
        float low = std::numeric_limits<float>::infinity(), high = 0.0f;
        bool whole = label >= 0;
        for (int r = top; r < bottom; ++r)
            for (int c = left; c < right; ++c) {
                const int32_t index = r * grid_.width + c;
                const float depth = depth_[index];
                whole &= (label_[index] == label) & (depth > 0.0f);
                low = depth < low ? depth : low;
                high = depth > high ? depth : high;
            }
        if (!whole || high > std::numeric_limits<float>::max() || high > low * kJump)
            return add_parts(top, left, bottom, right, block, node);
        const auto begin = static_cast<int32_t>(count_);
        for (int r = top; r < bottom; ++r)
            for (int c = left; c < right; ++c) add_point(r, c);
        close_leaf(label, node, block, begin);
    }

    // What is of one label, between jumps of depth. Depths are positive: their bits are in the same
    // order, and of integers the least and the most are found in lanes.
    void add_parts(int top, int left, int bottom, int right, int block, int node) {
        int32_t depth[kLeaf], label[kLeaf], open[kLeaf];
        for (int k = 0; k < kLeaf; ++k) {
            const int r = top + k / kSide, c = left + k % kSide;
            depth[k] = label[k] = -1;
            if (r >= bottom || c >= right) continue;
            const float z = depth_[r * grid_.width + c];
            if (!(z > 0.0f && z <= std::numeric_limits<float>::max())) continue;
            depth[k] = bits(z);
            label[k] = label_[r * grid_.width + c];
        }
        for (int first = 0; first < kLeaf; ++first) {
            const int32_t of = label[first];
            if (of < 0) continue;
            for (int k = 0; k < kLeaf; ++k) {
                open[k] = label[k] == of ? depth[k] : kTaken;
                label[k] = label[k] == of ? -1 : label[k];
            }
            for (int32_t low = least(open); low != kTaken; low = least(open)) {
                const int32_t high = before_jump(open, low);
                const auto begin = static_cast<int32_t>(count_);
                for (int k = 0; k < kLeaf; ++k) {
                    if (open[k] > high) continue;
                    add_point(top + k / kSide, left + k % kSide);
                    open[k] = kTaken;
                }
                close_leaf(of, node, block, begin);
            }
        }
    }

    static int32_t bits(float v) {
        int32_t out;
        std::memcpy(&out, &v, sizeof out);
        return out;
    }

    static int32_t least(const int32_t *values) {
        int32_t out = kTaken;
        for (int k = 0; k < kLeaf; ++k) out = values[k] < out ? values[k] : out;
        return out;
    }

    // The last depth that is reached from `high` upwards without a jump.
    static int32_t before_jump(const int32_t *depths, int32_t high) {
        for (int32_t from = -1; from != high;) {
            from = high;
            float z;
            std::memcpy(&z, &from, sizeof z);
            const int32_t reach = bits(z * kJump);
            for (int k = 0; k < kLeaf; ++k) {
                const int32_t depth = depths[k] <= reach ? depths[k] : from;
                high = depth > high ? depth : high;
            }
        }
        return high;
    }

    void add_point(int row, int column) {
        const int32_t index = row * grid_.width + column;
        double z = depth_[index], x = ray_x_[column] * z, y = ray_y_[row] * z;
        if (motion_ != nullptr) {
            const double *m = motion_;
            double moved[3];
            for (int d = 0; d < 3; ++d, m += 4) moved[d] = m[0] * x + m[1] * y + m[2] * z + m[3];
            x = moved[0], y = moved[1], z = moved[2];
        }
        cloud_.x[count_] = x;
        cloud_.y[count_] = y;
        cloud_.z[count_] = z;
        cloud_.index[count_++] = index;
    }

    void close_leaf(int32_t label, int node, int block, int32_t begin) {
        const auto end = static_cast<int32_t>(count_);
        leaves_.push_back({label, node, block, begin, end, {}, {}});
        Leaf &leaf = leaves_.back();
        const std::vector<double> *from[3] = {&cloud_.x, &cloud_.y, &cloud_.z};
        std::vector<float> *to[3] = {&cloud_.near_x, &cloud_.near_y, &cloud_.near_z};
        for (int d = 0; d < 3; ++d) {
            const double *at = from[d]->data();
            float *near = to[d]->data();
            float low = std::numeric_limits<float>::infinity(), high = -low;
            for (int32_t p = begin; p < end; ++p) {
                near[p] = nearby(at[p]);
                low = near[p] < low ? near[p] : low;
                high = near[p] > high ? near[p] : high;
            }
            leaf.low[d] = low - std::abs(low) * kOff;
            leaf.high[d] = high + std::abs(high) * kOff;
        }
    }

    // Leaves were added node by node: by label alone, in the order they came.
    void order_leaves() {
        std::vector<int32_t> start(grid_.labels + 1, 0);
        for (const Leaf &leaf : leaves_) ++start[leaf.label + 1];
        for (int k = 0; k < grid_.labels; ++k) start[k + 1] += start[k];
        cloud_.leaves.resize(leaves_.size());
        for (const Leaf &leaf : leaves_) cloud_.leaves[start[leaf.label]++] = leaf;
        cloud_.boxes.resize(leaves_.size());
        for (std::size_t k = 0; k < cloud_.leaves.size(); ++k)
            for (int d = 0; d < 3; ++d) {
                cloud_.boxes.low[d][k] = cloud_.leaves[k].low[d];
                cloud_.boxes.high[d][k] = cloud_.leaves[k].high[d];
            }
    }

    // Leaves of one label in one node, and the box of their points.
    void make_nodes() {
        const auto &leaves = cloud_.leaves;
        cloud_.node_start.assign(grid_.labels + 1, 0);
        cloud_.node_begin.clear();
        cloud_.node_boxes.clear();
        for (std::size_t k = 0; k < leaves.size(); ++k) {
            const bool same = k && leaves[k].label == leaves[k - 1].label &&
                              leaves[k].node == leaves[k - 1].node;
            if (!same) {
                cloud_.node_begin.push_back(static_cast<int32_t>(k));
                ++cloud_.node_start[leaves[k].label + 1];
            }
            for (int d = 0; d < 3; ++d) {
                auto &low = cloud_.node_boxes.low[d], &high = cloud_.node_boxes.high[d];
                if (!same) {
                    low.push_back(leaves[k].low[d]);
                    high.push_back(leaves[k].high[d]);
                }
                low.back() = std::min(low.back(), leaves[k].low[d]);
                high.back() = std::max(high.back(), leaves[k].high[d]);
            }
        }
        cloud_.node_boxes.resize(cloud_.node_begin.size());
        cloud_.node_begin.push_back(static_cast<int32_t>(leaves.size()));
        for (int k = 0; k < grid_.labels; ++k) cloud_.node_start[k + 1] += cloud_.node_start[k];
    }

    void chain_blocks(int blocks) {
        cloud_.first_leaf.assign(blocks, -1);
        cloud_.next_leaf.resize(cloud_.leaves.size());
        for (std::size_t k = 0; k < cloud_.leaves.size(); ++k) {
            int32_t &first = cloud_.first_leaf[cloud_.leaves[k].block];
            cloud_.next_leaf[k] = first;
            first = static_cast<int32_t>(k);
        }
    }

    const LwGrid &grid_;
    const float *depth_;
    const int32_t *label_;
    const double *motion_;
    std::vector<double> ray_x_, ray_y_;
    std::vector<Leaf> &leaves_;
    std::size_t count_ = 0;
    Cloud &cloud_;
};

}  // namespace nearest
