// SPDX-License-Identifier: Apache-2.0
#include "cli/trend/trend_figure.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "report/figures.h"
#include "report/json.h"

namespace slabd::cli::trend {
namespace {

using report::Anchor;
using report::Canvas;
using report::Colour;
using report::Language;
using report::pick;
using report::TextStyle;

constexpr Colour kLimit{0.62, 0.05, 0.10};

/// One panel of the chart: values from left to right, scaled to the lowest and highest drawn value.
struct Panel {
  double top = 0.0;
  double height = 0.0;
  double low = 0.0;
  double high = 1.0;
  std::size_t count = 1;
  static constexpr double kLeft = 20.0;
  static constexpr double kWidth = 142.0;

  [[nodiscard]] double x(std::size_t i) const {
    return kLeft + kWidth * (static_cast<double>(i) + 0.5) / static_cast<double>(count);
  }
  [[nodiscard]] double y(double value) const { return top + height * (high - value) / (high - low); }
};

void level(Canvas& canvas, const Panel& panel, double value, std::string_view label, Colour colour, bool dashed,
           int digits) {
  if (!has_value(value) || value < panel.low || value > panel.high) return;
  const double y = panel.y(value);
  canvas.line(Panel::kLeft, y, Panel::kLeft + Panel::kWidth, y, 0.25, colour, dashed);
  canvas.text(Panel::kLeft + Panel::kWidth + 1.0, y + 0.8, fmt::format("{} {}", label, figure(value, digits)),
              {5.5, false, colour, Anchor::left});
}

void points(Canvas& canvas, const Panel& panel, const std::vector<double>& values, const std::vector<Signal>& signals,
            Colour colour) {
  for (std::size_t i = 0; i + 1 < values.size(); ++i)
    canvas.line(panel.x(i), panel.y(values[i]), panel.x(i + 1), panel.y(values[i + 1]), 0.2, colour);
  const double radius = values.size() > 150 ? 0.4 : 0.7;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const Signal signal = i < signals.size() ? signals[i] : Signal::none;
    if (signal == Signal::none) {
      canvas.circle(panel.x(i), panel.y(values[i]), radius, colour);
    } else if (signal == Signal::beyond_limits) {
      canvas.symbol(Verdict::fail, panel.x(i), panel.y(values[i]), 2.6, kLimit);
    } else {
      canvas.rectangle(panel.x(i) - radius, panel.y(values[i]) - radius, 2.0 * radius, 2.0 * radius, report::kWhite,
                       kLimit, 0.3);
    }
  }
}

void include(Panel& panel, double value) {
  if (!has_value(value)) return;
  panel.low = std::min(panel.low, value);
  panel.high = std::max(panel.high, value);
}

void widen(Panel& panel) {
  const double margin = std::max(0.08 * (panel.high - panel.low), 1e-6);
  panel.low -= margin;
  panel.high += margin;
}

/// True if both have the same requirement; an item with other limits is another characteristic.
bool same_requirement(const Item& a, const Item& b) {
  const auto same = [](double x, double y) { return x == y || (!has_value(x) && !has_value(y)); };
  return same(a.nominal, b.nominal) && same(a.lower, b.lower) && same(a.upper, b.upper);
}

using Requirements = std::map<int, const Item*>;  // by block

/// Limits of the newest slab. A block without a value in it gets the limits of another block.
Requirements newest_requirements(const std::vector<storage::ItemValue>& values) {
  Requirements newest;
  const auto is_judged = [](const storage::ItemValue& v) {  // or at least measured; other items have no limits
    return has_value(v.item.value) || has_value(v.item.nominal) || has_value(v.item.lower) || has_value(v.item.upper);
  };
  const auto last = std::find_if(values.rbegin(), values.rend(), is_judged);
  if (last == values.rend()) return newest;
  for (const storage::ItemValue& value : values) newest[value.item.station] = &last->item;
  for (const storage::ItemValue& value : values)
    if (value.slab_key == last->slab_key && is_judged(value)) newest[value.item.station] = &value.item;
  return newest;
}

/// Capability of the worst block. It is not computed for all blocks together, because differences between blocks are
/// not the scatter of the process from slab to slab.
void judge_blocks(std::span<const Placed> placed, const Requirements& newest, Trend& trend) {
  std::map<int, std::vector<double>> by_station;
  for (const Placed& value : placed) by_station[value.station].push_back(value.value);
  for (const auto& [station, values] : by_station) {
    const Individuals chart = individuals(values);
    const Item& judged_by = *newest.at(station);
    const Capability capable = capability(chart, judged_by.lower, judged_by.upper);
    if (!has_value(capable.cpk.value)) continue;
    if (has_value(trend.capable.cpk.value) && trend.capable.cpk.value <= capable.cpk.value) continue;
    trend.capable = capable;
    trend.singles = chart;
    trend.capable_block = station;
  }
}

}  // namespace

std::string index_text(const Index& index) {
  return has_value(index.value) ? fmt::format("{:.2f} ({:.2f} .. {:.2f})", index.value, index.low, index.high) : "-";
}

