// Average precision over many rankings of the same matches: bootstrap samples and tie orders.
// docs/protocols/ties.md says what both are. The NumPy formulation that these loops are held to,
// bit for bit, is in tests/evaluation/reference_resampling.py.

#include <cstddef>
#include <cstdint>
#include <new>
#include <vector>

#include "api.hpp"

namespace {

constexpr int kMostThresholds = 16;

// The numbers of true positives at which recall thresholds are first reached, ascending, and how
// many thresholds each reaches. In floating point as the evaluators compare: m / n >= threshold.
// Threshold 0, which is reached with none, is counted with the first.
struct Steps {
    std::vector<int32_t> n_true;
    std::vector<double> reached;
};

Steps steps_of(int32_t n_truths, const double *thresholds, int n_thresholds) {
    Steps steps;
    int32_t m = 1;
    for (int q = 0; q < n_thresholds; ++q) {
        const double wanted = thresholds[q];
        const double about = wanted * n_truths - 2.0;
        if (about > m) m = static_cast<int32_t>(about);
        while (m < n_truths && static_cast<double>(m) / n_truths < wanted) ++m;
        if (static_cast<double>(m) / n_truths < wanted) break;
        if (steps.n_true.empty() || steps.n_true.back() != m) {
            steps.n_true.push_back(m);
            steps.reached.push_back(0.0);
        }
        steps.reached.back() += 1.0;
    }
    return steps;
}

// Places of one curve: true positives and all that count, up to and with each of them.
struct Curve {
    std::vector<int32_t> n_true, n_all;
    std::vector<double> precision, best;
    std::size_t size = 0;

    void begin(std::size_t most) {
        // One more: a place is written before it is known to be one.
        if (n_true.size() < most + 1) {
            n_true.resize(most + 1);
            n_all.resize(most + 1);
            precision.resize(most + 1);
        }
        size = 0;
    }

    // 101-point average precision, times 101. Precision between two places only falls, and rises
    // between the copies of one detection, so nothing else is needed. Terms are added from the
    // top of the ranking down.
    double summed(const Steps &steps) {
        for (std::size_t k = 0; k < size; ++k)
            precision[k] = static_cast<double>(n_true[k]) / n_all[k];
        const int32_t found = size ? n_true[size - 1] : 0;
        std::size_t n_steps = 0;
        while (n_steps < steps.n_true.size() && steps.n_true[n_steps] <= found) ++n_steps;
        if (best.size() < n_steps) best.resize(n_steps);
        double highest = 0.0;
        std::size_t s = n_steps;
        for (std::size_t k = size; k-- > 0 && s > 0;) {
            highest = precision[k] > highest ? precision[k] : highest;
            const int32_t before = k ? n_true[k - 1] : 0;
            while (s > 0 && steps.n_true[s - 1] > before) best[--s] = highest;
        }
        double sum = 0.0;
        for (std::size_t i = 0; i < n_steps; ++i) sum += best[i] * steps.reached[i];
        return sum;
    }
};

}  // namespace

// One category and area. A block is a run of detections of one image and one score.
struct LwRanking {
    const int32_t *image;       // (D,)
    const int32_t *block_end;   // (D,) where each detection's block ends
    const uint16_t *is_true;    // (D,) bit t: a true positive at threshold t
    const uint16_t *is_ignored; // (D,) bit t: ignored at threshold t
    const int32_t *rank;        // (D,)
    int64_t detections;
    const double *recall_thresholds;
    int32_t n_recall_thresholds;
    int32_t n_thresholds;       // T
    const int32_t *ranks;       // (R,) recall counts true positives of a rank below each
    int32_t n_ranks;
};

namespace {

// Draws that go down a ranking side by side, one in each lane.
constexpr int kLanes = 16;

// A block that is not only false positives at every threshold.
struct Stop {
    int64_t from, to;
};

std::vector<Stop> stops_of(const LwRanking &ranking) {
    std::vector<Stop> stops;
    for (int64_t d = 0; d < ranking.detections;) {
        const int64_t end = ranking.block_end[d];
        unsigned special = 0;
        for (int64_t e = d; e < end; ++e) special |= ranking.is_true[e] | ranking.is_ignored[e];
        if (special) stops.push_back({d, end});
        d = end;
    }
    return stops;
}

// The detections of the stops, copy after copy: how often each draw has it there, and how many
// detections each draw has up to it and with it.
struct Drawn {
    std::vector<int64_t> detection;
    std::vector<int32_t> times, above;  // (rows, kLanes)

    void begin() {
        detection.clear();
        times.clear();
        above.clear();
    }

