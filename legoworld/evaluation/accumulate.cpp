// Average precision over many rankings of the same matches: bootstrap samples and tie orders.
// docs/protocols/ties.md says what both are. The NumPy formulation that these loops are held to,
// bit for bit, is in tests/evaluation/reference_resampling.py.

#include <cstddef>
#include <cstdint>
#include <new>
#include <unordered_map>
#include <vector>

#if defined(_WIN32)
#define LW_API extern "C" __declspec(dllexport)
#else
#define LW_API extern "C" __attribute__((visibility("default")))
#endif

namespace {

constexpr int kDone = 0, kNoMemory = 1, kTooMany = 2;
constexpr int kMostThresholds = 16;

int lowest_bit(unsigned bits) { return __builtin_ctz(bits); }

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

// 101-point average precision, times 101. n_all: detections that count, up to and with each true
// positive. Precision between two true positives only falls, so nothing else is needed. Terms are
// added from the top of the ranking down.
double summed_precision(const int32_t *n_all, int32_t n_found, const Steps &steps,
                        std::vector<double> &best) {
    std::size_t n_steps = 0;
    while (n_steps < steps.n_true.size() && steps.n_true[n_steps] <= n_found) ++n_steps;
    if (n_steps == 0) return 0.0;
    best.resize(n_steps);
    double highest = 0.0;
    int32_t until = n_found;
    for (std::size_t s = n_steps; s-- > 0;) {
        const int32_t first = steps.n_true[s];
        for (int32_t m = until; m >= first; --m) {
            const double precision = static_cast<double>(m) / n_all[m - 1];
            highest = precision > highest ? precision : highest;
        }
        until = first - 1;
        best[s] = highest;
    }
    double sum = 0.0;
    for (std::size_t s = 0; s < n_steps; ++s) sum += best[s] * steps.reached[s];
    return sum;
}

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

// What one draw has gone through so far.
struct Walk {
    const LwRanking &of;
    std::vector<int32_t> n_all[kMostThresholds];
    int32_t n_true[kMostThresholds];
    int32_t skipped[kMostThresholds];
    int32_t above;
    int32_t *recalled;  // (R, T, draws), at this draw
    int64_t draws;

    explicit Walk(const LwRanking &ranking) : of(ranking) {}

    void begin(int32_t most) {
        for (int t = 0; t < of.n_thresholds; ++t) {
            if (n_all[t].size() < static_cast<std::size_t>(most)) n_all[t].resize(most);
            n_true[t] = skipped[t] = 0;
        }
        above = 0;
    }

    // The detection, so many times in a row.
    void pass(int64_t d, int32_t times) {
        for (unsigned bits = of.is_true[d]; bits; bits &= bits - 1) {
            const int t = lowest_bit(bits);
            const int32_t before = above - skipped[t];
            int32_t *place = n_all[t].data() + n_true[t];
            for (int32_t c = 0; c < times; ++c) place[c] = before + c + 1;
            n_true[t] += times;
            for (int32_t r = 0; r < of.n_ranks; ++r)
                if (of.rank[d] < of.ranks[r]) recalled[(r * of.n_thresholds + t) * draws] += times;
        }
        for (unsigned bits = of.is_ignored[d]; bits; bits &= bits - 1)
            skipped[lowest_bit(bits)] += times;
        above += times;
    }
};

// Positions of what is not simply a false positive at every threshold, with the block it is in.
struct Stop {
    int64_t from, to;  // the detection alone, or its whole block where that has several
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

}  // namespace

// counts: (draws, images) how often an image is in a draw; n_truths: (draws,), > 0.
// precision: (T, draws) average precision; recalled: (R, T, draws), zeros on entry.
LW_API int32_t lw_resample(const LwRanking *ranking, const int32_t *counts, int64_t draws,
                           int64_t images, const int32_t *n_truths, double *precision,
                           int32_t *recalled) try {
    const LwRanking &of = *ranking;
    if (of.n_thresholds > kMostThresholds) return kTooMany;
    const std::vector<Stop> stops = stops_of(of);
    std::unordered_map<int32_t, Steps> steps;
    std::vector<double> best;
    Walk walk(of);
    walk.draws = draws;
    for (int64_t draw = 0; draw < draws; ++draw) {
        const int32_t *count = counts + draw * images;
        int64_t most = 0;
        for (const Stop &stop : stops) most += (stop.to - stop.from) * count[of.image[stop.from]];
        if (most > INT32_MAX) return kTooMany;
        walk.begin(static_cast<int32_t>(most));
        walk.recalled = recalled + draw;
        int64_t d = 0;
        for (const Stop &stop : stops) {
            int32_t plain = 0;
            for (; d < stop.from; ++d) plain += count[of.image[d]];
            walk.above += plain;
            const int32_t times = count[of.image[d]];
            if (stop.to - stop.from == 1) {
                if (times) walk.pass(d, times);
            } else {
                for (int32_t copy = 0; copy < times; ++copy)
                    for (int64_t e = stop.from; e < stop.to; ++e) walk.pass(e, 1);
            }
            d = stop.to;
        }
        auto known = steps.find(n_truths[draw]);
        if (known == steps.end())
            known = steps.emplace(n_truths[draw], steps_of(n_truths[draw], of.recall_thresholds,
                                                           of.n_recall_thresholds)).first;
        for (int t = 0; t < of.n_thresholds; ++t)
            precision[t * draws + draw] =
                summed_precision(walk.n_all[t].data(), walk.n_true[t], known->second, best) /
                of.n_recall_thresholds;
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
    std::vector<int32_t> n_all[kMostThresholds];
    for (int t = 0; t < n_thresholds; ++t) n_all[t].resize(detections);
    std::vector<double> best;
    for (int64_t i = 0; i < n; ++i) {
        int32_t n_true[kMostThresholds] = {}, skipped[kMostThresholds] = {};
        for (int64_t s = 0; s < detections; ++s) {
            const int32_t d = order[i * detections + s];
            const int32_t place = plain[i * detections + s] + static_cast<int32_t>(s) + 1;
            for (unsigned bits = is_true[d]; bits; bits &= bits - 1) {
                const int t = lowest_bit(bits);
                n_all[t][n_true[t]++] = place - skipped[t];
            }
            for (unsigned bits = is_ignored[d]; bits; bits &= bits - 1) ++skipped[lowest_bit(bits)];
        }
        double sum = 0.0;
        for (int t = 0; t < n_thresholds; ++t)
            sum += summed_precision(n_all[t].data(), n_true[t], steps, best) / n_recall_thresholds;
        values[i] = sum / n_thresholds;
    }
    return kDone;
} catch (const std::bad_alloc &) {
    return kNoMemory;
}

LW_API const char *lw_source_hash() { return LEGOWORLD_SOURCE_HASH; }
