// SPDX-License-Identifier: Apache-2.0
#include "cli/trend/multi_vari.h"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>

#include "cli/study/charts.h"
#include "report/figures.h"

namespace slabd::cli::trend {
namespace {

using report::Canvas;
using report::Language;
using report::pick;

constexpr std::size_t kThirds = 3;

/// Range and mean of one block in one third of the slabs.
struct Bar {
  double low = kNoValue;
  double high = kNoValue;
  double sum = 0.0;
  std::size_t count = 0;
  [[nodiscard]] double mean() const { return count == 0 ? kNoValue : sum / static_cast<double>(count); }
};
using Bars = std::map<int, std::array<Bar, kThirds>>;  // by station

Bars bars_of(const Trend& trend) {
  std::map<std::int64_t, std::size_t> order;  // of the slabs
  for (const Point& point : trend.points) order.emplace(point.key, order.size());
  Bars bars;
  for (const Placed& value : trend.placed) {
    Bar& bar = bars[value.station].at(kThirds * order.at(value.slab_key) / order.size());
    bar.low = std::fmin(bar.low, value.value);
    bar.high = std::fmax(bar.high, value.value);
    bar.sum += value.value;
    ++bar.count;
  }
  return bars;
}

}  // namespace

Sources sources_of(const Trend& trend) {
  std::set<std::int64_t> complete;
  for (const Point& point : trend.points)
    if (has_value(point.value)) complete.insert(point.key);
  const auto slabs = static_cast<double>(complete.size());
  const auto blocks = static_cast<double>(trend.places);
  if (slabs < 3.0 || blocks < 3.0) return {};
  std::map<std::int64_t, double> by_slab;
  std::map<int, double> by_block;
  double all = 0.0;
  std::vector<Placed> used;
  for (const Placed& value : trend.placed) {
    if (!complete.contains(value.slab_key)) continue;
    used.push_back(value);
    all += value.value / (slabs * blocks);
  }
  for (const Placed& value : used) {
    by_slab[value.slab_key] += (value.value - all) / blocks;
    by_block[value.station] += (value.value - all) / slabs;
  }
  if (by_block.size() != trend.places) return {};
  double of_slabs = 0.0;
  double of_blocks = 0.0;
  double of_rest = 0.0;
  for (const auto& [key, effect] : by_slab) of_slabs += effect * effect / (slabs - 1.0);
  for (const auto& [station, effect] : by_block) of_blocks += effect * effect / (blocks - 1.0);
  for (const Placed& value : used) {
    const double rest = value.value - all - by_slab.at(value.slab_key) - by_block.at(value.station);
    of_rest += rest * rest / ((slabs - 1.0) * (blocks - 1.0));
  }
  of_slabs = std::max(0.0, of_slabs - of_rest / blocks);
  of_blocks = std::max(0.0, of_blocks - of_rest / slabs);
  const double sum = of_slabs + of_blocks + of_rest;
  if (!(sum > 0.0)) return {};
  return {of_blocks / sum, of_slabs / sum, of_rest / sum};
}

report::Figure multi_vari_figure(const Trend& trend, Language language) {
  report::Figure result;
  const Bars bars = bars_of(trend);
  const Sources sources = sources_of(trend);
  result.width_mm = 180.0;
  result.height_mm = 74.0;
  result.title = pick(language, "Multi-vari: each block in the first, middle and last third of the slabs",
                      "多变异图：各承轨台在前、中、后三分之一板中的范围");
  result.alt = result.title + ":";
  for (const auto& [station, thirds] : bars)
    result.alt +=
        fmt::format(" {}: {} / {} / {};", station, report::figure(thirds[0].mean(), report::decimals(trend.item)),
                    report::figure(thirds[1].mean(), report::decimals(trend.item)),
                    report::figure(thirds[2].mean(), report::decimals(trend.item)));
  std::string variance;
  if (has_value(sources.rest))
    variance = fmt::format(
        fmt::runtime(pick(language, "variance: {:.0f} % between blocks, {:.0f} % between slabs, {:.0f} % rest",
                          "方差：承轨台之间 {:.0f} %，板之间 {:.0f} %，其余 {:.0f} %")),
        100.0 * sources.blocks, 100.0 * sources.slabs, 100.0 * sources.rest);
  result.draw = [bars, &trend, variance, language](Canvas& canvas) {
    study::Chart chart(16.0, 2.0, 146.0, 58.0);
    double low = kNoValue;
    double high = kNoValue;
    for (const auto& [station, thirds] : bars)
      for (const Bar& bar : thirds) {
        low = std::fmin(low, bar.low);
        high = std::fmax(high, bar.high);
      }
    chart.include_y(low);
    chart.include_y(high);
    // Limits are drawn if the bars remain readable.
    for (const double limit : {trend.lower, trend.upper})
      if (has_value(limit) && limit > low - 2.0 * (high - low) && limit < high + 2.0 * (high - low))
        chart.include_y(limit);
    chart.include_x(0.5);
    chart.include_x(static_cast<double>(bars.size()) + 0.5);
    chart.settle();
    chart.frame(canvas);
    chart.scales(canvas, -1, report::decimals(trend.item));
    chart.level(canvas, trend.lower, pick(language, "lower limit", "下限"), study::kChartLimit, false);
    chart.level(canvas, trend.upper, pick(language, "upper limit", "上限"), study::kChartLimit, false);
    double place = 0.0;
    for (const auto& [station, thirds] : bars) {
      place += 1.0;
      chart.tick_x(canvas, place, std::to_string(station));
      double x_before = kNoValue;
      double y_before = kNoValue;
      for (std::size_t third = 0; third < kThirds; ++third) {
        const Bar& bar = thirds.at(third);
        if (bar.count == 0) continue;
        const double x = chart.x(place + 0.26 * (static_cast<double>(third) - 1.0));
        const bool beyond = bar.low < trend.lower || bar.high > trend.upper;
        canvas.line(x, chart.y(bar.low), x, chart.y(bar.high), 0.9,
                    beyond ? study::kChartLimit : report::Colour{0.62, 0.70, 0.80});
        const double y = chart.y(bar.mean());
        if (has_value(x_before)) canvas.line(x_before, y_before, x, y, 0.25, study::kChartInk);
        canvas.circle(x, y, 0.6, study::kChartInk);
        x_before = x;
        y_before = y;
      }
    }
    canvas.text(16.0, 69.5,
                pick(language, "bar: range; dot: mean; red: a value outside the limits",
                     "条：范围；点：均值；红：有数值超出限值"),
                {6.0, false, report::kGrey, report::Anchor::left});
    canvas.text(162.0, 69.5, variance, {6.0, true, report::kBlack, report::Anchor::right});
  };
  return result;
}

}  // namespace slabd::cli::trend
