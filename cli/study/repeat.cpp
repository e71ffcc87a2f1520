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

/// What the paper says of its Figs. 18 and 19: the largest range of any block.
Table worst_table(const RepeatStudy& study) {
  Table table{"characteristic", "unit<", "blocks", "missing", "worst std", "block<", "worst range", "block<"};
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
    table.add(item, unit_of(item), blocks, missing, by_std == nullptr ? "-" : small(by_std->spread.std), at(by_std),
              by_range == nullptr ? "-" : small(by_range->spread.range), at(by_range));
  }
  return table;
}

}  // namespace

Table characteristics_table(const RepeatStudy& study, Reader reader) {
  Table table{pick(reader, "characteristic", "检测项目"),
              pick(reader, "unit<", "单位<"),
              "n",
              pick(reader, "mean", "平均值"),
              pick(reader, "std", "标准差"),
              pick(reader, "95 % of std", "标准差 95 % 区间"),
              pick(reader, "range", "极差"),
              pick(reader, "max dev", "最大偏离")};
  table.title = pick(reader, "Figures", "统计值");
  for (const Characteristic& c : study.characteristics)
    table.add(subject_of(c.about, reader), unit_of(c.about.item),
              c.missing == 0 ? Cell(c.spread.count) : Cell(fmt::format("{} ({} missing)", c.spread.count, c.missing)),
              Cell(c.spread.mean, decimals_of(c.about.item)), small(c.spread.std),
              range_text(c.spread.std_low, c.spread.std_high, kSmallDigits), small(c.spread.range),
              small(c.spread.deviation_max));
  return table;
}

Table gauges_table(const RepeatStudy& study, Reader reader) {
  Table table{pick(reader, "type-1 study", "检测项目"),
              pick(reader, "reference", "参考值"),
              "T",
              pick(reader, "bias", "偏倚"),
              pick(reader, "95 % of bias", "偏倚 95 % 区间"),
              "p",
              "Cg",
              "Cgk",
              pick(reader, "judgement<", "评定<")};
  table.title = fmt::format("{}: Cg = 0.2 T / (6 s), Cgk = (0.1 T - |{}|) / (3 s), >= {}, n >= {}",
                            pick(reader, "Type-1 study", "第一类量具研究"), pick(reader, "bias", "偏倚"), kGaugeCapable,
                            kGaugeRunsMin);
  for (const Characteristic& c : study.characteristics) {
    const Gauge& g = c.gauge;
    if (g.judgement == Judgement::not_judged) continue;
    const int digits = decimals_of(c.about.item);
    // A document has the reasons as sentences of their own.
    table.add(subject_of(c.about, reader), Cell(g.reference, digits), Cell(g.tolerance, digits), small(g.bias),
              range_text(g.bias_low, g.bias_high, kSmallDigits), Cell(g.p, 3), Cell(g.cg, 2), Cell(g.cgk, 2),
              judged(g.judgement, reader ? "" : g.reason, reader));
  }
  return table;
}

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

std::string repeat_text(const RepeatStudy& study, bool details) {
  std::string text;
  std::set<int> blocks;
  for (const Characteristic& c : study.characteristics) blocks.insert(c.about.block);
  text += fmt::format("{}\n", study.source);
  for (const std::string& sentence : study.notes.sentences()) text += fmt::format("! {}\n", sentence);
  text += "\n";
  if (details || blocks.size() <= 1) text += text_of(characteristics_table(study)) + "\n";
  if (blocks.size() > 1) text += text_of(worst_table(study)) + "\n";
  if (const Table gauges = gauges_table(study); !gauges.rows.empty())
    text += fmt::format("{}Cg = 0.2 T / (6 s), Cgk = (0.1 T - |bias|) / (3 s); capable from {} with {} runs\n",
                        text_of(gauges, style_for(stdout)), kGaugeCapable, kGaugeRunsMin);
  return text;
}

}  // namespace slabd::cli::study
