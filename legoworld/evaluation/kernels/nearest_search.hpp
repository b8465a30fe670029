// The search, in lanes. Included by nearest.cpp once per instruction set, inside its namespace.

typedef double Vd __attribute__((vector_size(8 * LW_LANES)));
typedef int64_t Vm __attribute__((vector_size(8 * LW_LANES)));

constexpr int kLanes = LW_LANES;
constexpr int kGroup = kTile * kTile, kVectors = kGroup / kLanes;  // queries that share one list of leaves
// Squared distances of a bound and of a point differ by rounding, far less than this.
constexpr double kLooser = 1.0 + 1e-9;

constexpr int64_t kNone = INT64_MAX;

static inline bool any(Vm mask) {
#if defined(__x86_64__) && LW_LANES == 2
    return _mm_movemask_pd((__m128d)mask) != 0;
#elif defined(__x86_64__) && LW_LANES == 4
    return _mm256_movemask_pd((__m256d)mask) != 0;
#else
    for (int lane = 0; lane < kLanes; ++lane)
        if (mask[lane]) return true;
    return false;
#endif
}

static inline Vd beyond(Vd along, double half) {
    Vd out = (Vd)((Vm)along & INT64_MAX) - half;
    return out > 0.0 ? out : Vd{};
}

static inline Vd outside(Vd at, double low, double high) {
    Vd below = low - at, above = at - high;
    Vd out = below > above ? below : above;
    return out > 0.0 ? out : Vd{};
}

struct Group {
    Vd x[kVectors], y[kVectors], z[kVectors], best[kVectors];
    Vm index[kVectors];
    double middle[3], radius;  // every query is within radius of the middle

    double worst() const {
        Vd most = best[0];
        for (int v = 1; v < kVectors; ++v) most = best[v] > most ? best[v] : most;
        double out = most[0];
        for (int lane = 1; lane < kLanes; ++lane) out = most[lane] > out ? most[lane] : out;
        return out;
    }
};

// Leaves are left out for one of two reasons. Distance: a box is farther from the middle than the
// worst answer so far and the radius. Bisectors: let w be any target. Of a point x, and a query q
// at m + d with |d| <= r, |q - x|^2 - |q - w|^2 = |m - x|^2 - |m - w|^2 - 2 d . (x - w), so x can be
// nearer than w only where |m - x|^2 <= |m - w|^2 + 2 r |x - w|. With w near the answers this leaves
// the leaves about w, however far away all of them are.
class Search {
public:
    Search(const Cloud &queries, const Cloud &targets, Reach reach, double *squared,
           int32_t *index)
        : queries_(queries), targets_(targets), reach_(reach), squared_(squared), index_(index) {
        std::size_t n = targets.leaves.size();
        bound_.resize(n);
        excess_.resize(n);
        leaves_.resize(n);
    }

    void run() {
        int32_t label = -1;
        for (const Leaf &leaf : queries_.leaves) {
            if (leaf.label != label) near_ = -1;
            label = leaf.label;
            if (targets_.node_start[label] == targets_.node_start[label + 1]) continue;
            for (int32_t begin = leaf.begin; begin < leaf.end; begin += kGroup)
                answer(label, begin, std::min(begin + kGroup, leaf.end));
        }
    }

private:
    void answer(int32_t label, int32_t begin, int32_t end) {
        take(begin, end);
        seed(label, begin, end);
        if (group_.worst() == 0.0) return give(begin, end);  // no two pixels share a point
        choose();
        int32_t n = gather(label), first = 0;
        if (!n) return give(begin, end);
        for (int32_t k = 1; k < n; ++k)
            if (bound_[leaves_[k]] < bound_[leaves_[first]]) first = k;
        visit(leaves_[first]);
        choose();
        double reach = reach_of(group_.worst());
        for (int32_t k = 0; k < n; ++k) {
            int32_t leaf = leaves_[k];
            if (k == first || bound_[leaf] > reach || behind(leaf)) continue;
            if (visit(leaf)) reach = reach_of(group_.worst());
        }
        give(begin, end);
    }

    double reach_of(double worst_squared) const {
        double reach = std::sqrt(worst_squared) + group_.radius;
        return reach * reach * kLooser;
    }

