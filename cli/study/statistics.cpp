// SPDX-License-Identifier: Apache-2.0
#include "cli/study/statistics.h"

#include <fmt/core.h>

#include <algorithm>
#include <boost/math/distributions/binomial.hpp>
#include <boost/math/distributions/chi_squared.hpp>
#include <boost/math/distributions/fisher_f.hpp>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>
#include <boost/math/special_functions/digamma.hpp>
#include <boost/math/special_functions/trigamma.hpp>
#include <cmath>
#include <limits>

namespace slabd::cli::study {

std::string_view name(Judgement judgement) {
  switch (judgement) {
    case Judgement::not_judged: break;
    case Judgement::capable: return "capable";
    case Judgement::not_capable: return "not_capable";
    case Judgement::undecided: return "undecided";
  }
  return "not_judged";
}

Verdict as_verdict(Judgement judgement) {
  switch (judgement) {
    case Judgement::not_judged: break;
    case Judgement::capable: return Verdict::pass;
    case Judgement::not_capable: return Verdict::fail;
    case Judgement::undecided: return Verdict::indeterminate;
  }
  return Verdict::none;
}

Spread spread_of(std::span<const double> values) {
  Spread spread;
  spread.count = values.size();
  if (values.empty()) return spread;
  const auto n = static_cast<double>(values.size());
  // Relative to the first value: micrometre deviations of metre distances keep their digits.
  double sum = 0.0;
  for (const double value : values) sum += value - values.front();
  spread.mean = values.front() + sum / n;
  spread.smallest = *std::min_element(values.begin(), values.end());
  spread.largest = *std::max_element(values.begin(), values.end());
  spread.range = spread.largest - spread.smallest;
  spread.deviation_max = std::max(spread.largest - spread.mean, spread.mean - spread.smallest);
  if (values.size() < 2) return spread;
  if (spread.range == 0.0) {  // the mean of equal values may have a rounding error
    spread.std = spread.std_low = spread.std_high = spread.deviation_max = 0.0;
    return spread;
  }
  double squares = 0.0;
  for (const double value : values) squares += (value - spread.mean) * (value - spread.mean);
  spread.std = std::sqrt(squares / (n - 1.0));
  spread.std_low = spread.std * std::sqrt((n - 1.0) / chi_squared_quantile(0.975, n - 1.0));
  spread.std_high = spread.std * std::sqrt((n - 1.0) / chi_squared_quantile(0.025, n - 1.0));
  return spread;
}

namespace {

void judge_gauge(const Spread& spread, std::size_t missing, Gauge& gauge) {
  if (missing > 0) {
    gauge.reason = fmt::format("not measured in {} of {} runs", missing, missing + spread.count);
  } else if (spread.std == 0.0) {
    gauge.reason = "all values are the same: coarse figures, or one scan taken many times";
  } else if (gauge.cg_high < kGaugeCapable) {
    gauge.judgement = Judgement::not_capable;
    gauge.reason = fmt::format("the whole 95 % interval of Cg lies below {}", kGaugeCapable);
  } else if (spread.count < kGaugeRunsMin) {
    gauge.reason = fmt::format("too few runs: {} of {}", spread.count, kGaugeRunsMin);
  } else if (gauge.cg >= kGaugeCapable && gauge.cgk >= kGaugeCapable) {
    gauge.judgement = Judgement::capable;
  } else {
    gauge.judgement = Judgement::not_capable;
    gauge.reason = gauge.cg < kGaugeCapable ? fmt::format("Cg below {}: it scatters too much", kGaugeCapable)
                                            : fmt::format("Cgk below {}: it is biased", kGaugeCapable);
  }
}

}  // namespace

bool usable_tolerance(double tolerance) {
  return tolerance > 0.0 && std::isfinite(tolerance);
}

std::string unusable_text(double tolerance) {
  return fmt::format("T is {:g}: no width above 0", tolerance);
}

Gauge type_1(const Spread& spread, std::size_t missing, double reference, double tolerance) {
  Gauge gauge;
  gauge.reference = reference;
  gauge.tolerance = tolerance;
  if (has_value(reference)) gauge.judgement = Judgement::undecided;  // default until a criterion decides
  if (spread.count < 2) {
    if (has_value(reference))
      gauge.reason = missing > 0 ? fmt::format("not measured in {} of {} runs", missing, missing + spread.count)
                                 : fmt::format("too few runs: {} of {}", spread.count, kGaugeRunsMin);
    return gauge;
  }
  const auto n = static_cast<double>(spread.count);
  const bool scatters = spread.std > 0.0;
  const bool usable = usable_tolerance(tolerance);
  if (usable && scatters) {
    gauge.cg = 0.2 * tolerance / (6.0 * spread.std);
    gauge.cg_low = 0.2 * tolerance / (6.0 * spread.std_high);
    gauge.cg_high = 0.2 * tolerance / (6.0 * spread.std_low);
  }
  if (has_value(reference)) {
    gauge.bias = spread.mean - reference;
    const double error = spread.std / std::sqrt(n);
    const double half = student_quantile(0.975, n - 1.0) * error;
    gauge.bias_low = gauge.bias - half;
    gauge.bias_high = gauge.bias + half;
    if (scatters) {
      gauge.t = gauge.bias / error;
      gauge.p = student_two_sided(gauge.t, n - 1.0);
    }
  }
  if (!has_value(reference)) return gauge;
  if (!usable) {
    gauge.reason = has_value(tolerance) ? unusable_text(tolerance) : "no tolerance: it has no two limits";
    return gauge;
  }
  if (scatters) gauge.cgk = (0.1 * tolerance - std::abs(gauge.bias)) / (3.0 * spread.std);
  judge_gauge(spread, missing, gauge);
  return gauge;
}

// Boost.Math with a policy that returns NaN instead of throwing.

namespace {

namespace rules = boost::math::policies;
using Quiet = rules::policy<rules::domain_error<rules::ignore_error>, rules::pole_error<rules::ignore_error>,
                            rules::overflow_error<rules::ignore_error>, rules::evaluation_error<rules::ignore_error>,
                            rules::promote_double<false>>;
using Normal = boost::math::normal_distribution<double, Quiet>;
using Student = boost::math::students_t_distribution<double, Quiet>;
using ChiSquared = boost::math::chi_squared_distribution<double, Quiet>;
using Fisher = boost::math::fisher_f_distribution<double, Quiet>;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

bool share(double p) {
  return p > 0.0 && p < 1.0;
}
bool freedom(double nu) {
  return nu > 0.0 && std::isfinite(nu);
}

}  // namespace

double normal_quantile(double p) {
  return share(p) ? boost::math::quantile(Normal(0.0, 1.0), p) : kNone;
}

double student_quantile(double p, double nu) {
  return share(p) && freedom(nu) ? boost::math::quantile(Student(nu), p) : kNone;
}

double chi_squared_quantile(double p, double nu) {
  return share(p) && freedom(nu) ? boost::math::quantile(ChiSquared(nu), p) : kNone;
}

double student_two_sided(double t, double nu) {
  if (!freedom(nu) || std::isnan(t)) return kNone;
  if (std::isinf(t)) return 0.0;
  return 2.0 * boost::math::cdf(boost::math::complement(Student(nu), std::abs(t)));
}

double digamma(double x) {
  return x > 0.0 ? boost::math::digamma(x) : kNone;
}

double trigamma(double x) {
  return x > 0.0 ? boost::math::trigamma(x) : kNone;
}

double fisher_tail(double f, double nu_above, double nu_below) {
  if (!freedom(nu_above) || !freedom(nu_below) || !(f >= 0.0)) return kNone;
  if (std::isinf(f)) return 0.0;
  return boost::math::cdf(boost::math::complement(Fisher(nu_above, nu_below), f));
}

Estimate share_of(std::size_t count, std::size_t n) {
  if (n == 0) return {};
  constexpr double kBothSides = 0.025;  // outside a 95 % interval, on each side
  using Binomial = boost::math::binomial_distribution<double, Quiet>;
  const auto successes = static_cast<double>(count);
  const auto trials = static_cast<double>(n);
  return {successes / trials, Binomial::find_lower_bound_on_p(trials, successes, kBothSides),
          Binomial::find_upper_bound_on_p(trials, successes, kBothSides)};
}

namespace {

constexpr double kCoverage = 1.96;
constexpr double kCorrelationMin = 0.9;

/// Pearson's correlation; NaN if one side does not vary.
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

/// Deming's line through all pairs except `left_out`.
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
  // The form of the root without cancellation.
  const double h = std::sqrt(d * d + 4.0 * ratio * xy * xy);
  line.slope = d >= 0.0 ? (d + h) / (2.0 * xy) : 2.0 * ratio * xy / (h - d);
  line.intercept = y_mean - line.slope * x_mean;
  return line;
}

/// The jackknife: pseudo-values n * all - (n - 1) * (all without one), their mean and standard error.
Estimate jackknifed(double all, const std::vector<double>& without_one) {
  const auto n = static_cast<double>(without_one.size());
  std::vector<double> pseudo;
  for (const double value : without_one) pseudo.push_back(n * all - (n - 1.0) * value);
  return around(all, spread_of(pseudo).std / std::sqrt(n), n - 2.0);
}

/// Variance ratio from the stated uncertainties; 0 if a pair lacks one of them.
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
