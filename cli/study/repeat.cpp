// SPDX-License-Identifier: Apache-2.0
#include "cli/study/repeat.h"

#include <fmt/core.h>

#include <algorithm>
#include <set>
#include <tuple>

#include "cli/exit.h"
#include "cli/terminal/render.h"
#include "config/config.h"
#include "daemon/measure.h"
#include "report/figures.h"
#include "report/json.h"

namespace slabd::cli::study {
namespace {

double known(const std::map<std::string, double>& of, const Reading& about) {
  const auto own = of.find(fmt::format("{}@{}", about.item, about.block));
  if (own != of.end()) return own->second;
  const auto all = of.find(about.item);
  return all == of.end() ? kNoValue : all->second;
}

std::string range_text(double low, double high, int digits) {
  return fmt::format("{} .. {}", figure(low, digits), figure(high, digits));
}

/// Scatter is small against values: a hundredth of a micrometre, a hundred-thousandth of a degree.
constexpr int kSmallDigits = 5;
std::string small(double value) {
  return figure(value, kSmallDigits);
}

void print_characteristics(const RepeatStudy& study) {
  std::vector<std::vector<std::string>> rows = {
      {"characteristic", "unit<", "n", "mean", "std", "95 % of std", "range", "max dev"}};
  for (const Characteristic& c : study.characteristics) {
    const int digits = decimals_of(c.about.item);
    rows.push_back(
        {title_of(c.about), unit_of(c.about.item),
         c.missing == 0 ? std::to_string(c.spread.count) : fmt::format("{} ({} missing)", c.spread.count, c.missing),
         figure(c.spread.mean, digits), small(c.spread.std),
         range_text(c.spread.std_low, c.spread.std_high, kSmallDigits), small(c.spread.range),
         small(c.spread.deviation_max)});
  }
  fmt::print("{}\n", table(rows));
}

/// What the paper says of its Figs. 18 and 19: the largest range of any block.
void print_worst(const RepeatStudy& study) {
  std::vector<std::vector<std::string>> rows = {
      {"characteristic", "unit<", "blocks", "missing", "worst std", "block<", "worst range", "block<"}};
  for (std::size_t i = 0; i < study.characteristics.size();) {
    const Characteristic* by_std = nullptr;
    const Characteristic* by_range = nullptr;
    std::size_t blocks = 0;
    std::size_t missing = 0;
    const std::string& item = study.characteristics[i].about.item;
    for (; i < study.characteristics.size() && study.characteristics[i].about.item == item; ++i, ++blocks) {
      const Characteristic& c = study.characteristics[i];
      missing += c.missing;
      if (has_value(c.spread.std) && (by_std == nullptr || c.spread.std > by_std->spread.std)) by_std = &c;
      if (has_value(c.spread.range) && (by_range == nullptr || c.spread.range > by_range->spread.range)) by_range = &c;
    }
    const auto at = [](const Characteristic* c) {
      return c == nullptr ? std::string("-") : block_text(c->about.block, c->about.block_to);
    };
    rows.push_back({item, unit_of(item), std::to_string(blocks), std::to_string(missing),
                    by_std == nullptr ? "-" : small(by_std->spread.std), at(by_std),
                    by_range == nullptr ? "-" : small(by_range->spread.range), at(by_range)});
  }
  fmt::print("{}\n", table(rows));
}

void print_gauges(const RepeatStudy& study, Style style) {
  std::vector<std::vector<std::string>> rows = {
      {"type-1 study", "reference", "T", "bias", "95 % of bias", "p", "Cg", "Cgk", "judgement<"}};
  for (const Characteristic& c : study.characteristics) {
    const Gauge& g = c.gauge;
    if (g.judgement == Judgement::not_judged) continue;
    const int digits = decimals_of(c.about.item);
    rows.push_back({title_of(c.about), figure(g.reference, digits), figure(g.tolerance, digits), small(g.bias),
                    range_text(g.bias_low, g.bias_high, kSmallDigits), figure(g.p, 3), figure(g.cg, 2),
                    figure(g.cgk, 2),
                    std::string(symbol(as_verdict(g.judgement), style)) + " " + std::string(name(g.judgement)) +
                        (g.reason.empty() ? "" : ": " + g.reason)});
  }
  if (rows.size() > 1)
    fmt::print("{}Cg = 0.2 T / (6 s), Cgk = (0.1 T - |bias|) / (3 s); capable from {} with {} runs\n", table(rows),
               kGaugeCapable, kGaugeRunsMin);
}

}  // namespace

Judgement RepeatStudy::judgement() const {
  Judgement worst = Judgement::not_judged;
  for (const Characteristic& c : characteristics) {
    const Judgement here = c.gauge.judgement;
    if (here == Judgement::not_capable || worst == Judgement::not_capable) {
      worst = Judgement::not_capable;
    } else if (here == Judgement::undecided || worst == Judgement::undecided) {
      worst = Judgement::undecided;
    } else if (here == Judgement::capable) {
      worst = here;
    }
  }
  return worst;
}

RepeatStudy repeat_study(std::span<const Take> takes, const std::vector<std::string>& items, int block,
                         const GaugeTask& task, bool scans) {
  RepeatStudy study;
  using Key = std::tuple<std::size_t, std::string, int, int>;
  std::map<Key, Characteristic> found;
  std::map<const Characteristic*, std::size_t> first;  // the run it came from
  for (std::size_t run = 0; run < takes.size(); ++run) {
    study.runs.push_back(takes[run].name);
    for (const Reading& reading : takes[run].readings) {
      if (block != 0 && reading.block != block) continue;
      if (!items.empty() && std::find(items.begin(), items.end(), reading.item) == items.end()) continue;
      Characteristic& c = found[{rank_of(reading.item), reading.item, reading.block, reading.block_to}];
      if (c.values.empty()) {
        c.about = reading;
        first[&c] = run;
      } else if (c.limits_differ.empty() && !same_limits(c.about, reading)) {
        c.limits_differ = fmt::format("limits are {} in {} and {} in {}", limits_text(c.about), takes[first[&c]].name,
                                      limits_text(reading), takes[run].name);
      }
      c.values.resize(takes.size(), kNoValue);
      c.values[run] = reading.value;
    }
  }
  const std::string twice = scans ? same_scan_twice(takes) : std::string();
  if (!twice.empty())
    study.warnings.push_back(
        fmt::format("{} have the same values to the last digit: one scan taken twice, not two repeats", twice));
  if (takes.size() < kGaugeRunsMin)
    study.warnings.push_back(
        fmt::format("{} runs; a type-1 study needs {}{}", takes.size(), kGaugeRunsMin,
                    takes.size() == 10 ? ": the standard deviation of ten is known to 0.69 .. 1.83 times itself" : ""));
  std::set<std::string> warned;  // one sentence an item: a recipe that changed would fill the screen
  for (auto& [key, c] : found) {
    std::vector<double> values;
    for (const double value : c.values)
      if (has_value(value)) values.push_back(value);
    const double reference = known(task.references, c.about);
    // What the recipe does not ask for and nobody ever saw is no subject of a study, unless somebody asks about it.
    if (values.empty() && items.empty() && !has_value(reference)) continue;
    c.missing = c.values.size() - values.size();
    c.spread = spread_of(values);
    double tolerance = known(task.tolerances, c.about);
    const bool differ = !has_value(tolerance) && !c.limits_differ.empty();
    if (!has_value(tolerance) && !differ) tolerance = c.about.upper - c.about.lower;
    c.gauge = type_1(c.spread, c.missing, reference, tolerance);
    if (differ) {
      if (warned.insert(c.about.item).second)
        study.warnings.push_back(
            fmt::format("{}: {}; no tolerance in common, so none is used (--tolerance {}=T says one)",
                        title_of(c.about), c.limits_differ, c.about.item));
      if (has_value(reference)) {
        c.gauge.judgement = Judgement::undecided;
        c.gauge.reason = c.limits_differ;
      }
    }
    if (!twice.empty() && c.gauge.judgement == Judgement::capable) {
      c.gauge.judgement = Judgement::undecided;
      c.gauge.reason = "one scan taken twice";
    }
    study.characteristics.push_back(std::move(c));
  }
  return study;
}

std::string repeat_json(const RepeatStudy& study) {
  Json json("slabd.study_repeat/1");
  json.field("software", daemon::software_version()).field("source", study.source).field("runs", study.runs);
  write_notes(json, study.notes);
  json.field("warnings", study.warnings).field("judgement", study.judgement());
  json.list("characteristics", study.characteristics, [&](const Characteristic& c) {
    json.field("item", c.about.item).field("unit", unit_of(c.about.item)).field("block", c.about.block);
    json.field("block_to", c.about.block_to).field("n", c.spread.count).field("missing", c.missing);
    json.field("mean", c.spread.mean).field("std", c.spread.std).field("std_low", c.spread.std_low);
    json.field("std_high", c.spread.std_high).field("smallest", c.spread.smallest).field("largest", c.spread.largest);
    json.field("range", c.spread.range).field("deviation_max", c.spread.deviation_max).field("values", c.values);
    const Gauge& g = c.gauge;
    json.key("gauge").begin_object().field("reference", g.reference).field("tolerance", g.tolerance);
    json.field("bias", g.bias).field("bias_low", g.bias_low).field("bias_high", g.bias_high).field("t", g.t);
    json.field("p", g.p).field("cg", g.cg).field("cg_low", g.cg_low).field("cg_high", g.cg_high).field("cgk", g.cgk);
    json.field("runs_min", kGaugeRunsMin).field("judgement", g.judgement).field("reason", g.reason).end_object();
  });
  return json.text();
}

void print_repeat(const RepeatStudy& study, bool details) {
  std::set<int> blocks;
  for (const Characteristic& c : study.characteristics) blocks.insert(c.about.block);
  fmt::print("{}\n", study.source);
  for (const std::string& sentence : study.notes.sentences()) fmt::print("! {}\n", sentence);
  fmt::print("\n");
  if (details || blocks.size() <= 1) print_characteristics(study);
  if (blocks.size() > 1) print_worst(study);
  print_gauges(study, style_for(stdout));
}

}  // namespace slabd::cli::study