Trend trend_of(ItemId item, int block, const std::vector<storage::ItemValue>& values) {
  Trend trend;
  trend.item = item;
  trend.block = block;
  if (!values.empty()) trend.slab_type = values.back().slab_type;
  const Requirements newest = newest_requirements(values);
  std::set<std::int64_t> lacking;
  std::map<std::int64_t, std::vector<const storage::ItemValue*>> slabs;
  for (const storage::ItemValue& value : values) {
    if (!has_value(value.item.value)) {
      ++trend.not_measured;
      lacking.insert(value.slab_key);
    } else if (!same_requirement(value.item, *newest.at(value.item.station))) {
      ++trend.other_limits;
    } else {
      slabs[value.slab_key].push_back(&value);
    }
  }
  std::size_t most = 0;
  for (const auto& [key, list] : slabs) most = std::max(most, list.size());
  trend.is_mean = most > 1;
  if (trend.is_mean)
    for (const std::int64_t key : lacking) trend.incomplete += slabs.contains(key) ? 0U : 1U;
  std::vector<Placed> placed;
  for (const auto& [key, list] : slabs) {
    double sum = 0.0;
    for (const storage::ItemValue* value : list) {
      placed.push_back({key, value->item.station, value->item.value});
      sum += value->item.value;
      trend.nominal = value->item.nominal;
      trend.lower = value->item.lower;
      trend.upper = value->item.upper;
    }
    // The mean of fewer blocks is another quantity: a missing block would look like a shift.
    if (list.size() < most) {
      ++trend.incomplete;
      continue;
    }
    trend.keys.push_back(key);
    trend.ids.push_back(list.front()->slab_id);
    trend.began_utime_us.push_back(list.front()->began_utime_us);
    trend.values.push_back(sum / static_cast<double>(list.size()));
  }
  trend.chart = individuals(trend.values);
  if (trend.is_mean) {
    if (!trend.chart.preliminary()) judge_blocks(placed, newest, trend);
    trend.stations = station_biases(placed);
  } else {
    trend.singles = trend.chart;
    trend.capable = capability(trend.singles, trend.lower, trend.upper);
    trend.capable_block = block;
  }
  return trend;
}

report::Figure chart_figure(const Trend& trend, Language language) {
  report::Figure result;
  const int digits = decimals(trend.item);
  result.width_mm = 180.0;
  result.height_mm = 112.0;
  result.title = fmt::format("{} [{}]{}", report::item_word(trend.item, language), name(info(trend.item).unit),
                             trend.block != 0 ? fmt::format(", {} {}", pick(language, "block", "承轨台"), trend.block)
                             : trend.is_mean  ? pick(language, ", mean of each slab", "，每板平均值")
                                              : std::string());
  if (trend.slab_type != 0)
    result.title += fmt::format(", {} {}", report::word(report::Word::slab_type, language), trend.slab_type);
  result.alt = fmt::format("{}: n = {}, {} {}", result.title, trend.chart.count, pick(language, "mean", "平均值"),
                           figure(trend.chart.mean, digits));
  result.draw = [&trend, language, digits](Canvas& canvas) {
    if (trend.values.empty()) {
      canvas.text(2.0, 10.0, pick(language, "no values", "没有数据"), {9.0, false, report::kGrey, Anchor::left});
      return;
    }
    const Individuals& chart = trend.chart;
    const Colour ink = chart.preliminary() ? Colour{0.45, 0.45, 0.45} : Colour{0.12, 0.25, 0.42};
    std::vector<double> ranges;
    for (std::size_t i = 1; i < trend.values.size(); ++i)
      ranges.push_back(std::abs(trend.values[i] - trend.values[i - 1]));

    Panel upper{4.0, 62.0, trend.values[0], trend.values[0], trend.values.size()};
    for (const double value : trend.values) include(upper, value);
    include(upper, chart.lower_control);
    include(upper, chart.upper_control);
    // Tolerances are included if the values remain readable.
    const double spread = std::max(upper.high - upper.low, 1e-9);
    for (const double limit : {trend.lower, trend.upper})
      if (has_value(limit) && std::abs(limit - chart.mean) < 4.0 * spread) include(upper, limit);
    widen(upper);
    canvas.rectangle(Panel::kLeft, upper.top, Panel::kWidth, upper.height, std::nullopt, report::kGrey, 0.15);
    level(canvas, upper, trend.lower, pick(language, "limit", "限值"), kLimit, false, digits);
    level(canvas, upper, trend.upper, pick(language, "limit", "限值"), kLimit, false, digits);
    level(canvas, upper, chart.lower_control, "LCL", ink, true, digits);
    level(canvas, upper, chart.upper_control, "UCL", ink, true, digits);
    level(canvas, upper, chart.mean, "mean", ink, false, digits);
    points(canvas, upper, trend.values, chart.signals, ink);
    canvas.text(0.0, upper.top + 3.0, "I", {9.0, true, ink, Anchor::left});

    Panel lower{72.0, 28.0, 0.0, 1e-9, trend.values.size()};
    for (const double range : ranges) include(lower, range);
    include(lower, chart.range_control);
    lower.high += std::max(0.08 * lower.high, 1e-6);
    canvas.rectangle(Panel::kLeft, lower.top, Panel::kWidth, lower.height, std::nullopt, report::kGrey, 0.15);
    level(canvas, lower, chart.range_control, "UCL", ink, true, digits);
    level(canvas, lower, chart.moving_range, "mean", ink, false, digits);
    for (std::size_t i = 0; i < ranges.size(); ++i) {
      canvas.circle(lower.x(i + 1), lower.y(ranges[i]), 0.4, ink);
      if (i > 0) canvas.line(lower.x(i), lower.y(ranges[i - 1]), lower.x(i + 1), lower.y(ranges[i]), 0.15, ink);
    }
    canvas.text(0.0, lower.top + 3.0, "MR", {9.0, true, ink, Anchor::left});
    const TextStyle small{6.0, false, report::kGrey, Anchor::left};
    TextStyle right = small;
    right.anchor = Anchor::right;
    canvas.text(Panel::kLeft, 104.0, fmt::format("{} {}", trend.keys.front(), iso_time(trend.began_utime_us.front())),
                small);
    canvas.text(Panel::kLeft + Panel::kWidth, 104.0,
                fmt::format("{} {}", trend.keys.back(), iso_time(trend.began_utime_us.back())), right);
    if (chart.preliminary())
      canvas.text(Panel::kLeft + 2.0, upper.top + 4.0,
                  fmt::format(fmt::runtime(pick(language, "preliminary: {} of {} slabs", "数据不足：{} / {} 块板")),
                              chart.count, kValuesMin),
                  {8.0, true, report::kGrey, Anchor::left});
  };
  return result;
}

