// One-to-one pairs of greatest total worth: shortest augmenting paths (D. F. Crouse, On implementing
// 2D rectangular assignment algorithms, 2016). Of equally good pairings it takes the one that
// scipy.optimize.linear_sum_assignment takes, which is held to it by a test.

#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

class Assignment {
public:
    // worth: (rows, columns). Pairs in ascending order of rows, min(rows, columns) of them.
    const std::vector<std::pair<int64_t, int64_t>> &solve(const double *worth, int64_t rows,
                                                          int64_t columns) {
        pairs_.clear();
        if (!rows || !columns) return pairs_;
        const bool turned = columns < rows;
        few_ = turned ? columns : rows;
        many_ = turned ? rows : columns;
        cost_.resize(few_ * many_);
        for (int64_t r = 0; r < rows; ++r)
            for (int64_t c = 0; c < columns; ++c)
                cost_[turned ? c * many_ + r : r * many_ + c] = -worth[r * columns + c];
        price_of_few_.assign(few_, 0.0);
        price_of_many_.assign(many_, 0.0);
        partner_of_few_.assign(few_, -1);
        partner_of_many_.assign(many_, -1);
        came_from_.assign(many_, -1);
        for (int64_t i = 0; i < few_; ++i) place(i);
        for (int64_t i = 0; i < few_; ++i) {
            const int64_t j = partner_of_few_[i];
            pairs_.push_back(turned ? std::make_pair(j, i) : std::make_pair(i, j));
        }
        if (turned) std::sort(pairs_.begin(), pairs_.end());
        return pairs_;
    }

private:
    // Pair one more of the few along the cheapest path that ends at a free one of the many.
    void place(int64_t start) {
        const double infinity = std::numeric_limits<double>::infinity();
        open_.resize(many_);
        // From the back, so that of equal costs the first is taken.
        for (int64_t k = 0; k < many_; ++k) open_[k] = many_ - k - 1;
        length_.assign(many_, infinity);
        few_seen_.assign(few_, 0);
        many_seen_.assign(many_, 0);
        double shortest = 0.0;
        int64_t i = start, end = -1;
        while (end < 0) {
            few_seen_[i] = 1;
            double lowest = infinity;
            std::size_t at = 0;
            for (std::size_t k = 0; k < open_.size(); ++k) {
                const int64_t j = open_[k];
                const double length =
                    shortest + cost_[i * many_ + j] - price_of_few_[i] - price_of_many_[j];
                if (length < length_[j]) {
                    came_from_[j] = i;
                    length_[j] = length;
                }
                // Of equal lengths one that ends the path.
                if (length_[j] < lowest || (length_[j] == lowest && partner_of_many_[j] < 0)) {
                    lowest = length_[j];
                    at = k;
                }
            }
            shortest = lowest;
            const int64_t j = open_[at];
            many_seen_[j] = 1;
            open_[at] = open_.back();
            open_.pop_back();
            if (partner_of_many_[j] < 0)
                end = j;
            else
                i = partner_of_many_[j];
        }
        price_of_few_[start] += shortest;
        for (int64_t k = 0; k < few_; ++k)
            if (few_seen_[k] && k != start) price_of_few_[k] += shortest - length_[partner_of_few_[k]];
        for (int64_t j = 0; j < many_; ++j)
            if (many_seen_[j]) price_of_many_[j] -= shortest - length_[j];
        for (int64_t j = end;;) {
            const int64_t owner = came_from_[j];
            partner_of_many_[j] = owner;
            std::swap(partner_of_few_[owner], j);
            if (owner == start) break;
        }
    }

    int64_t few_ = 0, many_ = 0;
    std::vector<double> cost_, price_of_few_, price_of_many_, length_;
    std::vector<int64_t> partner_of_few_, partner_of_many_, came_from_, open_;
    std::vector<char> few_seen_, many_seen_;
    std::vector<std::pair<int64_t, int64_t>> pairs_;
};
