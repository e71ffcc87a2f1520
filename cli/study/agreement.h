// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "base/fields.h"
#include "base/items.h"

/// Two ways of measuring the same things: what one finds against what the other (the reference) finds.
namespace slabd::cli::study {

struct Pair {
  double reference = kNoValue;
  double value = kNoValue;
  double reference_U = kNoValue;  ///< k = 2, NaN: not stated
  double U = kNoValue;
};

/// A figure with its 95 % interval.
struct Estimate {
  double value = kNoValue;
  double low = kNoValue;
  double high = kNoValue;
};
SLABD_FIELDS(Estimate, value, low, high);

/// Table 6 of the paper and its conclusion 3: the errors themselves.
struct Errors {
  std::size_t count = 0;
  Estimate mean;               ///< of value - reference: the bias
  double mean_abs = kNoValue;  ///< "average error"
  double max_abs = kNoValue;   ///< "maximum error"
  std::size_t worst = 0;       ///< the pair that it is of
  double rms = kNoValue;
  double std = kNoValue;  ///< about the bias
  /// Largest |value - reference| / sqrt(U^2 + reference_U^2) of the pairs that state both (En of ISO 13528; above 1 the
  /// two contradict each other), and how many those are.
  double en_max = kNoValue;
  std::size_t en_count = 0;
};
template <typename V, RecordOf<Errors> R>
void fields(V& v, R& r) {
  v("n", r.count);
  SLABD_EACH(r, mean, mean_abs, max_abs, rms, std, en_max, en_count)
}
[[nodiscard]] Errors errors_of(std::span<const Pair> pairs);

/// Limits that hold 95 % of the differences, mean -+ 1.96 std (Bland and Altman 1986, 1999): how far the two may lie
/// apart on one thing. Intervals by s sqrt(1/n + 1.96^2 / (2 (n - 1))) and Student's t. Three pairs at least.
struct AgreementLimits {
  Estimate lower;
  Estimate upper;
};
SLABD_FIELDS(AgreementLimits, lower, upper);
[[nodiscard]] AgreementLimits agreement_limits(std::span<const Pair> pairs);

/// value = intercept + slope * reference, by Deming's regression: both sides err, so least squares, which takes the
/// reference as exact, would find too flat a line. `ratio` is the variance of the values' error over that of the
/// reference's: from the stated U where all pairs state both, else 1 (orthogonal regression). Intervals by the
/// jackknife (Linnet 1990) and Student's t with n - 2 degrees of freedom. Needs kRegressionPairsMin pairs.
struct Regression {
  bool ok = false;
  std::string why_not;
  double ratio = 1.0;
  bool ratio_from_U = false;
  Estimate slope;
  Estimate intercept;
};
inline constexpr std::size_t kRegressionPairsMin = 5;
/// Not ok below a correlation of 0.9: a line through one cloud says nothing.
[[nodiscard]] Regression deming(std::span<const Pair> pairs);

}  // namespace slabd::cli::study