    void add(int64_t d, const int32_t *n, const int32_t *until) {
        detection.push_back(d);
        times.insert(times.end(), n, n + kLanes);
        above.insert(above.end(), until, until + kLanes);
    }
};

// counts: (images, kLanes)
void draw_stops(const LwRanking &ranking, const std::vector<Stop> &stops, const uint16_t *counts,
                Drawn &drawn) {
    int32_t above[kLanes] = {}, times[kLanes];
    drawn.begin();
    int64_t d = 0;
    for (const Stop &stop : stops) {
        for (; d < stop.from; ++d) {
            const uint16_t *count = counts + static_cast<int64_t>(ranking.image[d]) * kLanes;
            for (int lane = 0; lane < kLanes; ++lane) above[lane] += count[lane];
        }
        const uint16_t *count = counts + static_cast<int64_t>(ranking.image[d]) * kLanes;
        int32_t copies = 0;
        for (int lane = 0; lane < kLanes; ++lane) copies = count[lane] > copies ? count[lane] : copies;
        if (copies && stop.to - stop.from == 1) {
            for (int lane = 0; lane < kLanes; ++lane) {
                times[lane] = count[lane];
                above[lane] += times[lane];
            }
            drawn.add(d, times, above);
        } else {
            for (int32_t copy = 0; copy < copies; ++copy) {
                for (int lane = 0; lane < kLanes; ++lane) times[lane] = count[lane] > copy;
                for (int64_t e = stop.from; e < stop.to; ++e) {
                    for (int lane = 0; lane < kLanes; ++lane) above[lane] += times[lane];
                    drawn.add(e, times, above);
                }
            }
        }
        d = stop.to;
    }
}

// The curves of a threshold, a lane each, at every true positive's place. A lane that does not
// have one there stands still: its place says no more than the one before.
struct Curves {
    std::vector<int32_t> n_true;     // (places, kLanes)
    std::vector<double> precision;   // (places, kLanes), the highest from there on
    std::size_t size = 0;

    void trace(const LwRanking &ranking, const Drawn &drawn, int t) {
        const std::size_t rows = drawn.detection.size();
        if (n_true.size() < rows * kLanes) {
            n_true.resize(rows * kLanes);
            precision.resize(rows * kLanes);
        }
        int32_t found[kLanes] = {}, skipped[kLanes] = {};
        size = 0;
        for (std::size_t row = 0; row < rows; ++row) {
            const int64_t d = drawn.detection[row];
            const int32_t *times = &drawn.times[row * kLanes], *above = &drawn.above[row * kLanes];
            if ((ranking.is_true[d] >> t) & 1) {
                int32_t *n = &n_true[size * kLanes];
                double *p = &precision[size * kLanes];
                for (int lane = 0; lane < kLanes; ++lane) {
                    found[lane] += times[lane];
                    n[lane] = found[lane];
                    const int32_t all = above[lane] - skipped[lane];
                    p[lane] = static_cast<double>(found[lane]) / (all > 0 ? all : 1);
                }
                ++size;
            } else if ((ranking.is_ignored[d] >> t) & 1) {
                for (int lane = 0; lane < kLanes; ++lane) skipped[lane] += times[lane];
            }
        }
        for (std::size_t k = size; k-- > 1;) {
            const double *below = &precision[k * kLanes];
            double *p = &precision[(k - 1) * kLanes];
            for (int lane = 0; lane < kLanes; ++lane)
                p[lane] = p[lane] > below[lane] ? p[lane] : below[lane];
        }
    }

    int32_t found(int lane) const { return size ? n_true[(size - 1) * kLanes + lane] : 0; }

    // 101-point average precision of a lane, times 101. Precision between two places only falls,
    // and rises between the copies of one detection, so nothing else is needed. Terms are added
    // from the top of the ranking down.
    double summed(int lane, const Steps &steps) const {
        const int32_t most = found(lane);
        double sum = 0.0;
        std::size_t k = lane;
        for (std::size_t s = 0; s < steps.n_true.size() && steps.n_true[s] <= most; ++s) {
            while (n_true[k] < steps.n_true[s]) k += kLanes;
            sum += precision[k] * steps.reached[s];
        }
        return sum;
    }
};

// True positives at a threshold of a rank below a limit, in every lane.
void count_below(const LwRanking &ranking, const Drawn &drawn, int t, int32_t rank,
                 int32_t *counted) {
    for (int lane = 0; lane < kLanes; ++lane) counted[lane] = 0;
    for (std::size_t row = 0; row < drawn.detection.size(); ++row) {
        const int64_t d = drawn.detection[row];
        if (ranking.rank[d] < rank && ((ranking.is_true[d] >> t) & 1))
            for (int lane = 0; lane < kLanes; ++lane) counted[lane] += drawn.times[row * kLanes + lane];
    }
}

// Steps by number of truths, made when they are first asked for.
class StepsOf {
public:
    StepsOf(const int32_t *n_truths, int64_t draws, const double *thresholds, int n_thresholds)
        : thresholds_(thresholds), n_thresholds_(n_thresholds) {
        int32_t highest = lowest_ = n_truths[0];
        for (int64_t k = 0; k < draws; ++k) {
            lowest_ = n_truths[k] < lowest_ ? n_truths[k] : lowest_;
            highest = n_truths[k] > highest ? n_truths[k] : highest;
        }
        known_.resize(static_cast<std::size_t>(highest - lowest_) + 1);
    }

