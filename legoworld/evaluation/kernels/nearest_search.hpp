// The search, in lanes. Included by nearest.cpp behind nearest_lanes.hpp.

// Sixteen queries of one leaf; lanes behind the last repeat it.
struct alignas(64) Group {
    double x[kLeaf], y[kLeaf], z[kLeaf], best[kLeaf];
    int64_t index[kLeaf];
    float near_x[kLeaf], near_y[kLeaf], near_z[kLeaf], slack[kLeaf];
    float known[kLeaf];  // what an answer's squared distance in floats is within
    float least[kLeaf];  // squared distance in floats so far
    float limit[kLeaf];  // what anything is within that would change what is asked
    float low[3], high[3], middle[3], radius;
};

// A leaf that was looked at: the least squared distance of each query in floats.
struct alignas(64) Visit {
    float least[kLeaf];
    int32_t leaf;
};

// Everything is measured in floats first: which leaf may hold whose answer is known when the last
// one is done, and only those are measured in float64. The search walks from the leaf that held the
// neighbours' answers to the leaf whose neighbours hold nothing nearer, then looks at all others
// that may. Boxes are left out for one of two reasons. Distance: a box is farther from the queries'
// box than the worst answer so far. Bisectors: let w be any target. Of a point x, and a query q at
// m + d with |d| <= r, |q - x|^2 - |q - w|^2 = |m - x|^2 - |m - w|^2 - 2 d . (x - w), so x can be
// nearer than w only where |m - x|^2 <= |m - w|^2 + 2 r |x - w|. With w near the answers this leaves
// the boxes about w, however far away all of them are.
class Search {
public:
    Search(const Cloud &queries, const Cloud &targets, const Asked &asked, const Told &told)
        : queries_(queries), targets_(targets), asked_(asked), told_(told),
          seen_(targets.leaves.size(), -1) {}

    void run() {
        int32_t label = -1;
        for (const Leaf &leaf : queries_.leaves) {
            const int32_t first = targets_.node_start[leaf.label];
            if (first == targets_.node_start[leaf.label + 1]) continue;
            if (leaf.label != label) near_ = targets_.node_begin[first];
            label = leaf.label;
            answer(leaf);
            ++group_number_;
        }
    }

private:
    void answer(const Leaf &leaf) {
        take(leaf);
        visits_.clear();
        visit_block(leaf.block, leaf.label);
        if (told_.hits == nullptr && visits_.size() == 1 && same()) return give(leaf);
        visit(near_);
        if (worst() >= 0.0f) walk(leaf.label);
        if (worst() >= 0.0f) gather(leaf.label);
        if (told_.hits != nullptr) return count(leaf.label, leaf.end - leaf.begin);
        for (const Visit &visit : visits_) measure(visit, kEvery);
        give(leaf);
    }

    void take(const Leaf &leaf) {
        const int count = leaf.end - leaf.begin;
        fill(group_.x, queries_.x, leaf.begin, count);
        fill(group_.y, queries_.y, leaf.begin, count);
        fill(group_.z, queries_.z, leaf.begin, count);
        fill(group_.near_x, queries_.near_x, leaf.begin, count);
        fill(group_.near_y, queries_.near_y, leaf.begin, count);
        fill(group_.near_z, queries_.near_z, leaf.begin, count);
        for (double &best : group_.best) best = asked_.count ? 0.0 : kInfinity;
        for (int t = 0; t < asked_.count; ++t)
            for (int k = 0; k < kLeaf; ++k) {
                double most = asked_.reach_of_z[t] * group_.z[k] + asked_.reach[t];
                group_.best[k] = most > group_.best[k] ? most : group_.best[k];
            }
        for (int k = 0; k < kLeaf; ++k) {
            group_.best[k] *= group_.best[k] * kFloatTolerance;
            group_.index[k] = kNone;
            float s = kOff * (std::abs(group_.near_x[k]) + std::abs(group_.near_y[k]) +
                              std::abs(group_.near_z[k]));
            group_.slack[k] = s * s * kSlackly + kLeast;
            group_.known[k] = static_cast<float>(group_.best[k]) * kFloatly + group_.slack[k];
            group_.limit[k] = group_.known[k];
            group_.least[k] = kInf;
        }
        worst_known_ = false;
    }

