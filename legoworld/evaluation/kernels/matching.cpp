// Outcomes of the detections of a chunk of images: greedy matching as pycocotools and lvis do
// it, and pairs that are free of scores. The Python formulation that both are held to, bit for bit,
// is in tests/evaluation/reference_matching.py.

#include <cstdint>
#include <new>
#include <vector>

#include "api.hpp"
#include "assignment.hpp"

// Detections are ordered by image, category, falling score; truths by image and place in the file.
struct LwChunk {
    const int64_t *first_detection;  // (images + 1,)
    const int64_t *first_truth;      // (images + 1,)
    int64_t images;
    const double *iou;               // image after image, (detections, truths) of it
    const int64_t *category;         // (D,)
    const double *area;              // (D,)
    const uint8_t *verified;         // (D,)
    const uint8_t *exhaustive;       // (D,)
    const int64_t *true_category;    // (G,)
    const double *true_area;         // (G,)
    const uint8_t *ignored;          // (G,)
    const uint8_t *crowd;            // (G,)
};

// Rules that are the protocol's.
struct LwRules {
    const double *thresholds;  // (T,) ascending
    int32_t n_thresholds;
    const double *low, *high;  // (A,) areas, both ends included
    int32_t n_areas;
};

namespace {

constexpr uint8_t kFalsePositive = 0, kTruePositive = 1, kIgnored = 2;
constexpr double kHit = 0.5, kPreferHit = 1e-9, kPreferLabel = 1e-11;

// An image of a chunk, and its overlaps.
struct Image {
    int64_t first_detection, n_detections, first_truth, n_truths;
    const double *iou;

    double overlap(int64_t detection, int64_t truth) const {
        return iou[detection * n_truths + truth];
    }
};

// Calls visit(image) for every image that has both detections and truths.
template <typename Visit>
void each_image(const LwChunk &chunk, Visit visit) {
    const double *iou = chunk.iou;
    for (int64_t i = 0; i < chunk.images; ++i) {
        Image image{chunk.first_detection[i], chunk.first_detection[i + 1] - chunk.first_detection[i],
                    chunk.first_truth[i], chunk.first_truth[i + 1] - chunk.first_truth[i], iou};
        if (!image.n_detections || !image.n_truths) continue;
        visit(image);
        iou += image.n_detections * image.n_truths;
    }
}

// Calls visit(first, end, truths) for every run of an image's detections of one category, and the
// truths that it has there.
template <typename Visit>
void each_category(const LwChunk &chunk, const Image &image, std::vector<int64_t> &truths,
                   Visit visit) {
    const int64_t *category = chunk.category + image.first_detection;
    for (int64_t first = 0; first < image.n_detections;) {
        int64_t end = first + 1;
        while (end < image.n_detections && category[end] == category[first]) ++end;
        truths.clear();
        for (int64_t g = 0; g < image.n_truths; ++g)
            if (chunk.true_category[image.first_truth + g] == category[first]) truths.push_back(g);
        if (!truths.empty()) visit(first, end, truths);
        first = end;
    }
}

// One category of one image at one area and threshold.
void match(const LwChunk &chunk, const Image &image, int64_t first, int64_t end,
           const std::vector<int64_t> &truths, const uint8_t *ignored, double threshold,
           std::vector<char> &taken, uint8_t *state) {
    taken.assign(truths.size(), 0);
    for (int64_t d = first; d < end; ++d) {
        int64_t best = -1;
        double highest = 0.0;
        for (std::size_t k = 0; k < truths.size(); ++k) {
            const double iou = image.overlap(d, truths[k]);
            if (taken[k] || !(iou >= threshold)) continue;
            // A regular truth is always preferred; of equal overlaps the later truth wins.
            const bool better = best < 0 || (ignored[best] && !ignored[k]) ||
                                (ignored[best] == ignored[k] && iou >= highest);
            if (!better) continue;
            best = static_cast<int64_t>(k);
            highest = iou;
        }
        if (best < 0) continue;
        state[image.first_detection + d] = ignored[best] ? kIgnored : kTruePositive;
        taken[best] = !chunk.crowd[image.first_truth + truths[best]];
    }
}

// Score-free pairs of some of an image's detections and truths, and what is forgiven there.
class Pairer {
public:
    Pairer(const LwChunk &chunk, uint8_t *forgiven, int64_t *detection, int64_t *truth, double *iou)
        : chunk_(chunk), forgiven_(forgiven), detection_(detection), truth_(truth), iou_(iou) {}

    int64_t size() const { return size_; }

    void pair(const Image &image, int64_t first, int64_t end, const std::vector<int64_t> &truths) {
        regular_.clear();
        crowds_.clear();
        forgiving_.clear();
        for (const int64_t g : truths) {
            const int64_t at = image.first_truth + g;
            (!chunk_.ignored[at] ? regular_ : chunk_.crowd[at] ? crowds_ : forgiving_).push_back(g);
        }
        free_.resize(end - first);
        for (int64_t d = first; d < end; ++d)
            free_[d - first] = !forgiven_[image.first_detection + d];
        pair_regular(image, first, end);
        forgive(image, first, end);
    }

private:
    void pair_regular(const Image &image, int64_t first, int64_t end) {
        worth_.clear();
        for (int64_t d = first; d < end; ++d)
            for (const int64_t g : regular_) {
                const double iou = image.overlap(d, g);
                const bool hit = iou >= kHit;
                const bool same = chunk_.category[image.first_detection + d] ==
                                  chunk_.true_category[image.first_truth + g];
                worth_.push_back(iou + (hit ? kPreferHit : 0.0) + (hit && same ? kPreferLabel : 0.0));
            }
        const int64_t n = static_cast<int64_t>(regular_.size());
        for (const auto &[row, column] : assignment_.solve(worth_.data(), end - first, n)) {
            const double iou = image.overlap(first + row, regular_[column]);
            if (!(iou > 0)) continue;
            detection_[size_] = image.first_detection + first + row;
            truth_[size_] = image.first_truth + regular_[column];
            iou_[size_++] = iou;
            if (iou >= kHit) free_[row] = 0;
        }
    }

