// SPDX-License-Identifier: Apache-2.0
#include "cli/trend/series.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

namespace slabd::cli::trend {
namespace {

using report::Language;
using report::pick;
using study::Judgement;

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

bool is_outside(const Item& item) {
  return item.value < item.lower || item.value > item.upper;
}

/// Short-term capability. The scatter of a size is that of its logarithm, because it has one long tail.
Capability capability_within(std::span<const double> values, const Individuals& chart, const Item& judged_by) {
  const bool is_size = info(judged_by.id).is_size && !has_value(judged_by.lower) && judged_by.upper > 0.0;
  if (!is_size || std::any_of(values.begin(), values.end(), [](double value) { return value <= 0.0; }))
    return capability(chart, judged_by.lower, judged_by.upper);
  std::vector<double> logs;
  for (const double value : values) logs.push_back(std::log(value));
  return capability(individuals(logs), kNoValue, std::log(judged_by.upper));
}

class Builder {
 public:
  Builder(ItemId item, int block, const std::vector<storage::ItemValue>& values)
      : values_(values), newest_(newest_requirements(values)) {
    trend_.item = item;
    trend_.block = block;
    if (!values.empty()) trend_.slab_type = values.back().slab_type;
  }

  Trend build() {
    for (const storage::ItemValue& value : values_) take(value);
    for (const auto& [key, list] : slabs_) trend_.places = std::max(trend_.places, list.size());
    if (trend_.places > 1)
      trend_.value_is = info(trend_.item).scope == ItemScope::seat_in_slab ? ValueIs::largest : ValueIs::mean;
    for (const std::int64_t key : keys_) add_point(key);
    chart();
    const bool is_single = trend_.value_is == ValueIs::single;
    if (is_single) trend_.singles = trend_.chart;
    if (!trend_.chart.preliminary() || is_single) judge_blocks();
    if (!is_single) trend_.stations = station_biases(trend_.placed);
    whole();
    judge();
    return std::move(trend_);
  }

 private:
  void take(const storage::ItemValue& value) {
    if (!has_value(value.item.value)) {
      ++trend_.not_measured;
    } else if (!same_requirement(value.item, *newest_.at(value.item.station))) {
      ++trend_.other_limits;
      return;
    } else {
      slabs_[value.slab_key].push_back(&value);
    }
    // A slab without a single value is a gap of the chart.
    if (keys_.empty() || keys_.back() != value.slab_key) keys_.push_back(value.slab_key);
    headers_.try_emplace(value.slab_key, &value);
  }

  void add_point(std::int64_t key) {
    const auto found = slabs_.find(key);
    const storage::ItemValue& header = *headers_.at(key);
    Point point{key, header.slab_id, header.began_utime_us};
    if (found != slabs_.end()) fill(point, found->second);
    if (!has_value(point.value) && trend_.value_is != ValueIs::single) ++trend_.incomplete;
    trend_.points.push_back(point);
  }

  void fill(Point& point, const std::vector<const storage::ItemValue*>& list) {
    double sum = 0.0;
    double largest = 0.0;
    for (const storage::ItemValue* value : list) {
      const Item& item = value->item;
      trend_.placed.push_back({point.key, item.station, item.value});
      sum += item.value;
      largest = std::max(largest, std::abs(item.deviation()));
      const double drawn = trend_.value_is == ValueIs::largest ? item.deviation() : item.value;
      point.lowest = std::fmin(point.lowest, drawn);
      point.highest = std::fmax(point.highest, drawn);
      if (is_outside(item)) {
        ++point.outside;
        trend_.outside.push_back({point.key, point.id, item});
      }
      trend_.nominal = item.nominal;
      trend_.lower = item.lower;
      trend_.upper = item.upper;
    }
    point.blocks = list.size();
    if (list.size() < trend_.places) return;
    point.value = trend_.value_is == ValueIs::largest ? largest : sum / static_cast<double>(list.size());
  }

