// SPDX-License-Identifier: Apache-2.0
#include "cli/trend/statistics.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <string_view>

namespace slabd::cli::trend {
namespace {

constexpr double kD2 = 1.128;         // expected range of two normal values, in sigmas
constexpr double kD4 = 3.267;         // upper control limit of such ranges over their mean
constexpr double kBothSides = 0.025;  // probability outside a 95 % interval, on each side
constexpr double kSignificant = 4.0;

/// Marks a value if it and the eight before it are on one side of the mean.
void mark_runs(std::span<const double> values, double mean, std::vector<Signal>& signals) {
  constexpr int kRun = 9;
  int run = 0;
  int side = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const int now = values[i] > mean ? 1 : values[i] < mean ? -1 : 0;
    run = now != 0 && now == side ? run + 1 : (now != 0 ? 1 : 0);
    side = now;
    if (run >= kRun && signals[i] == Signal::none) signals[i] = Signal::nine_on_one_side;
  }
}

double median_of(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t half = values.size() / 2;
  return values.size() % 2 == 1 ? values[half] : 0.5 * (values[half - 1] + values[half]);
}

}  // namespace

Individuals individuals(std::span<const double> values) {
  Individuals chart;
  chart.count = values.size();
  chart.signals.assign(values.size(), Signal::none);
  if (values.empty()) return chart;
  const study::Spread spread = study::spread_of(values);
  chart.mean = spread.mean;
  if (values.size() < 2) return chart;
  double ranges = 0.0;
  for (std::size_t i = 1; i < values.size(); ++i) ranges += std::abs(values[i] - values[i - 1]);
  chart.moving_range = ranges / static_cast<double>(values.size() - 1);
  chart.sigma = chart.moving_range / kD2;
  chart.std = spread.std;
  chart.lower_control = chart.mean - 3.0 * chart.sigma;
  chart.upper_control = chart.mean + 3.0 * chart.sigma;
  chart.range_control = kD4 * chart.moving_range;
  if (chart.preliminary()) return chart;
  for (std::size_t i = 0; i < values.size(); ++i)
    if (values[i] < chart.lower_control || values[i] > chart.upper_control)
      chart.signals[i] = Signal::beyond_limits;
    else if (i > 0 && std::abs(values[i] - values[i - 1]) > chart.range_control)
      chart.signals[i] = Signal::jump;
  mark_runs(values, chart.mean, chart.signals);
  return chart;
}

Capability capability_of(double mean, double sigma, std::size_t count, double nu, double lower, double upper) {
  Capability result;
  if (!(sigma > 0.0) || (!has_value(lower) && !has_value(upper))) return result;
  if (has_value(lower) && has_value(upper)) {
    result.cp.value = (upper - lower) / (6.0 * sigma);
    result.cp.low = result.cp.value * std::sqrt(study::chi_squared_quantile(kBothSides, nu) / nu);
    result.cp.high = result.cp.value * std::sqrt(study::chi_squared_quantile(1.0 - kBothSides, nu) / nu);
  }
  const double cpk = std::fmin(mean - lower, upper - mean) / (3.0 * sigma);  // a missing limit is NaN and ignored
  const double half = study::normal_quantile(1.0 - kBothSides) *
                      std::sqrt(1.0 / (9.0 * static_cast<double>(count)) + cpk * cpk / (2.0 * nu));
  result.cpk = {cpk, cpk - half, cpk + half};
  return result;
}

Capability capability(const Individuals& chart, double lower, double upper) {
  if (chart.preliminary()) return {};
  const double nu = 0.62 * static_cast<double>(chart.count - 1);
  return capability_of(chart.mean, chart.sigma, chart.count, nu, lower, upper);
}

bool StationBias::biased() const {
  return !preliminary && std::abs(bias) > kSignificant * bias_sigma;
}
bool StationBias::drifting() const {
  return !preliminary && std::abs(drift) > kSignificant * drift_sigma;
}

std::vector<StationBias> station_biases(std::span<const Placed> values) {
  constexpr std::size_t kStationsMin = 3;
  struct Point {
    double slab;  ///< index of the slab: 0, 1, 2, ...
    double off;
  };
  std::map<int, std::vector<Point>> by_station;
  double slab = 0.0;
  for (std::size_t begin = 0; begin < values.size();) {
    std::size_t end = begin;
    std::vector<double> all;
    while (end < values.size() && values[end].slab_key == values[begin].slab_key) all.push_back(values[end++].value);
    if (all.size() >= kStationsMin) {
      const double middle = median_of(std::move(all));
      for (std::size_t i = begin; i < end; ++i)
        by_station[values[i].station].push_back({slab, values[i].value - middle});
    }
    slab += 1.0;
    begin = end;
  }
  std::vector<StationBias> list;
  for (const auto& [station, points] : by_station) {
    StationBias bias;
    bias.station = station;
    bias.slabs = points.size();
    bias.preliminary = points.size() < kValuesMin;
    const auto n = static_cast<double>(points.size());
    double sum_x = 0.0;
    double sum_y = 0.0;
    for (const Point& p : points) {
      sum_x += p.slab;
      sum_y += p.off;
    }
    const double mean_x = sum_x / n;
    bias.bias = sum_y / n;
    double xx = 0.0;
    double xy = 0.0;
    double yy = 0.0;
    for (const Point& p : points) {
      xx += (p.slab - mean_x) * (p.slab - mean_x);
      xy += (p.slab - mean_x) * (p.off - bias.bias);
      yy += (p.off - bias.bias) * (p.off - bias.bias);
    }
    if (points.size() > 1) bias.bias_sigma = std::sqrt(yy / (n - 1.0) / n);
    if (points.size() > 2 && xx > 0.0) {
      const double slope = xy / xx;
      const double span = points.back().slab - points.front().slab;
      bias.drift = slope * span;
      bias.drift_sigma = std::sqrt(std::max(yy - slope * xy, 0.0) / (n - 2.0) / xx) * span;
    }
    list.push_back(bias);
  }
  return list;
}

std::string sparkline(std::span<const double> values, std::size_t width, bool unicode) {
  static constexpr std::array<std::string_view, 8> kBars = {"▁", "▂", "▃", "▄", "▅", "▆", "▇", "█"};
  static constexpr std::array<std::string_view, 8> kPlain = {"_", ".", "-", "~", "=", "+", "*", "#"};
  const std::span<const double> newest = values.last(std::min(width, values.size()));
  double low = std::numeric_limits<double>::infinity();
  double high = -low;
  for (const double value : newest) {
    if (!std::isfinite(value)) continue;
    low = std::min(low, value);
    high = std::max(high, value);
  }
  std::string line;
  for (const double value : newest) {
    if (!std::isfinite(value)) {
      line += unicode ? "·" : " ";
      continue;
    }
    const double share = high > low ? (value - low) / (high - low) : 0.5;
    const auto bar = static_cast<std::size_t>(std::min(7.0, std::floor(8.0 * share)));
    line += unicode ? kBars[bar] : kPlain[bar];
  }
  return line;
}

}  // namespace slabd::cli::trend
