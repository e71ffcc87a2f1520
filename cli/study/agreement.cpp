// SPDX-License-Identifier: Apache-2.0
#include "cli/study/agreement.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "cli/study/distributions.h"
#include "cli/study/repeatability.h"

namespace slabd::cli::study {
namespace {

constexpr double kCoverage = 1.96;
constexpr double kCorrelationMin = 0.9;

/// Pearson's; NaN when one side does not vary.
double correlation(std::span<const Pair> pairs) {
  const auto n = static_cast<double>(pairs.size());
  double x_mean = 0.0;
  double y_mean = 0.0;
  for (const Pair& pair : pairs) {
    x_mean += pair.reference / n;
    y_mean += pair.value / n;
  }
  double xx = 0.0;
  double xy = 0.0;
  double yy = 0.0;
  for (const Pair& pair : pairs) {
    xx += (pair.reference - x_mean) * (pair.reference - x_mean);
    xy += (pair.reference - x_mean) * (pair.value - y_mean);
    yy += (pair.value - y_mean) * (pair.value - y_mean);
  }
  return xx > 0.0 && yy > 0.0 ? xy / std::sqrt(xx * yy) : kNoValue;
}

std::vector<double> differences(std::span<const Pair> pairs) {
  std::vector<double> found;
  for (const Pair& pair : pairs) found.push_back(pair.value - pair.reference);
  return found;
}

Estimate around(double value, double sigma, double nu) {
  const double half = student_quantile(0.975, nu) * sigma;
  return {value, value - half, value + half};
}

struct Line {
  double slope = kNoValue;
  double intercept = kNoValue;
};

/// Deming's line through all pairs but `left_out`.
Line line_through(std::span<const Pair> pairs, double ratio, std::size_t left_out) {
  double n = 0.0;
  double x_mean = 0.0;
  double y_mean = 0.0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (i == left_out) continue;
    n += 1.0;
    x_mean += pairs[i].reference;
    y_mean += pairs[i].value;
  }
  x_mean /= n;
  y_mean /= n;
  double xx = 0.0;
  double xy = 0.0;
  double yy = 0.0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (i == left_out) continue;
    const double x = pairs[i].reference - x_mean;
    const double y = pairs[i].value - y_mean;
    xx += x * x;
    xy += x * y;
    yy += y * y;
  }
  const double d = yy - ratio * xx;
  Line line;
  // Of the two forms of the root the one that does not subtract numbers of a size.
  const double h = std::sqrt(d * d + 4.0 * ratio * xy * xy);
  line.slope = d >= 0.0 ? (d + h) / (2.0 * xy) : 2.0 * ratio * xy / (h - d);
  line.intercept = y_mean - line.slope * x_mean;
  return line;
}

/// The jackknife: pseudo-values n all - (n - 1) without one, their mean and standard error.
Estimate jackknifed(double all, const std::vector<double>& without_one) {
  const auto n = static_cast<double>(without_one.size());
  std::vector<double> pseudo;
  for (const double value : without_one) pseudo.push_back(n * all - (n - 1.0) * value);
  return around(all, spread_of(pseudo).std / std::sqrt(n), n - 2.0);
}

/// Variance ratio from the stated uncertainties; 0 when not all pairs state both.
double stated_ratio(std::span<const Pair> pairs) {
  double above = 0.0;
  double below = 0.0;
  for (const Pair& pair : pairs) {
    if (!(pair.U > 0.0) || !(pair.reference_U > 0.0)) return 0.0;
    above += pair.U * pair.U;
    below += pair.reference_U * pair.reference_U;
  }
  return above / below;
}

}  // namespace

Errors errors_of(std::span<const Pair> pairs) {
  Errors errors;
  errors.count = pairs.size();
  if (pairs.empty()) return errors;
  const std::vector<double> off = differences(pairs);
  const Spread spread = spread_of(off);
  const auto n = static_cast<double>(pairs.size());
  errors.std = spread.std;
  errors.mean.value = spread.mean;
  if (pairs.size() >= 2) errors.mean = around(spread.mean, spread.std / std::sqrt(n), n - 1.0);
  double squares = 0.0;
  double sizes = 0.0;
  errors.max_abs = 0.0;
  for (std::size_t i = 0; i < off.size(); ++i) {
    const double size = std::abs(off[i]);
    squares += size * size;
    sizes += size;
    if (size > errors.max_abs) {
      errors.max_abs = size;
      errors.worst = i;
    }
    if (!(pairs[i].U > 0.0) || !(pairs[i].reference_U > 0.0)) continue;
    const double en = size / std::hypot(pairs[i].U, pairs[i].reference_U);
    errors.en_max = errors.en_count == 0 ? en : std::max(errors.en_max, en);
    ++errors.en_count;
  }
  errors.mean_abs = sizes / n;
  errors.rms = std::sqrt(squares / n);
  return errors;
}

AgreementLimits agreement_limits(std::span<const Pair> pairs) {
  AgreementLimits limits;
  if (pairs.size() < 3) return limits;
  const Spread spread = spread_of(differences(pairs));
  const auto n = static_cast<double>(pairs.size());
  const double sigma = spread.std * std::sqrt(1.0 / n + kCoverage * kCoverage / (2.0 * (n - 1.0)));
  limits.lower = around(spread.mean - kCoverage * spread.std, sigma, n - 1.0);
  limits.upper = around(spread.mean + kCoverage * spread.std, sigma, n - 1.0);
  return limits;
}

Regression deming(std::span<const Pair> pairs) {
  Regression result;
  if (pairs.size() < kRegressionPairsMin) {
    result.why_not = fmt::format("{} pairs, {} needed", pairs.size(), kRegressionPairsMin);
    return result;
  }
  const double together = correlation(pairs);
  if (!(together >= kCorrelationMin)) {
    result.why_not = fmt::format("what was measured differs too little for a line (correlation {:.2f}, below {})",
                                 has_value(together) ? together : 0.0, kCorrelationMin);
    return result;
  }
  const double stated = stated_ratio(pairs);
  result.ratio_from_U = stated > 0.0;
  if (result.ratio_from_U) result.ratio = stated;
  const Line all = line_through(pairs, result.ratio, pairs.size());
  std::vector<double> slopes;
  std::vector<double> intercepts;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const Line line = line_through(pairs, result.ratio, i);
    slopes.push_back(line.slope);
    intercepts.push_back(line.intercept);
  }
  result.slope = jackknifed(all.slope, slopes);
  result.intercept = jackknifed(all.intercept, intercepts);
  result.ok = std::isfinite(result.slope.low) && std::isfinite(result.intercept.low);
  if (!result.ok) result.why_not = "one pair alone decides the line";
  return result;
}

}  // namespace slabd::cli::study