    const Steps &operator()(int32_t n_truths) {
        Steps &steps = known_[n_truths - lowest_];
        if (steps.n_true.empty()) steps = steps_of(n_truths, thresholds_, n_thresholds_);
        return steps;
    }

private:
    const double *thresholds_;
    int n_thresholds_;
    int32_t lowest_;
    std::vector<Steps> known_;
};

}  // namespace

LW_API int32_t lw_lanes() { return kLanes; }

// counts: (blocks of kLanes draws, images, kLanes) how often an image is in a draw; n_truths:
// (draws,), > 0. precision: (T, draws) average precision; recalled: (R, T, draws).
LW_API int32_t lw_resample(const LwRanking *ranking, const uint16_t *counts, int64_t draws,
                           int64_t images, const int32_t *n_truths, double *precision,
                           int32_t *recalled) try {
    const LwRanking &of = *ranking;
    if (of.n_thresholds > kMostThresholds) return kTooMany;
    if (draws < 1) return kDone;
    const std::vector<Stop> stops = stops_of(of);
    int32_t last_rank = 0;
    for (int64_t d = 0; d < of.detections; ++d)
        last_rank = of.rank[d] > last_rank ? of.rank[d] : last_rank;
    StepsOf steps(n_truths, draws, of.recall_thresholds, of.n_recall_thresholds);
    Drawn drawn;
    Curves curves;
    int32_t counted[kLanes];
    for (int64_t first = 0; first < draws; first += kLanes) {
        const int lanes = static_cast<int>(draws - first < kLanes ? draws - first : kLanes);
        draw_stops(of, stops, counts + first * images, drawn);
        for (int t = 0; t < of.n_thresholds; ++t) {
            curves.trace(of, drawn, t);
            const int64_t place = t * draws + first;
            for (int lane = 0; lane < lanes; ++lane)
                precision[place + lane] =
                    curves.summed(lane, steps(n_truths[first + lane])) / of.n_recall_thresholds;
            for (int r = 0; r < of.n_ranks; ++r) {
                if (of.ranks[r] > last_rank)
                    for (int lane = 0; lane < lanes; ++lane) counted[lane] = curves.found(lane);
                else
                    count_below(of, drawn, t, of.ranks[r], counted);
                for (int lane = 0; lane < lanes; ++lane)
                    recalled[r * of.n_thresholds * draws + place + lane] = counted[lane];
            }
        }
    }
    return kDone;
} catch (const std::bad_alloc &) {
    return kNoMemory;
}

// Average precision of one category in n orders of its S detections that are not a false positive
// at every threshold, averaged over the thresholds. order, plain: (n, S) which detection stands at
// each place, and how many false positives at every threshold stand above it.
LW_API int32_t lw_ordered(const uint16_t *is_true, const uint16_t *is_ignored, int64_t detections,
                          const int32_t *order, const int32_t *plain, int64_t n, int32_t n_truths,
                          const double *recall_thresholds, int32_t n_recall_thresholds,
                          int32_t n_thresholds, double *values) try {
    if (n_thresholds > kMostThresholds) return kTooMany;
    const Steps steps = steps_of(n_truths, recall_thresholds, n_recall_thresholds);
    Curve curve;
    std::vector<uint16_t> hits(detections), skips(detections);
    for (int64_t i = 0; i < n; ++i) {
        const int32_t *places = order + i * detections, *above = plain + i * detections;
        for (int64_t s = 0; s < detections; ++s) {
            hits[s] = is_true[places[s]];
            skips[s] = is_ignored[places[s]];
        }
        double sum = 0.0;
        for (int t = 0; t < n_thresholds; ++t) {
            curve.begin(detections);
            int32_t n_true = 0, skipped = 0;
            for (int64_t s = 0; s < detections; ++s) {
                const int32_t hit = (hits[s] >> t) & 1;
                n_true += hit;
                skipped += (skips[s] >> t) & 1;
                curve.n_true[curve.size] = n_true;
                curve.n_all[curve.size] = above[s] + static_cast<int32_t>(s) + 1 - skipped;
                curve.size += hit;
            }
            sum += curve.summed(steps) / n_recall_thresholds;
        }
        values[i] = sum / n_thresholds;
    }
    return kDone;
} catch (const std::bad_alloc &) {
    return kNoMemory;
}

LW_API const char *lw_source_hash() { return LEGOWORLD_SOURCE_HASH; }
