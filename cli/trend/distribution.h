// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include "base/items.h"
#include "cli/study/statistics.h"

/// Distribution of the values of one characteristic, and its performance (ISO 22514-2, ISO 22514-4).
///
/// Problem: an index from mean and standard deviation assumes a normal distribution. A flatness cannot be negative and
/// has one long tail; values of two moulds have two heaps; one bad block among hundreds hardly changes the standard
/// deviation. Idea: the values are tested first. If no distribution fits, the observed values themselves decide.
namespace slabd::cli::trend {

enum class Model : std::uint8_t {
  none,        ///< not tested, because there are too few values or they do not differ
  normal,      ///< two limits, or values that are not sizes
  lognormal,   ///< sizes: zero is a natural bound
  weibull,     ///< sizes as well; the more likely one of both is used
  percentiles  ///< no distribution fits
};
/// "none", "normal", "lognormal", "weibull", "percentiles".
[[nodiscard]] std::string_view name(Model model);

/// A distribution is rejected if the values would differ from it by chance in fewer than 1 of 100 samples.
inline constexpr double kFitLevel = 0.01;

/// Values that lie outside the limits.
struct Outside {
  std::size_t count = 0;
  study::Estimate share;  ///< of all values, 0..1; NaN without values or limits
};

struct Performance {
  Model model = Model::none;
  double p = kNoValue;  ///< probability of such a deviation from `model`, or from the likeliest rejected one, by chance
  study::Estimate pp;   ///< NaN for one limit
  study::Estimate ppk;  ///< without an interval if the model is `percentiles`
  Outside outside;
};

/// Performance of `values`, which must be finite. `is_size`: zero is a natural bound. Indices are NaN for fewer than
/// `values_min` values, without limits or without scatter.
/// normal: Pp = (upper - lower) / (6 s), Ppk = min |limit - mean| / (3 s), intervals as those of Cp and Cpk with n - 1
/// degrees of freedom. lognormal, weibull: Ppk = z / 3, where z is the normal quantile of the probability to lie within
/// the limit. percentiles: Ppk = min |limit - median| / |percentile - median| with the percentiles 0.135 and 99.865;
/// below 741 values these are the extremes, so that Ppk is below 1 if a value lies outside. With more values Ppk is at
/// most z / 3 of the observed share outside.
[[nodiscard]] Performance performance(std::span<const double> values, double lower, double upper, bool is_size,
                                      std::size_t values_min);

/// Probability that a normal sample has such a skewness and kurtosis by chance (D'Agostino and Pearson 1973, with the
/// transformations of D'Agostino, Belanger and D'Agostino 1990). NaN below 20 values or without scatter.
[[nodiscard]] double normality(std::span<const double> values);

}  // namespace slabd::cli::trend
