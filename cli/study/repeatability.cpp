// SPDX-License-Identifier: Apache-2.0
#include "cli/study/repeatability.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "cli/study/distributions.h"

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
  // Shifted by the first value: deviations of micrometres from a distance of metres keep their digits.
  double sum = 0.0;
  for (const double value : values) sum += value - values.front();
  spread.mean = values.front() + sum / n;
  spread.smallest = *std::min_element(values.begin(), values.end());
  spread.largest = *std::max_element(values.begin(), values.end());
  spread.range = spread.largest - spread.smallest;
  spread.deviation_max = std::max(spread.largest - spread.mean, spread.mean - spread.smallest);
  if (values.size() < 2) return spread;
  if (spread.range == 0.0) {  // the mean of equal values may round away from them
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
  if (has_value(reference)) gauge.judgement = Judgement::undecided;  // until the figures say more
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

}  // namespace slabd::cli::study
