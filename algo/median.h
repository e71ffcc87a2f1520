// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>

namespace slabd::algo {

/// The value at `rank` (from 0, < values.size()) in sorted order. No value may be NaN; infinities are ordinary values.
/// Exact; no heap; about 2 us for 4096 values.
[[nodiscard]] double value_at_rank(std::span<const double> values, std::size_t rank);

/// Number of values that are at most `limit`.
[[nodiscard]] std::size_t count_at_most(std::span<const double> values, double limit);

/// The upper median, rank size / 2. 0 for an empty set.
[[nodiscard]] inline double median_of(std::span<const double> values) {
  return values.empty() ? 0.0 : value_at_rank(values, values.size() / 2);
}

}  // namespace slabd::algo