    template <typename T>
    static void fill(T *lanes, const std::vector<T> &values, int32_t begin, int count) {
        std::copy_n(values.data() + begin, kLeaf, lanes);
        for (int k = count; k < kLeaf; ++k) lanes[k] = lanes[count - 1];
    }

    void give(const Leaf &leaf) {
        const int many = leaf.end - leaf.begin;
        for (int k = 0; k < many; ++k) {
            if (group_.index[k] == kNone) continue;
            const int64_t at = queries_.index[leaf.begin + k];
            told_.squared[at] = group_.best[k];
            told_.index[at] = static_cast<int32_t>(group_.index[k]);
        }
    }

    // Answers within each tolerance: by floats where their bounds decide all, else in float64.
    void count(int32_t label, int many) {
        const unsigned every = (1u << many) - 1u;
        unsigned hit[kMostTolerances], unclear = 0;
        for (int t = 0; t < asked_.count; ++t) {
            unsigned possible = 0;
            hit[t] = 0;
            for (int h = 0; h < kHalves; ++h) {
                const Bounds tau = bounds(at<Vf>(group_.known, h), t, h);
                const Vf most = tau.high * tau.high * kFloatly + at<Vf>(group_.slack, h);
                hit[t] |= within(tau.distance, tau.low) << (h * kFloats);
                possible |= within(at<Vf>(group_.least, h), most) << (h * kFloats);
            }
            unclear |= possible & ~hit[t];
        }
        unclear &= every;
        int64_t *hits = told_.hits + static_cast<int64_t>(label) * asked_.count;
        for (int t = 0; t < asked_.count; ++t)
            hits[t] += __builtin_popcount(hit[t] & every & ~unclear);
        if (!unclear) return;
        for (const Visit &visit : visits_) measure(visit, unclear);
        count_measured(hits, unclear);
    }

    // Of the queries `open`, by the reference point's own depth.
    void count_measured(int64_t *hits, unsigned open) {
        alignas(64) double distance[kLeaf], z[kLeaf];  // vectors are read of them
        for (int k = 0; k < kLeaf; ++k) {
            const bool none = !(open >> k & 1u) || group_.index[k] == kNone;
            z[k] = asked_.moving == 0.0f || none ? group_.z[k] : told_.depth[group_.index[k]];
            distance[k] = none ? kInfinity : group_.best[k];
        }
        for (int v = 0; v < kVectors; ++v) at<Vd>(distance, v) = root(at<Vd>(distance, v));
        for (int t = 0; t < asked_.count; ++t) {
            int64_t found = 0;
            for (int k = 0; k < kLeaf; ++k)
                found += distance[k] <= asked_.of_z[t] * z[k] + asked_.at_least[t];
            hits[t] += found;
        }
    }

    // The largest limit; below 0 where everything that is asked is known.
    float worst() {
        if (!worst_known_) {
            Vf most = at<Vf>(group_.limit, 0);
            for (int h = 1; h < kHalves; ++h) most = larger(most, at<Vf>(group_.limit, h));
            worst_ = -lowest(-most);
            worst_known_ = true;
        }
        return worst_;
    }

    // Whether each query is a target, too: no two pixels share a point.
    bool same() {
        for (float least : visits_[0].least)
            if (least > 0.0f) return false;
        measure(visits_[0], kEvery);
        for (double best : group_.best)
            if (best > 0.0) return false;
        return true;
    }

    void visit_block(int32_t block, int32_t label) {
        for (int32_t k = targets_.first_leaf[block]; k >= 0; k = targets_.next_leaf[k])
            if (targets_.leaves[k].label == label) visit(k);
    }

    // The leaf nearest to a query in the middle, of those visited.
    bool nearest_leaf() {
        float least = kInf;
        for (const Visit &visit : visits_)
            if (visit.least[kSide + 1] < least) {
                least = visit.least[kSide + 1];
                near_ = visit.leaf;
            }
        return !visits_.empty();
    }

