// SPDX-License-Identifier: Apache-2.0
#include "cli/trend/trend_figure.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "report/figures.h"
#include "report/json.h"

namespace slabd::cli::trend {
namespace {

using report::Anchor;
using report::Canvas;
using report::Colour;
using report::kBlack;
using report::Language;
using report::pick;
using report::TextStyle;

constexpr Colour kLimit{0.62, 0.05, 0.10};
constexpr Colour kSignal{0.85, 0.45, 0.0};
constexpr Colour kRange{0.62, 0.70, 0.80};

/// The upper limit of the chart's values; sizes of deviations have the larger of both.
double largest_limit(const Trend& trend) {
  if (trend.value_is != ValueIs::largest) return trend.upper;
  return std::fmax(std::abs(trend.lower - trend.nominal), std::abs(trend.upper - trend.nominal));
}
double lowest_limit(const Trend& trend) {
  return trend.value_is == ValueIs::largest ? kNoValue : trend.lower;
}

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

/// Level lines with labels at the right end, moved apart where they would cover each other.
class Levels {
 public:
  Levels(Canvas& canvas, const Panel& panel, int digits) : canvas_(canvas), panel_(panel), digits_(digits) {}

  void add(double value, const std::string& label, Colour colour, bool dashed) {
    if (!has_value(value) || value < panel_.low || value > panel_.high) return;
    list_.push_back({panel_.y(value), fmt::format("{} {}", label, report::figure(value, digits_)), colour, dashed});
  }
  void draw() {
    constexpr double kStep_mm = 2.3;
    std::sort(list_.begin(), list_.end(), [](const Level& a, const Level& b) { return a.y < b.y; });
    double free = panel_.top - kStep_mm;
    for (const Level& level : list_) {
      canvas_.line(Panel::kLeft, level.y, Panel::kLeft + Panel::kWidth, level.y, 0.25, level.colour, level.dashed);
      const double y = std::max(level.y, free + kStep_mm);
      canvas_.text(Panel::kLeft + Panel::kWidth + 1.0, y + 0.8, level.text, {5.5, false, level.colour, Anchor::left});
      free = y;
    }
  }

