// SPDX-License-Identifier: Apache-2.0
#include "cli/trend/distribution.h"

#include <algorithm>
#include <boost/math/distributions/chi_squared.hpp>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/weibull.hpp>
#include <boost/math/tools/toms748_solve.hpp>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "cli/trend/statistics.h"

namespace slabd::cli::trend {
namespace {

using Values = std::vector<double>;
using Normal = boost::math::normal_distribution<double>;
using Weibull = boost::math::weibull_distribution<double>;

constexpr std::size_t kNormalityMin = 20;
constexpr double kLowShare = 0.00135;  // as far out as three sigmas of a normal distribution
constexpr double kHighShare = 1.0 - kLowShare;

/// The normal quantile of a probability that is given by its smaller side; at most 37 sigmas, where it underflows.
double z_of_tail(double tail) {
  return boost::math::quantile(boost::math::complement(Normal(), std::clamp(tail, 1e-300, 1.0 - 1e-16)));
}

Values logarithms(std::span<const double> values) {
  Values logs;
  for (const double value : values) logs.push_back(std::log(value));
  return logs;
}

/// Maximum likelihood: the shape k solves sum(x^k ln x) / sum(x^k) - 1/k = mean(ln x). nullopt if it has no solution in
/// the range of real shapes. Values above 0.
std::optional<Weibull> weibull_of(std::span<const double> values) {
  const double largest = *std::max_element(values.begin(), values.end());
  Values logs;
  double mean = 0.0;
  for (const double value : values) {
    logs.push_back(std::log(value / largest));
    mean += logs.back() / static_cast<double>(values.size());
  }
  const auto excess = [&](double shape) {
    double sum = 0.0;
    double weighted = 0.0;
    for (const double log : logs) {
      const double power = std::exp(shape * log);
      sum += power;
      weighted += power * log;
    }
    return weighted / sum - 1.0 / shape - mean;
  };
  constexpr double kShapeMin = 0.05;
  constexpr double kShapeMax = 1e4;
  if (excess(kShapeMin) > 0.0 || excess(kShapeMax) < 0.0) return std::nullopt;
  std::uintmax_t steps = 100;
  const auto [low, high] = boost::math::tools::toms748_solve(excess, kShapeMin, kShapeMax,
                                                             boost::math::tools::eps_tolerance<double>(40), steps);
  const double shape = 0.5 * (low + high);
  double sum = 0.0;
  for (const double log : logs) sum += std::exp(shape * log);
  const double scale = largest * std::pow(sum / static_cast<double>(values.size()), 1.0 / shape);
  return Weibull(shape, scale);
}

/// The values as they would be if the distribution were normal.
Values scores(std::span<const double> values, const Weibull& weibull) {
  Values z;
  for (const double value : values) {
    const double below = boost::math::cdf(weibull, value);
    const double above = boost::math::cdf(boost::math::complement(weibull, value));
    z.push_back(below < above ? -z_of_tail(below) : z_of_tail(above));
  }
  return z;
}

/// The smallest of the sorted values that at least this share does not exceed; the extreme one if the share is too
/// small for their number.
double percentile(const Values& sorted, double share) {
  const auto rank = static_cast<std::size_t>(std::ceil(share * static_cast<double>(sorted.size())));
  return sorted[std::clamp<std::size_t>(rank, 1, sorted.size()) - 1];
}

void by_percentiles(std::span<const double> values, double lower, double upper, Performance& result) {
  Values sorted(values.begin(), values.end());
  std::sort(sorted.begin(), sorted.end());
  const double middle = percentile(sorted, 0.5);
  const double low = percentile(sorted, kLowShare);
  const double high = percentile(sorted, kHighShare);
  if (has_value(lower) && has_value(upper) && high > low) result.pp.value = (upper - lower) / (high - low);
  const auto side = [&](double limit, double end) {
    if (has_value(limit) && std::abs(end - middle) > 0.0)
      result.ppk.value = std::fmin(result.ppk.value, (limit - middle) / (end - middle));
  };
  side(lower, low);
  side(upper, high);
  if (result.outside.count > 0)
    result.ppk.value = std::fmin(result.ppk.value, z_of_tail(result.outside.share.value) / 3.0);
}

/// Indices of a sample of a normal distribution.
void by_moments(const study::Spread& spread, double lower, double upper, Performance& result) {
  const Capability indices =
      capability_of(spread.mean, spread.std, spread.count, static_cast<double>(spread.count - 1), lower, upper);
  result.pp = indices.cp;
  result.ppk = indices.cpk;
}

/// The likelier of two distributions of a size; false if both are rejected.
bool fit_size(std::span<const double> values, double upper, Performance& result) {
  if (*std::min_element(values.begin(), values.end()) <= 0.0 || !(upper > 0.0)) return false;
  const Values logs = logarithms(values);
  const study::Spread spread = study::spread_of(logs);
  if (!(spread.std > 0.0)) return false;
  double of_lognormal = 0.0;  // log-likelihood
  for (const double log : logs) of_lognormal += std::log(boost::math::pdf(Normal(spread.mean, spread.std), log)) - log;
  double of_weibull = -std::numeric_limits<double>::infinity();
  const std::optional<Weibull> weibull = weibull_of(values);
  if (weibull) {
    of_weibull = 0.0;
    for (const double value : values) of_weibull += std::log(boost::math::pdf(*weibull, value));
  }
  const double p_lognormal = normality(logs);
  const Values z = weibull ? scores(values, *weibull) : Values();
  const double p_weibull = weibull ? normality(z) : 0.0;
  const bool weibull_likelier = of_weibull > of_lognormal;
  result.p = weibull_likelier ? p_weibull : p_lognormal;
  if (p_weibull >= kFitLevel && (weibull_likelier || p_lognormal < kFitLevel)) {
    result.model = Model::weibull;
    result.p = p_weibull;
    const double z_upper = z_of_tail(boost::math::cdf(boost::math::complement(*weibull, upper)));
    by_moments(study::spread_of(z), kNoValue, z_upper, result);
    return true;
  }
  if (p_lognormal < kFitLevel) return false;
  result.model = Model::lognormal;
  result.p = p_lognormal;
  by_moments(spread, kNoValue, std::log(upper), result);
  return true;
}

}  // namespace

std::string_view name(Model model) {
  switch (model) {
    case Model::none: break;
    case Model::normal: return "normal";
    case Model::lognormal: return "lognormal";
    case Model::weibull: return "weibull";
    case Model::percentiles: return "percentiles";
  }
  return "none";
}

double normality(std::span<const double> values) {
  const auto n = static_cast<double>(values.size());
  if (values.size() < kNormalityMin) return kNoValue;
  const double mean = study::spread_of(values).mean;
  double m2 = 0.0;
  double m3 = 0.0;
  double m4 = 0.0;
  for (const double value : values) {
    const double d = value - mean;
    m2 += d * d / n;
    m3 += d * d * d / n;
    m4 += d * d * d * d / n;
  }
  if (!(m2 > 0.0)) return kNoValue;
  // Skewness, transformed to a standard normal quantity.
  const double y = m3 / std::pow(m2, 1.5) * std::sqrt((n + 1.0) * (n + 3.0) / (6.0 * (n - 2.0)));
  const double beta2 =
      3.0 * (n * n + 27.0 * n - 70.0) * (n + 1.0) * (n + 3.0) / ((n - 2.0) * (n + 5.0) * (n + 7.0) * (n + 9.0));
  const double w2 = std::sqrt(2.0 * (beta2 - 1.0)) - 1.0;
  const double alpha = std::sqrt(2.0 / (w2 - 1.0));
  const double z_skewness = std::asinh(y / alpha) / std::sqrt(0.5 * std::log(w2));
  // Kurtosis.
  const double expected = 3.0 * (n - 1.0) / (n + 1.0);
  const double variance = 24.0 * n * (n - 2.0) * (n - 3.0) / ((n + 1.0) * (n + 1.0) * (n + 3.0) * (n + 5.0));
  const double x = (m4 / (m2 * m2) - expected) / std::sqrt(variance);
  const double root = 6.0 * (n * n - 5.0 * n + 2.0) / ((n + 7.0) * (n + 9.0)) *
                      std::sqrt(6.0 * (n + 3.0) * (n + 5.0) / (n * (n - 2.0) * (n - 3.0)));
  const double a = 6.0 + 8.0 / root * (2.0 / root + std::sqrt(1.0 + 4.0 / (root * root)));
  const double share = (1.0 - 2.0 / a) / (1.0 + x * std::sqrt(2.0 / (a - 4.0)));
  const double z_kurtosis = (1.0 - 2.0 / (9.0 * a) - std::cbrt(share)) / std::sqrt(2.0 / (9.0 * a));
  const double k2 = z_skewness * z_skewness + z_kurtosis * z_kurtosis;
  return std::isfinite(k2) ? boost::math::cdf(boost::math::complement(boost::math::chi_squared(2.0), k2)) : 0.0;
}

Performance performance(std::span<const double> values, double lower, double upper, bool is_size,
                        std::size_t values_min) {
  Performance result;
  if (!has_value(lower) && !has_value(upper)) return result;
  result.outside.count = static_cast<std::size_t>(
      std::count_if(values.begin(), values.end(), [&](double value) { return value < lower || value > upper; }));
  result.outside.share = study::share_of(result.outside.count, values.size());
  if (values.size() < values_min) return result;
  const study::Spread spread = study::spread_of(values);
  if (!(spread.std > 0.0)) return result;
  if (is_size && !has_value(lower)) {
    if (fit_size(values, upper, result)) return result;
  } else {
    result.p = normality(values);
    if (!(result.p < kFitLevel)) {
      result.model = Model::normal;
      by_moments(spread, lower, upper, result);
      return result;
    }
  }
  result.model = Model::percentiles;
  by_percentiles(values, lower, upper, result);
  return result;
}

}  // namespace slabd::cli::trend