    void walk(int32_t label) {
        int32_t from = -1;
        for (int step = 0; step < kSteps && nearest_leaf() && near_ != from; ++step) {
            from = near_;
            const int32_t block = targets_.leaves[near_].block;
            const int32_t row = block / targets_.across, column = block % targets_.across;
            for (int32_t r = row - 1; r <= row + 1; ++r)
                for (int32_t c = column - 1; c <= column + 1; ++c)
                    if (r >= 0 && r < targets_.down && c >= 0 && c < targets_.across)
                        visit_block(r * targets_.across + c, label);
        }
    }

    // A leaf, where its box may hold anything nearer for any query.
    void visit(int32_t k) {
        if (seen_[k] == group_number_) return;
        seen_[k] = group_number_;
        const Leaf &leaf = targets_.leaves[k];
        unsigned open = 0;
        for (int h = 0; h < kHalves; ++h) {
            Vf bound = outside(at<Vf>(group_.near_x, h), leaf.low[0], leaf.high[0]) +
                       outside(at<Vf>(group_.near_y, h), leaf.low[1], leaf.high[1]) +
                       outside(at<Vf>(group_.near_z, h), leaf.low[2], leaf.high[2]);
            open |= within(bound, at<Vf>(group_.limit, h)) << (h * kFloats);
        }
        if (!open) return;
        visits_.emplace_back();
        Visit &visit = visits_.back();
        visit.leaf = k;
        if (__builtin_popcount(open) > kFew) {
            for (int h = 0; h < kHalves; ++h) at<Vf>(visit.least, h) = least_of(leaf, h);
        } else {
            Vf least[kHalves];
            for (Vf &half : least) half = splat(kInf);
            for (; open; open &= open - 1) {
                const int lane = __builtin_ctz(open);
                const Vf one = splat(least_of_one(leaf, lane));
                for (int h = 0; h < kHalves; ++h)
                    least[h] = lane_numbers(h) == static_cast<float>(lane) ? one : least[h];
            }
            for (int h = 0; h < kHalves; ++h) at<Vf>(visit.least, h) = least[h];
        }
        for (int h = 0; h < kHalves; ++h) {
            const Vf least = at<Vf>(visit.least, h), before = at<Vf>(group_.known, h);
            const Vf known = smaller(before, least * (kFloatly * kFloatly) +
                                                 at<Vf>(group_.slack, h) * 2.1f);
            at<Vf>(group_.least, h) = smaller(at<Vf>(group_.least, h), least);
            if (within(before, known) == kAll) continue;
            at<Vf>(group_.known, h) = known;
            at<Vf>(group_.limit, h) = asked_.count ? undecided(known, h) : known;
            worst_known_ = false;
        }
    }

    static Vf lane_numbers(int h) { return loaded(kNumbers + h * kFloats); }

    // An answer is within `distance`, so its depth is within that of the query's, and a tolerance
    // between its values at both ends. Shares of 1e-3 and 1e-4 are far more than rounding.
    struct Bounds {
        Vf distance, low, high;
    };

    Bounds bounds(Vf known, int tolerance, int h) const {
        const Vf z = at<Vf>(group_.near_z, h), d = root(known);
        const Vf low = z - larger(z, -z) * 1e-4f - d * asked_.moving;
        const Vf high = z + larger(z, -z) * 1e-4f + d * asked_.moving;
        const float share = asked_.relative[tolerance], least = asked_.absolute[tolerance];
        return {d, (low * share + least) * 0.999f, (high * share + least) * 1.001f};
    }

    // What of `known` may change a hit: tolerances that are hits at both ends are decided, and so
    // is what the others miss at both.
    Vf undecided(Vf known, int h) const {
        const Vf nothing = Vf{} - 1.0f;  // a tolerance of 0 is one that may be open, too
        Vf most = nothing;
        for (int k = 0; k < asked_.count; ++k) {
            const Bounds tau = bounds(known, k, h);
            most = larger(most, tau.distance <= tau.low ? nothing : tau.high);
        }
        const Vf limit = smaller(known, most * most * kFloatly + at<Vf>(group_.slack, h));
        return most >= 0.0f ? limit : nothing;
    }