  void chart() {
    std::vector<double> complete;
    std::vector<Point*> of;
    for (Point& point : trend_.points) {
      if (!has_value(point.value)) continue;
      complete.push_back(point.value);
      of.push_back(&point);
    }
    trend_.chart = individuals(complete);
    for (std::size_t i = 0; i < of.size(); ++i) of[i]->signal = trend_.chart.signals[i];
    // A size is never below zero, so it has no lower control limit there. A gauge item may have a sign by its formula.
    const bool has_sign = std::any_of(complete.begin(), complete.end(), [](double value) { return value < 0.0; });
    const bool is_size = (info(trend_.item).is_size && !has_sign) || trend_.value_is == ValueIs::largest;
    if (is_size && trend_.chart.lower_control < 0.0) trend_.chart.lower_control = kNoValue;
  }

  /// Capability of the worst block. It is not computed for all blocks together, because differences between blocks are
  /// not the scatter of the process from slab to slab.
  void judge_blocks() {
    std::map<int, std::vector<double>> by_station;
    for (const Placed& value : trend_.placed) by_station[value.station].push_back(value.value);
    for (const auto& [station, values] : by_station) {
      const Individuals chart = individuals(values);
      const Capability capable = capability_within(values, chart, *newest_.at(station));
      if (!has_value(capable.cpk.value)) continue;
      if (has_value(trend_.capable.cpk.value) && trend_.capable.cpk.value <= capable.cpk.value) continue;
      trend_.capable = capable;
      trend_.singles = chart;
      trend_.capable_block = trend_.value_is == ValueIs::single ? trend_.block : station;
    }
  }

  /// Performance of all values together. Blocks with other nominals are compared by their deviations.
  void whole() {
    std::vector<double> deviations;
    bool comparable = true;
    double lower = kNoValue;
    double upper = kNoValue;
    const auto offset = [](const Item& item) { return has_value(item.nominal) ? item.nominal : 0.0; };
    const auto differ = [](double a, double b) { return has_value(a) != has_value(b) || std::abs(a - b) > 1e-9; };
    for (const Placed& value : trend_.placed) {
      const Item& item = *newest_.at(value.station);
      const double low = item.lower - offset(item);
      const double high = item.upper - offset(item);
      if (deviations.empty()) {
        lower = low;
        upper = high;
      }
      trend_.limits_differ =
          trend_.limits_differ || differ(item.lower, trend_.lower) || differ(item.upper, trend_.upper);
      comparable = comparable && !differ(low, lower) && !differ(high, upper);
      deviations.push_back(value.value - offset(item));
    }
    trend_.values = deviations.size();
    const std::size_t values_min = trend_.chart.preliminary() || !comparable ? SIZE_MAX : kValuesMin;
    trend_.whole = performance(deviations, lower, upper, info(trend_.item).is_size, values_min);
    if (!has_value(lower) && !has_value(upper)) return;
    trend_.whole.outside.count = trend_.outside.size();
    trend_.whole.outside.share = study::share_of(trend_.outside.size(), trend_.values);
  }

  /// Nothing is capable by default: enough slabs, a stable process, nothing outside, and whole intervals above 1.33.
  void judge() {
    const study::Estimate& ppk = trend_.whole.ppk;
    const bool has_limits = has_value(trend_.lower) || has_value(trend_.upper);
    if (!has_limits || trend_.values == 0) return;
    trend_.judgement = Judgement::undecided;
    if (trend_.whole.outside.share.low > kShareCapable || ppk.high < kCapable || trend_.capable.cpk.high < kCapable) {
      trend_.judgement = Judgement::not_capable;
    } else if (!trend_.chart.preliminary() && trend_.is_stable() && trend_.outside.empty() && ppk.low >= kCapable &&
               trend_.capable.cpk.low >= kCapable) {
      trend_.judgement = Judgement::capable;
    }
  }