    void take(int32_t begin, int32_t end) {
        double low[3] = {kInfinity, kInfinity, kInfinity};
        double high[3] = {-kInfinity, -kInfinity, -kInfinity};
        for (int k = 0; k < kGroup; ++k) {
            int32_t p = std::min(begin + k, end - 1);
            double at[3] = {queries_.x[p], queries_.y[p], queries_.z[p]};
            group_.x[k / kLanes][k % kLanes] = at[0];
            group_.y[k / kLanes][k % kLanes] = at[1];
            group_.z[k / kLanes][k % kLanes] = at[2];
            for (int d = 0; d < 3; ++d) {
                low[d] = at[d] < low[d] ? at[d] : low[d];
                high[d] = at[d] > high[d] ? at[d] : high[d];
            }
        }
        double across = 0.0, size = 0.0;
        for (int d = 0; d < 3; ++d) {
            group_.middle[d] = 0.5 * (low[d] + high[d]);
            across += (high[d] - low[d]) * (high[d] - low[d]);
            size += std::abs(group_.middle[d]);
        }
        group_.radius = across > 0.0 ? 0.5 * std::sqrt(across) * kLooser + kSlack * size : 0.0;
        for (int v = 0; v < kVectors; ++v) {
            // Nothing beyond reach is an answer; rounding must not make anything within it one.
            Vd most = group_.z[v] * reach_.of_z;
            most = most > reach_.least ? most : Vd{} + reach_.least;
            group_.best[v] = most * most * kLooser;
            group_.index[v] = Vm{} + kNone;
        }
    }

    void give(int32_t begin, int32_t end) const {
        for (int k = 0; k < end - begin; ++k) {
            if (group_.index[k / kLanes][k % kLanes] == kNone) continue;
            int32_t at = queries_.index[begin + k];
            squared_[at] = group_.best[k / kLanes][k % kLanes];
            index_[at] = static_cast<int32_t>(group_.index[k / kLanes][k % kLanes]);
        }
    }

    // The target at each query's own pixel where it is of its label, and the one that was near the group before.
    void seed(int32_t label, int32_t begin, int32_t end) {
        if (near_ < 0) near_ = targets_.leaves[targets_.nodes[targets_.node_start[label]].begin].begin;
        for (int v = 0; v < kVectors; ++v) {
            offer(v, near_);
            Vd x{}, y{}, z{};
            Vm index{};
            for (int lane = 0; lane < kLanes; ++lane) {
                int32_t p = std::min(begin + v * kLanes + lane, end - 1);
                int32_t pixel = queries_.index[p], own = targets_.place[pixel];
                int32_t target = own < 0 || targets_.label[pixel] != label ? near_ : own;
                x[lane] = targets_.x[target];
                y[lane] = targets_.y[target];
                z[lane] = targets_.z[target];
                index[lane] = targets_.index[target];
            }
            improve(v, x, y, z, index);
        }
    }

    bool improve(int v, Vd x, Vd y, Vd z, Vm index) {
        Vd dx = group_.x[v] - x, dy = group_.y[v] - y, dz = group_.z[v] - z;
        Vd squared = dx * dx + dy * dy + dz * dz;
        if (!any(squared <= group_.best[v])) return false;
        Vm better = (squared < group_.best[v]) |
                    ((squared == group_.best[v]) & (index < group_.index[v]));
        group_.best[v] = better ? squared : group_.best[v];
        group_.index[v] = better ? index : group_.index[v];
        return true;
    }

    bool offer(int v, int32_t p) {
        Vd none{};
        return improve(v, none + targets_.x[p], none + targets_.y[p], none + targets_.z[p],
                       Vm{} + targets_.index[p]);
    }

    double from_middle(int32_t p) const {
        double x = targets_.x[p] - group_.middle[0], y = targets_.y[p] - group_.middle[1],
               z = targets_.z[p] - group_.middle[2];
        return x * x + y * y + z * z;
    }

    // Of the answers so far the one nearest to the middle; the target before where there is none.
    void choose() {
        near_squared_ = from_middle(near_);
        for (int k = 0; k < kGroup; ++k) {
            int64_t index = group_.index[k / kLanes][k % kLanes];
            if (index == kNone) continue;
            int32_t p = targets_.place[index];
            double squared = from_middle(p);
            if (squared < near_squared_) {
                near_squared_ = squared;
                near_ = p;
            }
        }
    }

    bool behind(int32_t leaf) const {
        const Boxes &b = targets_.boxes;
        double x = targets_.x[near_] - b.centre[0][leaf], y = targets_.y[near_] - b.centre[1][leaf],
               z = targets_.z[near_] - b.centre[2][leaf];
        double apart = std::sqrt(x * x + y * y + z * z) + b.radius[leaf];
        return bound_[leaf] > (near_squared_ + 2.0 * group_.radius * apart) * kLooser;
    }