 private:
  struct Level {
    double y;
    std::string text;
    Colour colour;
    bool dashed;
  };
  Canvas& canvas_;
  const Panel& panel_;
  int digits_;
  std::vector<Level> list_;
};

/// The mark of a rule: a cross beyond the control limits, a square for a jump, a diamond for a run.
void mark(Canvas& canvas, Signal signal, double x, double y, double radius, Colour colour) {
  switch (signal) {
    case Signal::none: canvas.circle(x, y, radius, colour); break;
    case Signal::beyond_limits: canvas.symbol(Verdict::fail, x, y, 2.6, kSignal); break;
    case Signal::jump: canvas.rectangle(x - 0.8, y - 0.8, 1.6, 1.6, report::kWhite, kSignal, 0.35); break;
    case Signal::nine_on_one_side: canvas.circle(x, y, 0.9, report::kWhite, kSignal, 0.35); break;
  }
}

/// The range of a slab's single values, and those of its ends that are outside the limits.
void whisker(Canvas& canvas, const Panel& panel, double x, const Point& point, const Trend& trend) {
  if (!has_value(point.lowest) || trend.value_is == ValueIs::single) return;
  const bool is_largest = trend.value_is == ValueIs::largest;
  const double low = is_largest ? std::fmin(std::abs(point.lowest), std::abs(point.highest)) : point.lowest;
  const double high = is_largest ? std::fmax(std::abs(point.lowest), std::abs(point.highest)) : point.highest;
  if (!is_largest) canvas.line(x, panel.y(low), x, panel.y(high), 0.15, kRange);
  if (point.outside == 0) return;
  for (const double end : {low, high})
    if ((end < trend.lower && !is_largest) || end > largest_limit(trend))
      canvas.symbol(Verdict::fail, x, panel.y(end), 2.2, kLimit);
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

/// Values, ranges and levels of the upper panel.
void draw_values(Canvas& canvas, const Trend& trend, Colour ink, int digits, Language language) {
  const Individuals& chart = trend.chart;
  Panel panel{4.0, 62.0, INFINITY, -INFINITY, trend.points.size()};
  for (const Point& point : trend.points)
    for (const double value : {point.value, point.lowest, point.highest})
      include(panel, trend.value_is == ValueIs::largest ? std::abs(value) : value);
  include(panel, chart.lower_control);
  include(panel, chart.upper_control);
  if (!(panel.low <= panel.high)) panel.low = panel.high = 0.0;
  // Tolerances are included if the values remain readable.
  const double spread = std::max(panel.high - panel.low, 1e-9);
  for (const double limit : {lowest_limit(trend), largest_limit(trend)})
    if (has_value(limit) && std::abs(limit - chart.mean) < 4.0 * spread) include(panel, limit);
  widen(panel);
  canvas.rectangle(Panel::kLeft, panel.top, Panel::kWidth, panel.height, std::nullopt, report::kGrey, 0.15);
  Levels levels(canvas, panel, digits);
  levels.add(lowest_limit(trend), pick(language, "lower limit", "下限"), kLimit, false);
  levels.add(largest_limit(trend), pick(language, "upper limit", "上限"), kLimit, false);
  levels.add(chart.lower_control, "LCL", ink, true);
  levels.add(chart.upper_control, "UCL", ink, true);
  levels.add(chart.mean, pick(language, "mean", "均值"), ink, false);
  levels.draw();
  const double radius = trend.points.size() > 150 ? 0.4 : 0.7;
  const Point* before = nullptr;
  double x_before = 0.0;
  for (std::size_t i = 0; i < trend.points.size(); ++i) {
    const Point& point = trend.points[i];
    const double x = panel.x(i);
    whisker(canvas, panel, x, point, trend);
    if (!has_value(point.value)) {
      canvas.symbol(Verdict::not_measured, x, panel.top + panel.height - 2.0, 2.4, report::kGrey);
      continue;
    }
    if (before != nullptr) canvas.line(x_before, panel.y(before->value), x, panel.y(point.value), 0.2, ink);
    before = &point;
    x_before = x;
  }
  for (std::size_t i = 0; i < trend.points.size(); ++i) {
    const Point& point = trend.points[i];
    if (!has_value(point.value)) continue;
    mark(canvas, point.signal, panel.x(i), panel.y(point.value), radius, ink);
    if (trend.value_is == ValueIs::single && point.outside > 0)
      canvas.symbol(Verdict::fail, panel.x(i), panel.y(point.value), 2.2, kLimit);
  }
  canvas.text(0.0, panel.top + 3.0, "I", {9.0, true, ink, Anchor::left});
  if (chart.preliminary())
    canvas.text(Panel::kLeft + 2.0, panel.top + 4.0,
                fmt::format(fmt::runtime(pick(language, "preliminary: {} of {} slabs", "数据不足：{} / {} 块板")),
                            chart.count, kValuesMin),
                {8.0, true, report::kGrey, Anchor::left});
}

/// Moving ranges from one complete slab to the next one.
void draw_ranges(Canvas& canvas, const Trend& trend, Colour ink, int digits, Language language) {
  Panel panel{72.0, 24.0, 0.0, 1e-9, trend.points.size()};
  std::vector<std::pair<std::size_t, double>> ranges;
  double before = kNoValue;
  for (std::size_t i = 0; i < trend.points.size(); ++i) {
    const double value = trend.points[i].value;
    if (!has_value(value)) continue;
    if (has_value(before)) ranges.emplace_back(i, std::abs(value - before));
    before = value;
  }
  for (const auto& [i, range] : ranges) include(panel, range);
  include(panel, trend.chart.range_control);
  panel.high += std::max(0.08 * panel.high, 1e-6);
  canvas.rectangle(Panel::kLeft, panel.top, Panel::kWidth, panel.height, std::nullopt, report::kGrey, 0.15);
  Levels levels(canvas, panel, digits);
  levels.add(trend.chart.range_control, "UCL", ink, true);
  levels.add(trend.chart.moving_range, pick(language, "mean", "均值"), ink, false);
  levels.draw();
  for (std::size_t k = 0; k < ranges.size(); ++k) {
    const auto& [i, range] = ranges[k];
    if (k > 0)
      canvas.line(panel.x(ranges[k - 1].first), panel.y(ranges[k - 1].second), panel.x(i), panel.y(range), 0.15, ink);
    const bool is_jump = trend.points[i].signal == Signal::jump;
    mark(canvas, is_jump ? Signal::jump : Signal::none, panel.x(i), panel.y(range), 0.4, ink);
  }
  canvas.text(0.0, panel.top + 3.0, "MR", {9.0, true, ink, Anchor::left});
}

/// The meaning of every mark that occurs.
void draw_legend(Canvas& canvas, const Trend& trend, Colour ink, Language language) {
  constexpr double kTop_mm = 105.5;
  double x = Panel::kLeft;
  double y = kTop_mm;
  const auto add = [&](const std::function<void(double, double)>& draw, const std::string& text) {
    const TextStyle style{6.0, false, kBlack, Anchor::left};
    const double width = 5.0 + canvas.text_width(text, style) + 4.0;
    if (x > Panel::kLeft && x + width > 180.0) {
      x = Panel::kLeft;
      y += 4.0;
    }
    draw(x + 1.5, y - 0.8);
    canvas.text(x + 4.0, y, text, style);
    x += width;
  };
  const std::string value = trend.value_is == ValueIs::mean ? pick(language, "mean of a slab", "每板平均值")
                            : trend.value_is == ValueIs::largest
                                ? pick(language, "largest deviation of a slab", "每板最大偏差")
                                : pick(language, "value", "数值");
  add([&](double at, double mid) { canvas.circle(at, mid, 0.7, ink); }, value);
  if (trend.value_is == ValueIs::mean)
    add([&](double at, double mid) { canvas.line(at, mid - 1.2, at, mid + 1.2, 0.3, kRange); },
        pick(language, "range of its blocks", "各承轨台范围"));
  if (!trend.outside.empty())
    add([&](double at, double mid) { canvas.symbol(Verdict::fail, at, mid, 2.2, kLimit); },
        pick(language, "a value outside the limits", "超出限值"));
  for (const Signal signal : {Signal::beyond_limits, Signal::jump, Signal::nine_on_one_side})
    if (std::any_of(trend.points.begin(), trend.points.end(), [&](const Point& p) { return p.signal == signal; }))
      add([&](double at, double mid) { mark(canvas, signal, at, mid, 0.7, ink); }, signal_words(signal, language));
  if (std::any_of(trend.points.begin(), trend.points.end(), [](const Point& p) { return !has_value(p.value); }))
    add([&](double at, double mid) { canvas.symbol(Verdict::not_measured, at, mid, 2.2, report::kGrey); },
        pick(language, "a block was not measured", "有承轨台未测量"));
}

}  // namespace

report::Figure chart_figure(const Trend& trend, Language language) {
  report::Figure result;
  const int digits = report::decimals(trend.item);
  result.width_mm = 180.0;
  result.height_mm = 116.0;
  result.title = fmt::format("{} [{}]", report::item_word(trend.item, language), name(info(trend.item).unit));
  if (trend.block != 0)
    result.title += fmt::format(", {} {}", pick(language, "block", "承轨台"), trend.block);
  else if (trend.value_is == ValueIs::mean)
    result.title += pick(language, ", mean of each slab", "，每板平均值");
  else if (trend.value_is == ValueIs::largest)
    result.title += pick(language, ", largest deviation of each slab", "，每板最大偏差");
  if (trend.slab_type != 0)
    result.title += fmt::format(", {} {}", report::word(report::Word::slab_type, language), trend.slab_type);
  result.alt = fmt::format("{}: n = {}, {} {}; {}", result.title, trend.chart.count, pick(language, "mean", "平均值"),
                           report::figure(trend.chart.mean, digits), judgement_text(trend, language));
  result.draw = [&trend, language, digits](Canvas& canvas) {
    if (trend.points.empty()) {
      canvas.text(2.0, 10.0, pick(language, "no values", "没有数据"), {9.0, false, report::kGrey, Anchor::left});
      return;
    }
    const Colour ink = trend.chart.preliminary() ? Colour{0.45, 0.45, 0.45} : Colour{0.12, 0.25, 0.42};
    draw_values(canvas, trend, ink, digits, language);
    draw_ranges(canvas, trend, ink, digits, language);
    const TextStyle small{6.0, false, report::kGrey, Anchor::left};
    TextStyle right = small;
    right.anchor = Anchor::right;
    const auto name_of = [](const Point& p) { return fmt::format("{} {}", p.key, report::iso_time(p.began_utime_us)); };
    canvas.text(Panel::kLeft, 99.5, name_of(trend.points.front()), small);
    canvas.text(Panel::kLeft + Panel::kWidth, 99.5, name_of(trend.points.back()), right);
    draw_legend(canvas, trend, ink, language);
  };
  return result;
}

}  // namespace slabd::cli::trend
