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

// The detections of one draw's stops, copy after copy, each with all that stands above its end.
struct Drawn {
    std::vector<int32_t> times, above, rank;
    std::vector<uint16_t> is_true, is_ignored;
    std::size_t size = 0;

    void begin(std::size_t most) {
        if (times.size() < most) {
            for (std::vector<int32_t> *column : {&times, &above, &rank}) column->resize(most);
            for (std::vector<uint16_t> *column : {&is_true, &is_ignored}) column->resize(most);
        }
        size = 0;
    }

    void add(const LwRanking &ranking, int64_t d, int32_t n, int32_t until) {
        times[size] = n;
        above[size] = until;
        rank[size] = ranking.rank[d];
        is_true[size] = ranking.is_true[d];
        is_ignored[size] = ranking.is_ignored[d];
        ++size;
    }
};

void draw_stops(const LwRanking &ranking, const std::vector<Stop> &stops, const int32_t *count,
                Drawn &drawn) {
    int32_t above = 0;
    int64_t d = 0;
    for (const Stop &stop : stops) {
        int32_t plain = 0;
        for (; d < stop.from; ++d) plain += count[ranking.image[d]];
        above += plain;
        const int32_t times = count[ranking.image[d]];
        if (times && stop.to - stop.from == 1) {
            above += times;
            drawn.add(ranking, d, times, above);
        } else {
            for (int32_t copy = 0; copy < times; ++copy)
                for (int64_t e = stop.from; e < stop.to; ++e) drawn.add(ranking, e, 1, ++above);
        }
        d = stop.to;
    }
}

// The curve of a threshold; a detection counts all its copies at once.
void trace(const Drawn &drawn, int t, Curve &curve) {
    curve.begin(drawn.size);
    int32_t n_true = 0, skipped = 0;
    std::size_t at = 0;
    for (std::size_t e = 0; e < drawn.size; ++e) {
        const int32_t times = drawn.times[e];
        const int32_t hit = (drawn.is_true[e] >> t) & 1;
        n_true += times & -hit;
        skipped += times & -static_cast<int32_t>((drawn.is_ignored[e] >> t) & 1);
        curve.n_true[at] = n_true;
        curve.n_all[at] = drawn.above[e] - skipped;
        at += hit;
    }
    curve.size = at;
}

int32_t found_below(const Drawn &drawn, int t, int32_t rank) {
    int32_t found = 0;
    for (std::size_t e = 0; e < drawn.size; ++e)
        found += drawn.times[e] & -static_cast<int32_t>((drawn.is_true[e] >> t) & 1) &
                 -static_cast<int32_t>(drawn.rank[e] < rank);
    return found;
}

int64_t most_drawn(const LwRanking &ranking, const std::vector<Stop> &stops, const int32_t *count) {
    int64_t most = 0;
    for (const Stop &stop : stops) most += (stop.to - stop.from) * count[ranking.image[stop.from]];
    return most;
}

}  // namespace

// counts: (draws, images) how often an image is in a draw; n_truths: (draws,), > 0.
// precision: (T, draws) average precision; recalled: (R, T, draws).
LW_API int32_t lw_resample(const LwRanking *ranking, const int32_t *counts, int64_t draws,
                           int64_t images, const int32_t *n_truths, double *precision,
                           int32_t *recalled) try {
    const LwRanking &of = *ranking;
    if (of.n_thresholds > kMostThresholds) return kTooMany;
    const std::vector<Stop> stops = stops_of(of);
    int32_t last_rank = 0;
    for (int64_t d = 0; d < of.detections; ++d)
        last_rank = of.rank[d] > last_rank ? of.rank[d] : last_rank;
    std::unordered_map<int32_t, Steps> steps;
    Drawn drawn;
    Curve curve;
    for (int64_t draw = 0; draw < draws; ++draw) {
        const int32_t *count = counts + draw * images;
        drawn.begin(most_drawn(of, stops, count));
        draw_stops(of, stops, count, drawn);
        auto known = steps.find(n_truths[draw]);
        if (known == steps.end())
            known = steps.emplace(n_truths[draw], steps_of(n_truths[draw], of.recall_thresholds,
                                                           of.n_recall_thresholds)).first;
        for (int t = 0; t < of.n_thresholds; ++t) {
            trace(drawn, t, curve);
            const int64_t place = t * draws + draw;
            precision[place] = curve.summed(known->second) / of.n_recall_thresholds;
            for (int r = 0; r < of.n_ranks; ++r) {
                const int32_t all = curve.size ? curve.n_true[curve.size - 1] : 0;
                recalled[r * of.n_thresholds * draws + place] =
                    of.ranks[r] > last_rank ? all : found_below(drawn, t, of.ranks[r]);
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
