// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "cli/trend/series.h"
#include "report/table.h"

/// Differences between two slabs, and between two periods of a line.
namespace slabd::cli::trend {

/// One characteristic at one place of two slabs.
struct PlaceDifference {
  Item a;
  Item b;
  double difference = kNoValue;  ///< b - a; NaN if one of them has no value
  double U = kNoValue;           ///< k = 2, root sum of squares of both U
  /// |difference| / U; above 1 the two values differ by more than their uncertainties explain (En of ISO 13528).
  double en = kNoValue;
  [[nodiscard]] bool differs() const { return en > 1.0; }
};
/// Places that both slabs have, those with the largest En first. Differences of limits are not compared.
[[nodiscard]] std::vector<PlaceDifference> differences_of(const std::vector<Item>& a, const std::vector<Item>& b);

/// One characteristic in two periods: the values that represent each slab (ValueIs), so that the blocks of one slab
/// are not counted as independent.
struct PeriodDifference {
  Trend before;
  Trend after;
  study::Estimate difference;  ///< mean after - mean before, 95 % by Welch's t, for all characteristics together
  [[nodiscard]] bool differs() const { return difference.low > 0.0 || difference.high < 0.0; }
};
/// `comparisons`: number of characteristics that are compared; the intervals are so wide that with 95 % probability
/// none of them excludes a zero difference by chance (Bonferroni). NaN below two slabs in a period.
[[nodiscard]] PeriodDifference difference_of(Trend before, Trend after, std::size_t comparisons);

}  // namespace slabd::cli::trend