Table stations_table(const Trend& trend, Language language) {
  const int digits = decimals(trend.item);
  Table table{pick(language, "station", "测站"),
              pick(language, "slabs", "板数"),
              pick(language, "bias", "偏倚"),
              "+-2s",
              pick(language, "drift", "漂移"),
              "+-2s",
              "<"};
  table.title = pick(language, "Each station against the others of its slab", "各测站与同板其他测站之差");
  for (const StationBias& s : trend.stations)
    table.add(s.station, s.slabs, Cell(s.bias, digits), Cell(2.0 * s.bias_sigma, digits), Cell(s.drift, digits),
              Cell(2.0 * s.drift_sigma, digits),
              s.drifting() ? Cell(Verdict::indeterminate, pick(language, "drifts", "漂移"))
              : s.biased() ? pick(language, "biased", "偏倚")
                           : "");
  return table;
}

report::Report document_of(const Trend& trend, Language language) {
  const int digits = decimals(trend.item);
  report::Report document;
  document.language = language;
  document.judged = false;
  document.emulated = trend.emulated;
  document.title = pick(language, "Trend", "趋势");
  report::Figure chart = chart_figure(trend, language);
  document.subject = chart.title;
  report::Section section;
  section.parts.emplace_back(report::Figures{{std::move(chart)}});
  Table figures{pick(language, "figure", "名称"), pick(language, "value", "数值")};
  figures.title = pick(language, "Figures", "统计值");
  const auto add = [&](const std::string& key, const Cell& value) { figures.add(key, value); };
  add(pick(language, "slabs", "板数"), trend.chart.count);
  add(pick(language, "values not measured", "未测量"), trend.not_measured);
  add(pick(language, "values left out, judged by other limits than the newest", "已剔除：限值与最新板不同的数值"),
      trend.other_limits);
  if (trend.is_mean)
    add(pick(language, "slabs left out of the chart, a block's value missing", "已从图中剔除：缺少承轨台数值的板"),
        trend.incomplete);
  add(pick(language, "mean", "平均值"), figure(trend.chart.mean, digits));
  add(pick(language, "control limits", "控制限"),
      fmt::format("{} .. {}", figure(trend.chart.lower_control, digits), figure(trend.chart.upper_control, digits)));
  add(pick(language, "limits", "限值"),
      fmt::format("{} .. {}", figure(trend.lower, digits), figure(trend.upper, digits)));
  const std::string few =
      trend.chart.preliminary()
          ? fmt::format(fmt::runtime(pick(language, "not before {} slabs", "至少需要 {} 块板")), kValuesMin)
          : std::string();
  add("Cp (95 %)", few.empty() ? index_text(trend.capable.cp) : few);
  add("Cpk (95 %)", few.empty() ? index_text(trend.capable.cpk) : few);
  if (few.empty() && trend.is_mean && trend.capable_block != 0)
    add(pick(language, "Cp and Cpk are of", "Cp、Cpk 取自"),
        fmt::format(fmt::runtime(pick(language, "block {}, the worst, {} values", "最差的承轨台 {}，{} 个数值")),
                    trend.capable_block, trend.singles.count));
  section.parts.emplace_back(std::move(figures));
  if (!trend.stations.empty()) section.parts.emplace_back(stations_table(trend, language));
  document.sections.push_back(std::move(section));
  return document;
}

}  // namespace slabd::cli::trend
