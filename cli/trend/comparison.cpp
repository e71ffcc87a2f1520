// SPDX-License-Identifier: Apache-2.0
#include "cli/trend/comparison.h"

#include <algorithm>
#include <cmath>

namespace slabd::cli::trend {

std::vector<PlaceDifference> differences_of(const std::vector<Item>& a, const std::vector<Item>& b) {
  std::vector<PlaceDifference> list;
  for (const Item& item : a) {
    const auto same = std::find_if(b.begin(), b.end(), [&](const Item& other) {
      return other.id == item.id && other.station == item.station && other.station_to == item.station_to;
    });
    if (same == b.end()) continue;
    PlaceDifference place{item, *same};
    place.difference = same->value - item.value;
    place.U = std::hypot(item.U, same->U);
    if (place.U > 0.0) place.en = std::abs(place.difference) / place.U;
    list.push_back(place);
  }
  std::stable_sort(list.begin(), list.end(), [](const PlaceDifference& x, const PlaceDifference& y) {
    return (has_value(x.en) ? x.en : -1.0) > (has_value(y.en) ? y.en : -1.0);
  });
  return list;
}

PeriodDifference difference_of(Trend before, Trend after, std::size_t comparisons) {
  PeriodDifference result{std::move(before), std::move(after), {}};
  const auto spread = [](const Trend& trend) {
    std::vector<double> values;
    for (const Point& point : trend.points)
      if (has_value(point.value)) values.push_back(point.value);
    return study::spread_of(values);
  };
  const study::Spread a = spread(result.before);
  const study::Spread b = spread(result.after);
  result.difference.value = b.mean - a.mean;
  if (a.count < 2 || b.count < 2) return result;
  const auto n_a = static_cast<double>(a.count);
  const auto n_b = static_cast<double>(b.count);
  const double var_a = a.std * a.std / n_a;
  const double var_b = b.std * b.std / n_b;
  if (!(var_a + var_b > 0.0)) return result;
  const double nu = (var_a + var_b) * (var_a + var_b) / (var_a * var_a / (n_a - 1.0) + var_b * var_b / (n_b - 1.0));
  const double outside = 0.025 / static_cast<double>(std::max<std::size_t>(comparisons, 1));
  const double half = study::student_quantile(1.0 - outside, nu) * std::sqrt(var_a + var_b);
  result.difference.low = result.difference.value - half;
  result.difference.high = result.difference.value + half;
  return result;
}

}  // namespace slabd::cli::trend
