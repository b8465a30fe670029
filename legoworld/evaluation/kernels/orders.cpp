// Random orders of equally confident detections, drawn by numpy's own functions: a seed means what
// it means to numpy.random.Generator. The NumPy formulation that this is held to, bit for bit, is in
// tests/evaluation/reference_resampling.py.

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <new>
#include <vector>

#include "api.hpp"

// A numpy bit generator, and functions of numpy/random/distributions.h.
struct LwRandom {
    void *bits;
    void (*floats)(void *bits, std::ptrdiff_t n, float *values);
    void (*exponentials)(void *bits, std::ptrdiff_t n, double *values);
    void (*multinomial)(void *bits, int64_t n, int64_t *shares, double *probability,
                        std::ptrdiff_t d, void *binomial);
};

// One category's detections that are not false at every threshold, in runs of equal scores.
struct LwRuns {
    const int64_t *start;         // (R + 1,) where each run's begin
    const int64_t *plain_in;      // (R,) detections of the run that are false at every threshold
    const int64_t *plain_before;  // (R,) and of all runs before it
    int64_t runs;
};

namespace {

// More than numpy's binomial_t takes.
constexpr std::size_t kBinomialBytes = 1024;
// From so many keys on, counting digits is faster than comparing.
constexpr int64_t kManyKeys = 256;
constexpr int kDigitBits = 11, kDigits = 3;

// The sum that numpy makes of neighbours in memory.
double pairwise_sum(const double *values, int64_t n) {
    if (n < 8) {
        double sum = 0.0;
        for (int64_t k = 0; k < n; ++k) sum += values[k];
        return sum;
    }
    if (n <= 128) {
        double r[8];
        int64_t k = 8;
        for (int j = 0; j < 8; ++j) r[j] = values[j];
        for (; k < n - n % 8; k += 8)
            for (int j = 0; j < 8; ++j) r[j] += values[k + j];
        double sum = ((r[0] + r[1]) + (r[2] + r[3])) + ((r[4] + r[5]) + (r[6] + r[7]));
        for (; k < n; ++k) sum += values[k];
        return sum;
    }
    int64_t half = n / 2;
    half -= half % 8;
    return pairwise_sum(values, half) + pairwise_sum(values + half, n - half);
}

// Places by rising key, of equal keys by place. Keys are floats of at least 0, whose bits rise with
// them: a pair is such bits, and the place behind them.
class Sorter {
public:
    const std::vector<uint64_t> &sorted(const float *keys, int64_t n, int64_t stride) {
        pairs_.resize(n);
        for (int64_t k = 0; k < n; ++k) {
            uint32_t bits;
            std::memcpy(&bits, keys + k * stride, sizeof bits);
            pairs_[k] = static_cast<uint64_t>(bits) << 32 | static_cast<uint64_t>(k);
        }
        if (n < kManyKeys)
            std::sort(pairs_.begin(), pairs_.end());
        else
            for (int digit = 0; digit < kDigits; ++digit) count(32 + digit * kDigitBits);
        return pairs_;
    }

private:
    void count(int shift) {
        constexpr uint64_t mask = (1 << kDigitBits) - 1;
        std::size_t at[1 << kDigitBits] = {};
        for (const uint64_t pair : pairs_) ++at[pair >> shift & mask];
        std::size_t before = 0;
        for (std::size_t &n : at) {
            const std::size_t here = n;
            n = before;
            before += here;
        }
        other_.resize(pairs_.size());
        for (const uint64_t pair : pairs_) other_[at[pair >> shift & mask]++] = pair;
        pairs_.swap(other_);
    }

    std::vector<uint64_t> pairs_, other_;
};

}  // namespace

// order, plain: (n, S) of n random orders which detection stands at each place, and how many that
// are false at every threshold stand above it. Within a run every order of both kinds is equally
// likely: the gaps between the detections share out the false ones as a symmetric
// Dirichlet-multinomial with parameter 1, which is uniform over all ways to share them out.
LW_API int32_t lw_random_orders(const LwRandom *random, const LwRuns *runs, int64_t n,
                                int32_t *order, int32_t *plain) try {
    const int64_t size = runs->start[runs->runs];
    for (int64_t i = 0; i < n; ++i)
        for (int64_t r = 0; r < runs->runs; ++r)
            for (int64_t s = runs->start[r]; s < runs->start[r + 1]; ++s) {
                order[i * size + s] = static_cast<int32_t>(s);
                plain[i * size + s] = static_cast<int32_t>(runs->plain_before[r]);
            }
    Sorter sorter;
    std::vector<float> keys;
    std::vector<double> gaps;
    std::vector<int64_t> shares;
    std::vector<unsigned char> binomial(kBinomialBytes);
    for (int64_t r = 0; r < runs->runs; ++r) {
        const int64_t first = runs->start[r], special = runs->start[r + 1] - first;
        if (special > 1) {
            keys.resize(special * n);
            random->floats(random->bits, special * n, keys.data());
            for (int64_t i = 0; i < n; ++i) {
                int32_t *place = order + i * size + first;
                for (const uint64_t pair : sorter.sorted(keys.data() + i, special, n))
                    *place++ = static_cast<int32_t>(first + static_cast<int64_t>(pair & UINT32_MAX));
            }
        }
        if (!runs->plain_in[r]) continue;
        gaps.resize((special + 1) * n);
        random->exponentials(random->bits, (special + 1) * n, gaps.data());
        for (int64_t i = 0; i < n; ++i) {
            double *probability = gaps.data() + i * (special + 1);
            const double sum = pairwise_sum(probability, special + 1);
            for (int64_t s = 0; s <= special; ++s) probability[s] /= sum;
            shares.assign(special + 1, 0);
            random->multinomial(random->bits, runs->plain_in[r], shares.data(), probability,
                                special + 1, binomial.data());
            int64_t above = 0;
            for (int64_t s = 0; s < special; ++s) {
                above += shares[s];
                plain[i * size + first + s] += static_cast<int32_t>(above);
            }
        }
    }
    return kDone;
} catch (const std::bad_alloc &) {
    return kNoMemory;
}
