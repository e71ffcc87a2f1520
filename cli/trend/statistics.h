// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/items.h"
#include "base/limits.h"
#include "cli/study/statistics.h"

/// Statistical process control of one characteristic: individuals and moving range, capability with its confidence,
/// and differences between stations.
namespace slabd::cli::trend {

/// Minimum number of values for limits and capability. With fewer, limits are shown grey, and Cp and Cpk not at all
/// (AIAG SPC, 2nd edition, requires 25 subgroups).
inline constexpr std::size_t kValuesMin = 25;

/// Reason for a marked value. A jump: its moving range is above the limit of the ranges.
enum class Signal : std::uint8_t { none, beyond_limits, jump, nine_on_one_side };

/// Charts of single values in their order.
struct Individuals {
  std::size_t count = 0;
  double mean = kNoValue;
  double moving_range = kNoValue;  ///< mean of |x_i - x_(i-1)|
  double sigma = kNoValue;         ///< short-term: moving_range / 1.128
  double lower_control = kNoValue;
  double upper_control = kNoValue;
  double range_control = kNoValue;  ///< 3.267 * moving_range
  double std = kNoValue;            ///< long-term: about the mean, n - 1
  std::vector<Signal> signals;      ///< one per value
  [[nodiscard]] bool preliminary() const { return count < kValuesMin; }
};
/// Requires at least two values, otherwise all except `count` and `mean` remains NaN. Values must be finite.
[[nodiscard]] Individuals individuals(std::span<const double> values);

struct Capability {
  study::Estimate cp;  ///< NaN for one-sided limits
  study::Estimate cpk;
};
/// Indices with 95 % intervals from a mean and a standard deviation with `nu` degrees of freedom: Cp's interval is that
/// of chi-squared, Cpk's Bissell's (1990). NaN for missing limits or zero scatter.
[[nodiscard]] Capability capability_of(double mean, double sigma, std::size_t count, double nu, double lower,
                                       double upper);
/// Capability from the short-term sigma. Its degrees of freedom are 0.62 (n - 1) (moving ranges overlap). NaN: fewer
/// than kValuesMin values as well.
[[nodiscard]] Capability capability(const Individuals& chart, double lower, double upper);

/// Difference of one station from the median of all stations of the same slab. The median is used so that a station
/// with a large error does not shift the others.
struct StationBias {
  int station = 0;
  std::size_t slabs = 0;
  double bias = kNoValue;
  double bias_sigma = kNoValue;  ///< standard error
  double drift = kNoValue;       ///< change of the bias from the first slab to the last, by a straight line
  double drift_sigma = kNoValue;
  bool preliminary = true;  ///< fewer than kValuesMin slabs
  /// True beyond four standard errors: among 18 stations this happens by chance once in a thousand evaluations.
  [[nodiscard]] bool biased() const;
  [[nodiscard]] bool drifting() const;
};
/// One value of one station of one slab, ordered by slab.
struct Placed {
  std::int64_t slab_key = 0;
  int station = 0;
  double value = kNoValue;
};
/// Biases by station. Slabs with fewer than three stations are left out.
[[nodiscard]] std::vector<StationBias> station_biases(std::span<const Placed> values);

/// Bars of eight heights in one line, the newest `width` values; "·" for a missing value.
[[nodiscard]] std::string sparkline(std::span<const double> values, std::size_t width, bool unicode);

}  // namespace slabd::cli::trend