    Vf least_of(const Leaf &leaf, int h) const {
        const Vf x = at<Vf>(group_.near_x, h), y = at<Vf>(group_.near_y, h),
                 z = at<Vf>(group_.near_z, h);
        Vf least = splat(kInf);
        for (int32_t p = leaf.begin; p < leaf.end; ++p) {
            Vf dx = x - targets_.near_x[p], dy = y - targets_.near_y[p],
               dz = z - targets_.near_z[p];
            least = smaller(least, dx * dx + dy * dy + dz * dz);
        }
        return least;
    }

    float least_of_one(const Leaf &leaf, int lane) const {
        const float *behind = kBehind + kLeaf - (leaf.end - leaf.begin);
        Vf least = splat(kInf);
        for (int p = 0; p < kLeaf; p += kFloats) {
            Vf dx = group_.near_x[lane] - loaded(targets_.near_x.data() + leaf.begin + p),
               dy = group_.near_y[lane] - loaded(targets_.near_y.data() + leaf.begin + p),
               dz = group_.near_z[lane] - loaded(targets_.near_z.data() + leaf.begin + p);
            least = smaller(least, dx * dx + dy * dy + dz * dz + loaded(behind + p));
        }
        return lowest(least);
    }

    // In float64, for the queries of which the leaf may hold the answer.
    void measure(const Visit &visit, unsigned queries) {
        const Leaf &leaf = targets_.leaves[visit.leaf];
        for (int h = 0; h < kHalves; ++h) {
            unsigned open = within(at<Vf>(visit.least, h), at<Vf>(group_.known, h)) &
                            queries >> (h * kFloats);
            if (open & ((1u << kLanes) - 1u)) scan(2 * h, leaf.begin, leaf.end);
            if (open >> kLanes) scan(2 * h + 1, leaf.begin, leaf.end);
        }
    }

    // Points of a leaf are in raster order, so the first of the least is the lowest.
    void scan(int v, int32_t begin, int32_t end) {
        const Vd x = at<Vd>(group_.x, v), y = at<Vd>(group_.y, v), z = at<Vd>(group_.z, v);
        Vd squared[kLeaf], least = Vd{} + kInfinity;
        for (int32_t p = begin; p < end; ++p) {
            Vd dx = x - targets_.x[p], dy = y - targets_.y[p], dz = z - targets_.z[p];
            Vd one = dx * dx + dy * dy + dz * dz;
            squared[p - begin] = one;
            least = smaller(least, one);
        }
        Vm place{};
        for (int32_t p = end - 1; p >= begin; --p)
            place = squared[p - begin] == least ? Vm{} + targets_.index[p] : place;
        const Vd best = at<Vd>(group_.best, v);
        const Vm index = at<Vm>(group_.index, v);
        const Vm better = (least < best) | ((least == best) & (place < index));
        at<Vd>(group_.best, v) = better ? least : best;
        at<Vm>(group_.index, v) = better ? place : index;
    }

    template <typename From, typename Side>
    static Vf outside(From from, Side low, Side high) {
        Vf out = larger(larger(low - from, from - high), Vf{});
        return out * out;
    }

    // The box of those queries of which anything is undecided.
    void enclose() {
        const float *from[3] = {group_.near_x, group_.near_y, group_.near_z};
        float squared = 0.0f;
        for (int d = 0; d < 3; ++d) {
            Vf low = splat(kInf), high = splat(-kInf);
            for (int h = 0; h < kHalves; ++h) {
                const Vf at = Search::at<Vf>(from[d], h), limit = Search::at<Vf>(group_.limit, h);
                low = smaller(low, limit >= 0.0f ? at : splat(kInf));
                high = larger(high, limit >= 0.0f ? at : splat(-kInf));
            }
            const float least = lowest(low), most = -lowest(-high);
            group_.low[d] = least - std::abs(least) * kOff;
            group_.high[d] = most + std::abs(most) * kOff;
            group_.middle[d] = 0.5f * (least + most);
            float half = 0.5f * (group_.high[d] - group_.low[d]) + kOff * std::abs(group_.middle[d]);
            squared += half * half;
        }
        group_.radius = std::sqrt(squared) * kFloatly;
    }

    // Leaves that may hold an answer, by the boxes of nodes and then their own.
    void gather(int32_t label) {
        enclose();
        bisect();
        each_near(targets_.node_boxes, targets_.node_start[label], targets_.node_start[label + 1],
                  [this](int32_t node) {
                      each_near(targets_.boxes, targets_.node_begin[node],
                                targets_.node_begin[node + 1],
                                [this](int32_t leaf) { visit(leaf); });
                  });
    }