    // Leaves that may hold an answer, by the boxes of nodes and then their own.
    int32_t gather(int32_t label) {
        const double reach = reach_of(group_.worst());
        const double nx = targets_.x[near_], ny = targets_.y[near_], nz = targets_.z[near_];
        int32_t found = 0;
        for (int32_t n = targets_.node_start[label]; n < targets_.node_start[label + 1]; ++n) {
            const Node &node = targets_.nodes[n];
            double apart = 0.0, across = 0.0;
            const double near[3] = {nx, ny, nz};
            for (int d = 0; d < 3; ++d) {
                double below = node.bounds.low[d] - group_.middle[d];
                double above = group_.middle[d] - node.bounds.high[d];
                double out = below > above ? below : above;
                out = out > 0.0 ? out : 0.0;
                apart += out * out;
                double to_low = near[d] - node.bounds.low[d];
                double to_high = node.bounds.high[d] - near[d];
                double far = to_low > to_high ? to_low : to_high;
                across += far * far;
            }
            if (apart > reach) continue;
            if (apart > (near_squared_ + 2.0 * group_.radius * std::sqrt(across)) * kLooser)
                continue;
            measure(node.begin, node.end);
            for (int32_t k = node.begin; k < node.end; ++k) {
                leaves_[found] = k;
                found += bound_[k] <= reach && excess_[k] <= 0.0;
            }
        }
        return found;
    }

    // bound_: squared distance of the middle to a leaf's box; excess_: above 0 behind bisectors.
    void measure(int32_t begin, int32_t end) {
        const Boxes &b = targets_.boxes;
        const double mx = group_.middle[0], my = group_.middle[1], mz = group_.middle[2];
        const double wx = targets_.x[near_], wy = targets_.y[near_], wz = targets_.z[near_];
        const double most = near_squared_ * kLooser, twice = 2.0 * group_.radius * kLooser;
        const double *cx = b.centre[0].data(), *cy = b.centre[1].data(), *cz = b.centre[2].data();
        const double *ax = b.axis[0][0].data(), *az = b.axis[0][2].data();
        const double *bx = b.axis[1][0].data(), *by = b.axis[1][1].data(),
                     *bz = b.axis[1][2].data();
        const double *nx = b.axis[2][0].data(), *ny = b.axis[2][1].data(),
                     *nz = b.axis[2][2].data();
        const double *ha = b.half[0].data(), *hb = b.half[1].data(), *hn = b.half[2].data();
        const double *radius = b.radius.data();
        double *__restrict__ bound = bound_.data();
        double *__restrict__ excess = excess_.data();
        for (int32_t k = begin; k < end; ++k) {
            double x = mx - cx[k], y = my - cy[k], z = mz - cz[k];
            double along_a = std::abs(ax[k] * x + az[k] * z) - ha[k];
            double along_b = std::abs(bx[k] * x + by[k] * y + bz[k] * z) - hb[k];
            double along_n = std::abs(nx[k] * x + ny[k] * y + nz[k] * z) - hn[k];
            along_a = along_a > 0.0 ? along_a : 0.0;
            along_b = along_b > 0.0 ? along_b : 0.0;
            along_n = along_n > 0.0 ? along_n : 0.0;
            double squared = along_a * along_a + along_b * along_b + along_n * along_n;
            x = wx - cx[k], y = wy - cy[k], z = wz - cz[k];
            double apart = std::sqrt(x * x + y * y + z * z) + radius[k];
            bound[k] = squared;
            excess[k] = squared - (most + twice * apart);
        }
    }

    // Whether a leaf held anything nearer for any query.
    bool visit(int32_t leaf) {
        const Boxes &b = targets_.boxes;
        bool nearer = false;
        for (int v = 0; v < kVectors; ++v) {
            Vd x = group_.x[v] - b.centre[0][leaf], y = group_.y[v] - b.centre[1][leaf],
               z = group_.z[v] - b.centre[2][leaf];
            Vd along[3], bound{};
            for (int a = 0; a < 3; ++a) {
                along[a] = x * b.axis[a][0][leaf] + y * b.axis[a][1][leaf] +
                           z * b.axis[a][2][leaf];
                Vd out = beyond(along[a], b.half[a][leaf]);
                bound += out * out;
            }
            if (any(bound <= group_.best[v] * kLooser)) nearer |= scan(leaf, v, along);
        }
        return nearer;
    }

    // along: the queries in the frame of the leaf's box.
    bool scan(int32_t leaf, int v, const Vd *along) {
        const Leaf &all = targets_.leaves[leaf];
        bool nearer = false;
        const Bounds *chunk = &targets_.chunks[all.chunk];
        for (int32_t begin = all.begin; begin < all.end; begin += kChunk, ++chunk) {
            Vd bound{};
            for (int a = 0; a < 3; ++a) {
                Vd out = outside(along[a], chunk->low[a], chunk->high[a]);
                bound += out * out;
            }
            if (!any(bound <= group_.best[v] * kLooser)) continue;
            int32_t end = begin + kChunk < all.end ? begin + kChunk : all.end;
            for (int32_t p = begin; p < end; ++p) nearer |= offer(v, p);
        }
        return nearer;
    }

    const Cloud &queries_, &targets_;
    const Reach reach_;
    double *squared_;
    int32_t *index_;
    std::vector<double> bound_, excess_;
    std::vector<int32_t> leaves_;
    Group group_;
    int32_t near_ = -1;  // a target near the group
    double near_squared_ = kInfinity;
};