    // A crowd forgives any number of detections, another ignored truth one: of all ways to share
    // these out, one that forgives most.
    void forgive(const Image &image, int64_t first, int64_t end) {
        rows_.clear();
        worth_.clear();
        for (int64_t d = first; d < end; ++d) {
            if (!free_[d - first]) continue;
            bool in_crowd = false, claims = false;
            for (const int64_t g : crowds_) in_crowd |= image.overlap(d, g) >= kHit;
            for (const int64_t g : forgiving_) claims |= image.overlap(d, g) >= kHit;
            if (in_crowd)
                forgiven_[image.first_detection + d] = 1;
            else if (claims) {
                rows_.push_back(d);
                for (const int64_t g : forgiving_)
                    worth_.push_back(image.overlap(d, g) >= kHit ? 1.0 : 0.0);
            }
        }
        const int64_t n = static_cast<int64_t>(forgiving_.size());
        const int64_t n_rows = static_cast<int64_t>(rows_.size());
        for (const auto &[row, column] : assignment_.solve(worth_.data(), n_rows, n))
            if (worth_[row * n + column] > 0) forgiven_[image.first_detection + rows_[row]] = 1;
    }

    const LwChunk &chunk_;
    uint8_t *forgiven_;
    int64_t *detection_, *truth_;
    double *iou_;
    int64_t size_ = 0;
    Assignment assignment_;
    std::vector<int64_t> regular_, crowds_, forgiving_, rows_;
    std::vector<double> worth_;
    std::vector<char> free_;
};

}  // namespace

// state: (A, T, D), all zero; outcome of every detection at every area and threshold.
LW_API int32_t lw_match(const LwChunk *chunk, const LwRules *rules, uint8_t *state) try {
    const LwChunk &of = *chunk;
    const int64_t detections = of.first_detection[of.images];
    std::vector<int64_t> mine;
    std::vector<char> taken;
    std::vector<uint8_t> ignored;
    each_image(of, [&](const Image &image) {
        each_category(of, image, mine, [&](int64_t first, int64_t end, const auto &truths) {
            for (int a = 0; a < rules->n_areas; ++a) {
                ignored.clear();
                for (const int64_t g : truths) {
                    const double area = of.true_area[image.first_truth + g];
                    const bool outside = area < rules->low[a] || area > rules->high[a];
                    ignored.push_back(of.ignored[image.first_truth + g] || outside);
                }
                for (int t = 0; t < rules->n_thresholds; ++t)
                    match(of, image, first, end, truths, ignored.data(), rules->thresholds[t], taken,
                          state + (a * rules->n_thresholds + t) * detections);
            }
        });
    });
    // Unmatched detections outside the area, or where not all instances are annotated, are forgiven.
    for (int a = 0; a < rules->n_areas; ++a)
        for (int t = 0; t < rules->n_thresholds; ++t) {
            uint8_t *lane = state + (a * rules->n_thresholds + t) * detections;
            for (int64_t d = 0; d < detections; ++d) {
                const bool outside = of.area[d] < rules->low[a] || of.area[d] > rules->high[a];
                if (lane[d] == kFalsePositive && (outside || !of.exhaustive[d])) lane[d] = kIgnored;
            }
        }
    return kDone;
} catch (const std::bad_alloc &) {
    return kNoMemory;
}

// Pairs within categories (aware) or across them: detection, truth, iou: (G,) at most; n: how many.
// counted: (D,) detections that are answered for.
LW_API int32_t lw_pair(const LwChunk *chunk, int32_t aware, int64_t *detection, int64_t *truth,
                       double *iou, int64_t *n, uint8_t *counted) try {
    const LwChunk &of = *chunk;
    const int64_t detections = of.first_detection[of.images];
    std::vector<uint8_t> forgiven(detections);
    for (int64_t d = 0; d < detections; ++d) forgiven[d] = !of.exhaustive[d] || !of.verified[d];
    std::vector<int64_t> mine;
    Pairer pairer(of, forgiven.data(), detection, truth, iou);
    each_image(of, [&](const Image &image) {
        if (aware) {
            each_category(of, image, mine, [&](int64_t first, int64_t end, const auto &truths) {
                pairer.pair(image, first, end, truths);
            });
        } else {
            mine.clear();
            for (int64_t g = 0; g < image.n_truths; ++g) mine.push_back(g);
            pairer.pair(image, 0, image.n_detections, mine);
        }
    });
    *n = pairer.size();
    for (int64_t d = 0; d < detections; ++d) counted[d] = !forgiven[d];
    for (int64_t k = 0; k < *n; ++k)
        if (iou[k] >= kHit) counted[detection[k]] = 1;
    return kDone;
} catch (const std::bad_alloc &) {
    return kNoMemory;
}