  const std::vector<storage::ItemValue>& values_;
  Requirements newest_;
  std::map<std::int64_t, std::vector<const storage::ItemValue*>> slabs_;
  std::map<std::int64_t, const storage::ItemValue*> headers_;
  std::vector<std::int64_t> keys_;
  Trend trend_;
};

}  // namespace

std::size_t Trend::signals() const {
  return static_cast<std::size_t>(
      std::count_if(points.begin(), points.end(), [](const Point& point) { return point.signal != Signal::none; }));
}

bool Trend::is_stable() const {
  return !(study::share_of(signals(), chart.count).low > kSignalsByChance);
}

Trend trend_of(ItemId item, int block, const std::vector<storage::ItemValue>& values) {
  return Builder(item, block, values).build();
}

std::string judgement_reason(const Trend& trend, Language language) {
  const study::Estimate& ppk = trend.whole.ppk;
  const study::Estimate& cpk = trend.capable.cpk;
  if (!trend.outside.empty())
    return fmt::format(fmt::runtime(pick(language, "{} of {} values outside the limits", "{} / {} 个数值超出限值")),
                       trend.outside.size(), trend.values);
  if (trend.judgement == Judgement::capable || trend.judgement == Judgement::not_judged) return {};
  if (ppk.high < kCapable) return pick(language, "Ppk below 1.33", "Ppk 低于 1.33");
  if (cpk.high < kCapable) return pick(language, "Cpk below 1.33", "Cpk 低于 1.33");
  if (trend.chart.preliminary())
    return fmt::format(fmt::runtime(pick(language, "{} slabs of {}", "{} / {} 块板")), trend.chart.count, kValuesMin);
  if (!trend.is_stable())
    return fmt::format(fmt::runtime(pick(language, "not stable: {} of {} slabs", "不稳定：{} / {} 块板")),
                       trend.signals(), trend.chart.count);
  if (!has_value(ppk.value))
    return pick(language, "no scatter, or limits that differ between blocks", "无散布，或各承轨台限值不同");
  if (trend.whole.model == Model::percentiles) return pick(language, "no distribution fits", "无合适的分布");
  return pick(language, "the interval of Cpk or Ppk contains 1.33", "Cpk 或 Ppk 的区间包含 1.33");
}

std::string signal_words(Signal signal, Language language) {
  switch (signal) {
    case Signal::none: break;
    case Signal::beyond_limits: return pick(language, "beyond the control limits", "超出控制限");
    case Signal::jump: return pick(language, "jump: moving range above its limit", "跳变：移动极差超限");
    case Signal::nine_on_one_side: return pick(language, "nine in a row on one side of the mean", "连续九点在均值同侧");
  }
  return {};
}

std::vector<std::string> signal_lines(const Trend& trend, Language language) {
  std::vector<std::string> lines;
  const auto named = [](const Point& point) { return fmt::format("{} \"{}\"", point.key, point.id.view()); };
  for (std::size_t i = 0; i < trend.points.size(); ++i) {
    const Signal signal = trend.points[i].signal;
    if (signal == Signal::none) continue;
    std::size_t last = i;
    std::size_t count = 1;
    // Slabs between that have no value in the chart do not interrupt a run.
    for (std::size_t k = i + 1; k < trend.points.size(); ++k) {
      if (!has_value(trend.points[k].value)) continue;
      if (trend.points[k].signal != signal) break;
      last = k;
      ++count;
    }
    const std::string colon = pick(language, ": ", "：");
    const std::string slab = std::string(report::word(report::Word::slab_word, language));
    lines.push_back(count == 1
                        ? fmt::format("{}{}{} {}", signal_words(signal, language), colon, slab, named(trend.points[i]))
                        : fmt::format("{}{}{} {} .. {} ({})", signal_words(signal, language), colon, slab,
                                      named(trend.points[i]), named(trend.points[last]), count));
    i = last;
  }
  return lines;
}

}  // namespace slabd::cli::trend
