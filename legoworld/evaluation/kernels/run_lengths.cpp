// Compressed RLE masks of many images at once: whether they are sound, their pixels, their overlaps.
// Integers throughout, so that nothing differs from pycocotools' maskApi.c, whose format it is.

#include <algorithm>
#include <cstdint>
#include <new>
#include <vector>

#include "api.hpp"

namespace {

// 7 bits over what any image needs.
constexpr int kMostDigits = 7;

// Run lengths of one text, appended to `runs`; false where it is truncated, malformed, or holds a negative
// run. Five bits a character with a continuation bit, sign-extended; from the fourth number on,
// each is the difference to the last but one.
bool read_runs(const uint8_t *text, const uint8_t *end, std::vector<int64_t> &runs) {
    const std::size_t first = runs.size();
    while (text < end) {
        int64_t value = 0;
        for (int digit = 0;; ++digit) {
            if (text == end || digit == kMostDigits || *text < 48 || *text > 111) return false;
            const int64_t code = *text++ - 48;
            value |= (code & 31) << (5 * digit);
            if (code & 32) continue;
            if (code & 16) value -= int64_t{1} << (5 * (digit + 1));
            break;
        }
        if (runs.size() - first > 2) value += runs[runs.size() - 2];
        if (value < 0) return false;
        runs.push_back(value);
    }
    return runs.size() > first;
}

struct Mask {
    const int64_t *runs;
    std::size_t n;
    int64_t area;
    int64_t left, top, right, bottom;  // all of its pixels lie inside, right and bottom included
};

// Masks of one height, one after the other.
class Masks {
public:
    bool read(const uint8_t *text, const int64_t *start, int64_t first, int64_t end, int64_t height) {
        runs_.clear();
        starts_.assign(1, 0);
        masks_.clear();
        for (int64_t k = first; k < end; ++k) {
            if (!read_runs(text + start[k], text + start[k + 1], runs_)) return false;
            starts_.push_back(runs_.size());
        }
        for (std::size_t k = 0; k + 1 < starts_.size(); ++k)
            masks_.push_back(measured(runs_.data() + starts_[k], starts_[k + 1] - starts_[k], height));
        return true;
    }

    const std::vector<Mask> &masks() const { return masks_; }

private:
    static Mask measured(const int64_t *runs, std::size_t n, int64_t height) {
        Mask mask{runs, n, 0, INT64_MAX, INT64_MAX, -1, -1};
        int64_t at = 0;
        for (std::size_t k = 0; k < n; at += runs[k++]) {
            if (k % 2 == 0 || !runs[k]) continue;
            const int64_t last = at + runs[k] - 1;
            const bool columns = at / height != last / height;
            mask.area += runs[k];
            mask.left = std::min(mask.left, at / height);
            mask.right = std::max(mask.right, last / height);
            mask.top = std::min(mask.top, columns ? 0 : at % height);
            mask.bottom = std::max(mask.bottom, columns ? height - 1 : last % height);
        }
        return mask;
    }

    std::vector<int64_t> runs_;
    std::vector<std::size_t> starts_;
    std::vector<Mask> masks_;
};

struct Shared {
    int64_t both, either;
};

// Pixels of both masks, and of either. Where both have an empty run at one place it stops, as
// pycocotools does: an encoder writes none there, and the evaluators' numbers are what is wanted.
Shared shared_pixels(const Mask &a, const Mask &b) {
    Shared shared{0, 0};
    if (a.left > b.right || b.left > a.right || a.top > b.bottom || b.top > a.bottom) return shared;
    int64_t left_a = a.runs[0], left_b = b.runs[0];
    bool in_a = false, in_b = false;
    std::size_t i = 1, j = 1;
    do {
        const int64_t step = std::min(left_a, left_b);
        if (in_a || in_b) shared.either += step;
        if (in_a && in_b) shared.both += step;
        left_a -= step;
        left_b -= step;
        if (!left_a && i < a.n) {
            left_a = a.runs[i++];
            in_a = !in_a;
        }
        if (!left_b && j < b.n) {
            left_b = b.runs[j++];
            in_b = !in_b;
        }
    } while (left_a + left_b > 0);
    return shared;
}

}  // namespace

// text, start: (n + 1,) the masks' counts one after the other. covered: (n,) pixels that the run
// lengths add up to, -1 where they are none; area: (n,) pixels of the mask.
LW_API int32_t lw_measure_masks(const uint8_t *text, const int64_t *start, int64_t n,
                                int64_t *covered, double *area) try {
    std::vector<int64_t> runs;
    for (int64_t k = 0; k < n; ++k) {
        runs.clear();
        int64_t pixels[2] = {0, 0};
        const bool sound = read_runs(text + start[k], text + start[k + 1], runs);
        for (std::size_t r = 0; r < runs.size(); ++r) pixels[r % 2] += runs[r];
        covered[k] = sound ? pixels[0] + pixels[1] : -1;
        area[k] = static_cast<double>(pixels[1]);
    }
    return kDone;
} catch (const std::bad_alloc &) {
    return kNoMemory;
}

// Overlaps of the masks of a chunk of images, as lw_match reads them: (detections, truths) of every
// image that has both. IoU; of a crowd truth, the share of the detection inside it. text, start and
// true_text, true_start: the masks' counts, each sound; height: (images,).
LW_API int32_t lw_overlap_masks(const uint8_t *text, const int64_t *start, const uint8_t *true_text,
                                const int64_t *true_start, const int64_t *first_detection,
                                const int64_t *first_truth, const int64_t *height, int64_t images,
                                const uint8_t *crowd, double *iou) try {
    Masks found, wanted;
    for (int64_t i = 0; i < images; ++i) {
        const int64_t first = first_detection[i], end = first_detection[i + 1];
        const int64_t first_true = first_truth[i], end_true = first_truth[i + 1];
        if (first == end || first_true == end_true) continue;
        if (!found.read(text, start, first, end, height[i])) return kUnsound;
        if (!wanted.read(true_text, true_start, first_true, end_true, height[i])) return kUnsound;
        for (const Mask &a : found.masks())
            for (std::size_t g = 0; g < wanted.masks().size(); ++g) {
                const Shared shared = shared_pixels(a, wanted.masks()[g]);
                const int64_t of = crowd[first_true + g] ? a.area : shared.either;
                *iou++ = shared.both ? static_cast<double>(shared.both) / static_cast<double>(of) : 0.0;
            }
    }
    return kDone;
} catch (const std::bad_alloc &) {
    return kNoMemory;
}