    void bisect() {
        const Leaf &leaf = targets_.leaves[near_];
        const int32_t p = (leaf.begin + leaf.end) / 2;
        const float to[3] = {targets_.near_x[p], targets_.near_y[p], targets_.near_z[p]};
        float squared = 0.0f, size = 0.0f;
        for (int d = 0; d < 3; ++d) {
            chosen_[d] = to[d];
            float apart = group_.middle[d] - to[d];
            squared += apart * apart;
            size += std::abs(group_.middle[d]) + std::abs(to[d]);
        }
        // Not worth its time where the queries are as far apart as their answers.
        far_ = squared > 16.0f * group_.radius * group_.radius;
        chosen_squared_ = squared * (1.0f + 2e-5f) + 1.1e5f * kOff * kOff * size * size + kLeast;
    }

    template <typename Take>
    void each_near(const Boxes &boxes, int32_t begin, int32_t end, Take take) {
        for (int32_t k = begin; k < end; k += kFloats) {
            Vf bound{};
            Vf low[3], high[3];
            for (int d = 0; d < 3; ++d) {
                low[d] = loaded(boxes.low[d].data() + k);
                high[d] = loaded(boxes.high[d].data() + k);
                Vf out = larger(larger(low[d] - group_.high[d], group_.low[d] - high[d]), Vf{});
                bound += out * out;
            }
            unsigned near = within(bound, splat(worst()));
            if (end - k < kFloats) near &= (1u << (end - k)) - 1u;
            if (near && far_) near &= before_bisectors(low, high);
            if (near) near = for_some_query(low, high, near);
            for (; near; near &= near - 1) take(k + __builtin_ctz(near));
        }
    }

    // Of the boxes `near` the ones that any open query is near, where asking so takes less than
    // looking at each box.
    unsigned for_some_query(const Vf *low, const Vf *high, unsigned near) const {
        unsigned open = 0, out = 0;
        for (int h = 0; h < kHalves; ++h)
            open |= within(Vf{}, at<Vf>(group_.limit, h)) << (h * kFloats);
        if (__builtin_popcount(open) > __builtin_popcount(near) * kHalves) return near;
        for (; open; open &= open - 1) {
            const int lane = __builtin_ctz(open);
            out |= within(outside(group_.near_x[lane], low[0], high[0]) +
                              outside(group_.near_y[lane], low[1], high[1]) +
                              outside(group_.near_z[lane], low[2], high[2]),
                          splat(group_.limit[lane]));
        }
        return near & out;
    }

    // Where |m - x|^2 <= |m - w|^2 + 2 r |x - w|, squared once more to do without a root.
    unsigned before_bisectors(const Vf *low, const Vf *high) const {
        Vf squared{}, across{};
        for (int d = 0; d < 3; ++d) {
            Vf out = larger(larger(low[d] - group_.middle[d], group_.middle[d] - high[d]), Vf{});
            squared += out * out;
            Vf most = larger(chosen_[d] - low[d], high[d] - chosen_[d]);
            across += most * most;
        }
        Vf excess = larger(squared - chosen_squared_, Vf{});
        const float twice = 2.0f * group_.radius * kFloatly;
        return within(excess * excess, twice * twice * across * kFloatly);
    }

    template <typename V, typename T>
    static V &at(T *values, int vector) {
        return reinterpret_cast<V *>(values)[vector];
    }

    template <typename V, typename T>
    static const V &at(const T *values, int vector) {
        return reinterpret_cast<const V *>(values)[vector];
    }

    const Cloud &queries_, &targets_;
    const Asked asked_;
    const Told told_;
    std::vector<int32_t> seen_;  // the last group that looked at each leaf
    std::vector<Visit> visits_;
    Group group_;
    int32_t group_number_ = 0;
    int32_t near_ = -1;    // a leaf near the group
    float worst_ = 0.0f;   // of the limits
    bool worst_known_ = false;
    float chosen_[3] = {}, chosen_squared_ = 0.0f;  // w of the bisectors
    bool far_ = false;
};
