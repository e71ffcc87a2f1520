// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/fields.h"
#include "base/items.h"

/// Scatter of repeated measurements of one object, and its judgement relative to a tolerance.
namespace slabd::cli::study {

/// Result of a study. Zeroed memory reads as `not_judged`; only `capable` is good.
enum class Judgement : std::uint8_t { not_judged, capable, not_capable, undecided };
/// "not_judged", "capable", "not_capable", "undecided": the word in JSON and tables.
[[nodiscard]] std::string_view name(Judgement judgement);
/// As an item's verdict, for symbols and exit statuses: pass, fail, indeterminate, none.
[[nodiscard]] Verdict as_verdict(Judgement judgement);

/// Spread of repeated values of one quantity.
struct Spread {
  std::size_t count = 0;
  double mean = kNoValue;
  double smallest = kNoValue;
  double largest = kNoValue;
  double range = kNoValue;          ///< largest - smallest: shown for ten repeats in the paper's Figs. 18 and 19
  double deviation_max = kNoValue;  ///< largest |value - mean|
  double std = kNoValue;            ///< about the mean, n - 1; at least two values
  double std_low = kNoValue;        ///< 95 % interval of the true one: s sqrt((n - 1) / chi2)
  double std_high = kNoValue;
};
/// Values must be finite. Sums are in the order of the values.
[[nodiscard]] Spread spread_of(std::span<const double> values);

/// Required runs of a type-1 study (AIAG MSA-4; ISO 22514-7 and VDA 5 require at least 25): the standard deviation of
/// ten has a 95 % interval of 0.69 to 1.83 times itself.
inline constexpr std::size_t kGaugeRunsMin = 50;
inline constexpr double kGaugeCapable = 1.33;

/// True if T is a finite width above 0. With any other T nothing can be judged.
[[nodiscard]] bool usable_tolerance(double tolerance);
[[nodiscard]] std::string unusable_text(double tolerance);

/// Type-1 study: the gauge alone, on one object of known value.
struct Gauge {
  double reference = kNoValue;
  double tolerance = kNoValue;  ///< T, upper limit minus lower limit
  double cg = kNoValue;         ///< 0.2 T / (6 s)
  double cg_low = kNoValue;     ///< 95 % interval from that of s
  double cg_high = kNoValue;
  double cgk = kNoValue;  ///< (0.1 T - |mean - reference|) / (3 s)
  double bias = kNoValue;
  double bias_low = kNoValue;  ///< 95 % interval by Student's t
  double bias_high = kNoValue;
  double t = kNoValue;  ///< bias / (s / sqrt(n))
  double p = kNoValue;  ///< probability of such a bias by chance
  Judgement judgement = Judgement::not_judged;
  std::string reason;  ///< reason for undecided or not capable

  [[nodiscard]] bool biased() const { return p < 0.05; }
};
/// `reference` and `tolerance` NaN: unknown; without a reference nothing is judged. Without a tolerance, or with one
/// that is not a finite width above 0, the result is undecided. `missing`: runs without a value. Capable only with
/// kGaugeRunsMin runs, none missing, some scatter, and Cg and Cgk of at least kGaugeCapable. Not capable also with
/// fewer runs, if the whole interval of Cg is below.
[[nodiscard]] Gauge type_1(const Spread& spread, std::size_t missing, double reference, double tolerance);

/// Distributions used by studies. `nu` is the degrees of freedom, above 0. NaN for arguments out of range.

/// Quantile of the standard normal distribution: a share `p` (0..1, exclusive) is below it.
[[nodiscard]] double normal_quantile(double p);
/// Quantile of Student's t.
[[nodiscard]] double student_quantile(double p, double nu);
/// Quantile of chi-squared.
[[nodiscard]] double chi_squared_quantile(double p, double nu);
/// Probability of a |t| at least as large by chance.
[[nodiscard]] double student_two_sided(double t, double nu);
/// First and second derivative of the logarithm of the gamma function, for x > 0.
[[nodiscard]] double digamma(double x);
[[nodiscard]] double trigamma(double x);
/// Probability of an F at least as large by chance.
[[nodiscard]] double fisher_tail(double f, double nu_above, double nu_below);

// Comparison of two methods that measure the same objects, one of them the reference.

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

/// Share of `count` among `n`, with the interval of Clopper and Pearson (1934); NaN if n is 0.
[[nodiscard]] Estimate share_of(std::size_t count, std::size_t n);

/// Table 6 of the paper and its conclusion 3: the errors themselves.
struct Errors {
  std::size_t count = 0;
  Estimate mean;               ///< of value - reference: the bias
  double mean_abs = kNoValue;  ///< "average error"
  double max_abs = kNoValue;   ///< maximum error
  std::size_t worst = 0;       ///< pair with the maximum error
  double rms = kNoValue;
  double std = kNoValue;  ///< about the bias
  /// Largest |value - reference| / sqrt(U^2 + reference_U^2) of the pairs with both U (En of ISO 13528; above 1 they
  /// contradict each other), and the number of these pairs.
  double en_max = kNoValue;
  std::size_t en_count = 0;
};
template <typename V, RecordOf<Errors> R>
void fields(V& v, R& r) {
  v("n", r.count);
  SLABD_EACH(r, mean, mean_abs, max_abs, rms, std, en_max, en_count)
}
[[nodiscard]] Errors errors_of(std::span<const Pair> pairs);

/// Limits that contain 95 % of the differences, mean -+ 1.96 std (Bland and Altman 1986, 1999): possible difference of
/// the two methods on one object. Intervals by s sqrt(1/n + 1.96^2 / (2 (n - 1))) and Student's t. At least three
/// pairs.
struct AgreementLimits {
  Estimate lower;
  Estimate upper;
};
SLABD_FIELDS(AgreementLimits, lower, upper);
[[nodiscard]] AgreementLimits agreement_limits(std::span<const Pair> pairs);

/// value = intercept + slope * reference, by Deming's regression: both sides have errors, so least squares, which
/// assumes an exact reference, would give a slope that is too small. `ratio` is the variance of the values' error over
/// that of the reference's: from the stated U if all pairs have both, otherwise 1 (orthogonal regression). Intervals
/// by the jackknife (Linnet 1990) and Student's t with n - 2 degrees of freedom. Needs kRegressionPairsMin pairs.
struct Regression {
  bool ok = false;
  std::string why_not;
  double ratio = 1.0;
  bool ratio_from_U = false;
  Estimate slope;
  Estimate intercept;
};
inline constexpr std::size_t kRegressionPairsMin = 5;
/// Not ok if the correlation is below 0.9, because a line through one cluster is meaningless.
[[nodiscard]] Regression deming(std::span<const Pair> pairs);

}  // namespace slabd::cli::study
