// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "base/items.h"

/// How far repeated measurements of one thing lie apart, and whether that is little against a tolerance.
namespace slabd::cli::study {

/// Whom a study convinces. Zeroed memory reads as `not_judged`; only `capable` is good.
enum class Judgement : std::uint8_t { not_judged, capable, not_capable, undecided };
/// "not_judged", "capable", "not_capable", "undecided": the word in JSON and tables.
[[nodiscard]] std::string_view name(Judgement judgement);
/// As an item's verdict, for symbols and exit statuses: pass, fail, indeterminate, none.
[[nodiscard]] Verdict as_verdict(Judgement judgement);

/// Of values of one thing.
struct Spread {
  std::size_t count = 0;
  double mean = kNoValue;
  double smallest = kNoValue;
  double largest = kNoValue;
  double range = kNoValue;          ///< largest - smallest: what the paper's Figs. 18 and 19 show of ten repeats
  double deviation_max = kNoValue;  ///< largest |value - mean|
  double std = kNoValue;            ///< about the mean, n - 1; two values at least
  double std_low = kNoValue;        ///< 95 % interval of the true one: s sqrt((n - 1) / chi2)
  double std_high = kNoValue;
};
/// Values are finite. Sums in the order of the values.
[[nodiscard]] Spread spread_of(std::span<const double> values);

/// A type-1 study needs as many (AIAG MSA-4; ISO 22514-7 and VDA 5 ask for 25 at least): the standard deviation of
/// ten has a 95 % interval of 0.69 to 1.83 times itself.
inline constexpr std::size_t kGaugeRunsMin = 50;
inline constexpr double kGaugeCapable = 1.33;

/// T is a finite width above 0. By any other one nothing is capable, nor not capable: it is no tolerance.
[[nodiscard]] bool usable_tolerance(double tolerance);
[[nodiscard]] std::string unusable_text(double tolerance);

/// Type-1 study: the gauge alone, on one thing of known value.
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
  double p = kNoValue;  ///< how probable such a bias is by chance
  Judgement judgement = Judgement::not_judged;
  std::string reason;  ///< why undecided or not capable

  [[nodiscard]] bool biased() const { return p < 0.05; }
};
/// `reference` and `tolerance` NaN: unknown; without a reference nothing is judged. Without a tolerance, or by one that
/// is not a finite width above 0, it is undecided. `missing`: runs in which it could not be measured. Capable only with
/// kGaugeRunsMin runs, none missing, some scatter, and Cg and Cgk of kGaugeCapable; not capable also from fewer runs,
/// when the whole interval of Cg lies below.
[[nodiscard]] Gauge type_1(const Spread& spread, std::size_t missing, double reference, double tolerance);

}  // namespace slabd::cli::study
