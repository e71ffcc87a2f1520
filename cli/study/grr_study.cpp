// SPDX-License-Identifier: Apache-2.0
#include "cli/study/grr_study.h"

#include <fmt/core.h>

#include <algorithm>
#include <map>
#include <tuple>

#include "cli/terminal/render.h"
#include "config/config.h"
#include "daemon/measure.h"
#include "report/figures.h"
#include "report/json.h"

namespace slabd::cli::study {
namespace {

std::size_t place_of(std::vector<std::string>& names, const std::string& name) {
  const auto found = std::find(names.begin(), names.end(), name);
  if (found != names.end()) return static_cast<std::size_t>(found - names.begin());
  names.push_back(name);
  return names.size() - 1;
}

struct GrrCell {
  std::string place;
  double value = kNoValue;
};

/// The values of one item as they come, before anybody knows whether they make a whole table.
struct LooseTable {
  GrrItem item;
  std::map<std::tuple<std::size_t, std::size_t, std::size_t>, GrrCell> cells;
  std::string first_place;  ///< place of what `item.about` is
  std::string twice;
  std::string limits_differ;
  bool any = false;

  void put(const Placing& placing) {
    if (first_place.empty()) {
      first_place = placing.place;
      item.about = placing.reading;
    } else if (limits_differ.empty() && !same_limits(item.about, placing.reading)) {
      limits_differ = fmt::format("limits are {} at {} and {} at {}; say the tolerance of the study with --tolerance",
                                  limits_text(item.about), first_place, limits_text(placing.reading), placing.place);
    }
    const auto key = std::tuple{place_of(item.parts, placing.part), place_of(item.appraisers, placing.appraiser),
                                place_of(item.trials, placing.trial)};
    any = any || has_value(placing.reading.value);
    const auto [at, fresh] = cells.try_emplace(key, GrrCell{placing.place, placing.reading.value});
    if (!fresh && twice.empty())
      twice = fmt::format("{} and {} both give part {}, appraiser {}, trial {}", at->second.place, placing.place,
                          placing.part, placing.appraiser, placing.trial);
  }

  /// Empty when the table is whole; fills `item.crossed` then.
  std::string fill() {
    if (!twice.empty()) return twice;
    item.crossed = {item.parts.size(), item.appraisers.size(), item.trials.size(), {}};
    std::string first;
    std::size_t holes = 0;
    for (std::size_t p = 0; p < item.parts.size(); ++p)
      for (std::size_t a = 0; a < item.appraisers.size(); ++a)
        for (std::size_t t = 0; t < item.trials.size(); ++t) {
          const auto found = cells.find({p, a, t});
          const bool there = found != cells.end() && has_value(found->second.value);
          item.crossed.value.push_back(there ? found->second.value : kNoValue);
          if (there || holes++ > 0) continue;
          first = fmt::format("part {}, appraiser {}, trial {} {}", item.parts[p], item.appraisers[a], item.trials[t],
                              found == cells.end() ? "is missing" : "was not measured (" + found->second.place + ")");
        }
    if (holes == 0) return {};
    return fmt::format("{}{}; every appraiser must measure every part equally often", first,
                       holes > 1 ? fmt::format(", and {} more", holes - 1) : "");
  }
};

std::string join(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
  return text;
}

std::string percent(double value) {
  return figure(value, 1);
}

/// As a table has it.
Cell judged_cell(const GrrJudgement& judged) {
  Cell cell = study::judged(judged.judgement, judged.reason, std::nullopt);
  if (judged.conditional) cell.text.replace(0, name(judged.judgement).size(), "conditional");
  return cell;
}

std::string item_text(const GrrItem& item, Style style) {
  const Anova& a = item.by_anova;
  Table table{"analysis of variance", "SS", "df", "MS", "F", "p"};
  for (const auto& [what, row] : {std::pair{"parts", &a.part},
                                  {"appraisers", &a.appraiser},
                                  {"interaction", &a.interaction},
                                  {"repeatability", &a.repeatability},
                                  {"repeatability, pooled", &a.pooled},
                                  {"total", &a.total}})
    table.add(what, fmt::format("{:.6g}", row->ss), Cell(row->df, 0), fmt::format("{:.6g}", row->ms), Cell(row->f, 3),
              Cell(row->p, 3));
  return fmt::format(
      "\n{} [{}]: {} parts, {} appraisers ({}), {} trials\n\n{}ndc {} ({} by ranges){}\n\n"
      "{}interaction {} with the repeatability: p {} {} {}\n{}\n",
      item.about.item, unit_of(item.about.item), item.parts.size(), item.appraisers.size(), join(item.appraisers),
      item.trials.size(), text_of(components_table(item)), figure(a.components.ndc(), 2),
      figure(item.by_range.value_or(Components()).ndc(), 2),
      item.by_range ? "" : fmt::format("; the ranges' factors end at {}", kGrrRangeMax), text_of(table),
      a.is_pooled ? "pooled" : "not pooled", figure(a.interaction.p, 3),
      a.interaction.p > kPoolAbove ? ">" : "<=", kPoolAbove, cell_text(judged_cell(item.judged), style));
}

void write_components(Json& json, std::string_view key, const Components& c, double tolerance) {
  json.key(key).begin_object().field("EV", c.EV).field("AV", c.AV).field("INT", c.INT).field("GRR", c.GRR);
  json.field("PV", c.PV).field("TV", c.TV).field("percent_of_variation", c.of_variation());
  json.field("percent_of_tolerance", c.of_tolerance(tolerance)).field("ndc", c.ndc()).field("AV_zeroed", c.av_zeroed);
  json.field("INT_zeroed", c.int_zeroed).field("PV_zeroed", c.pv_zeroed).end_object();
}

/// Everything of one plan line as placings.
void place_all(const std::string& place, const CsvTable& plan, std::size_t row, int block, bool every_block,
               std::vector<Reading> readings, std::vector<Placing>& out) {
  const std::string& part = plan.cell(row, "part");
  for (Reading& reading : readings) {
    if (block != 0 && reading.block != block) continue;
    const std::string own = block_text(reading.block, reading.block_to);
    const std::string label = part.empty() ? own : every_block && reading.block != 0 ? part + "/" + own : part;
    out.push_back({place, label, plan.cell(row, "appraiser"), plan.cell(row, "trial"), std::move(reading)});
  }
}

}  // namespace

Table components_table(const GrrItem& item, Reader reader) {
  const Components& c = item.by_anova.components;
  const Components r = item.by_range.value_or(Components());
  Table table{pick(reader, "source", "来源"),
              pick(reader, "sigma", "sigma（方差分析）"),
              "% of TV",
              "% of T",
              pick(reader, "average-range sigma", "sigma（均值极差）"),
              "% of TV"};
  table.title = fmt::format("{} {}, {} {}, {} {}; {} (p {:.3f})", item.parts.size(), pick(reader, "parts", "个零件"),
                            item.appraisers.size(), pick(reader, "appraisers", "名评价人"), item.trials.size(),
                            pick(reader, "trials", "次试验"),
                            item.by_anova.is_pooled ? pick(reader, "interaction pooled", "交互作用已合并")
                                                    : pick(reader, "with interaction", "含交互作用"),
                            item.by_anova.interaction.p);
  const int digits = decimals_of(item.about.item) + 2;
  const auto add = [&](std::string what, double own, double other, bool zeroed = false) {
    if (zeroed) what += pick(reader, " (negative, set to 0)", "（负值，取 0）");
    table.add(what, Cell(own, digits), percent(100.0 * own / c.TV), percent(600.0 * own / item.tolerance),
              Cell(other, digits), percent(100.0 * other / r.TV));
  };
  add(pick(reader, "repeatability EV", "重复性 EV"), c.EV, r.EV);
  add(pick(reader, "reproducibility AV", "再现性 AV"), c.AV, r.AV, c.av_zeroed);
  if (!item.by_anova.is_pooled) add(pick(reader, "interaction INT", "交互作用 INT"), c.INT, kNoValue, c.int_zeroed);
  add(pick(reader, "gauge R&R", "GRR"), c.GRR, r.GRR);
  add(pick(reader, "parts PV", "零件变差 PV"), c.PV, r.PV, c.pv_zeroed);
  add(pick(reader, "total TV", "总变差 TV"), c.TV, r.TV);
  if (reader) table.add("ndc", Cell(c.ndc(), 2), "", "", Cell(r.ndc(), 2), "");
  return table;
}

Judgement GrrStudy::judgement() const {
  Judgement worst = items.empty() || !refused.empty() ? Judgement::undecided : Judgement::capable;
  for (const GrrItem& item : items) {
    if (item.judged.judgement == Judgement::not_capable) return Judgement::not_capable;
    if (item.judged.judgement != Judgement::capable) worst = Judgement::undecided;
  }
  return worst;
}

Result<std::vector<Placing>> placings_of(const CsvTable& plan, const PlanReaders& readers) {
  const bool scans = plan.has("scan");
  const bool slabs = plan.has("slab");
  const Status good = scans   ? plan.expect({"appraiser", "trial", "scan", "block"}, {"part"})
                      : slabs ? plan.expect({"appraiser", "trial", "slab"}, {"part", "block"})
                              : plan.expect({"appraiser", "trial", "part", "value"}, {"item", "lower", "upper"});
  if (!good.ok()) return good.error();
  std::vector<Placing> out;
  for (std::size_t row = 0; row < plan.rows(); ++row) {
    const std::string place = plan.place(row);
    for (const char* column : {"appraiser", "trial", scans ? "scan" : slabs ? "slab" : "part"})
      if (plan.cell(row, column).empty()) return error(Code::config, "%s: no %s", place.c_str(), column);
    const Result<int> block = plan.block(row);
    if (!block.ok()) return block.error();
    if (scans && block.value() == 0) return error(Code::config, "%s: no block", place.c_str());
    if (scans || slabs) {
      auto read = scans ? readers.scan(plan.cell(row, "scan"), block.value())
                        : readers.slab(plan.cell(row, "slab"), block.value());
      if (!read.ok())
        return error(read.error().code, "%s: %s", place.c_str(), std::string(read.error().text.view()).c_str());
      place_all(place, plan, row, block.value(), slabs && block.value() == 0, std::move(read.value()), out);
      continue;
    }
    Reading reading;
    reading.item = plan.has("item") ? plan.cell(row, "item") : "value";
    if (reading.item.empty()) return error(Code::config, "%s: no item", place.c_str());
    const Result<double> value = plan.number(row, "value");
    if (!value.ok()) return value.error();
    reading.value = value.value();
    const Result<CsvTable::Limits> limits = plan.limits(row);
    if (!limits.ok()) return limits.error();
    reading.lower = limits.value().lower;
    reading.upper = limits.value().upper;
    out.push_back({place, plan.cell(row, "part"), plan.cell(row, "appraiser"), plan.cell(row, "trial"), reading});
  }
  return out;
}

GrrStudy grr_study(const std::vector<Placing>& placings, const std::vector<std::string>& items,
                   const std::function<double(const std::string&)>& tolerance, Interaction interaction) {
  std::map<std::pair<std::size_t, std::string>, LooseTable> tables;
  for (const Placing& placing : placings) {
    const std::string& item = placing.reading.item;
    if (!items.empty() && std::find(items.begin(), items.end(), item) == items.end()) continue;
    tables[{rank_of(item), item}].put(placing);
  }
  GrrStudy study;
  for (auto& [key, loose] : tables) {
    GrrItem& item = loose.item;
    item.tolerance = tolerance(key.second);
    // What is never measured, or is of no part but the whole slab, was not meant when nobody named it.
    const bool named = !items.empty() || has_value(item.tolerance);
    if (!named && (!loose.any || (tables.size() > 1 && item.parts.size() < 2))) continue;
    std::string hole = loose.fill();
    // Whose tolerance would it be? A part judged by other limits may also be another thing under the same name.
    if (hole.empty() && !has_value(item.tolerance)) hole = loose.limits_differ;
    if (hole.empty()) {
      if (const auto found = anova(item.crossed, interaction)) {
        item.by_anova = *found;
      } else {
        hole = fmt::format("{} parts, {} appraisers, {} trials; two of each at least", item.parts.size(),
                           item.appraisers.size(), item.trials.size());
      }
    }
    if (!hole.empty()) {
      study.refused.push_back(fmt::format("{}: {}", key.second, hole));
      continue;
    }
    item.by_range = average_range(item.crossed);
    if (!has_value(item.tolerance)) item.tolerance = item.about.upper - item.about.lower;
    item.judged = judge(item.crossed, item.by_anova.components, item.tolerance);
    study.items.push_back(std::move(item));
  }
  return study;
}

std::string grr_json(const GrrStudy& study) {
  Json json("slabd.study_grr/1");
  json.field("software", daemon::software_version()).field("source", study.source);
  json.field("judgement", study.judgement());
  write_notes(json, study.notes);
  json.field("refused", study.refused);
  json.list("items", study.items, [&](const GrrItem& item) {
    json.field("item", item.about.item).field("unit", unit_of(item.about.item)).field("tolerance", item.tolerance);
    json.field("parts", item.parts);
    json.field("appraisers", item.appraisers);
    json.field("trials", item.trials);
    const Anova& a = item.by_anova;
    json.key("anova").begin_object().field("pooled", a.is_pooled).field("pool_above", kPoolAbove);
    json.field("part", a.part);
    json.field("appraiser", a.appraiser);
    json.field("interaction", a.interaction);
    json.field("repeatability", a.repeatability);
    json.field("repeatability_pooled", a.pooled);
    json.field("total", a.total);
    write_components(json, "components", a.components, item.tolerance);
    write_components(json, "with_interaction", a.with_interaction, item.tolerance);
    write_components(json, "without_interaction", a.without_interaction, item.tolerance);
    json.end_object();
    json.key("average_range");
    if (item.by_range) {
      json.begin_object();
      write_components(json, "components", *item.by_range, item.tolerance);
      json.end_object();
    } else {
      json.null();
    }
    json.field("judgement", item.judged.judgement).field("conditional", item.judged.conditional);
    json.field("reason", item.judged.reason);
  });
  return json.text();
}

std::string grr_text(const GrrStudy& study, bool details) {
  std::string text;
  const Style style = style_for(stdout);
  text += fmt::format("{}\n", study.source);
  for (const std::string& sentence : study.notes.sentences()) text += fmt::format("! {}\n", sentence);
  text += "\n";
  Table table{"gauge R&R", "unit<", "EV", "AV", "GRR", "% of T", "% of TV", "ndc", "judgement<"};
  for (const GrrItem& item : study.items) {
    const Components& c = item.by_anova.components;
    const int digits = decimals_of(item.about.item) + 1;
    table.add(item.about.item, unit_of(item.about.item), figure(c.EV, digits), figure(c.AV, digits),
              figure(c.GRR, digits), percent(c.of_tolerance(item.tolerance)), percent(c.of_variation()),
              figure(c.ndc(), 2), judged_cell(item.judged));
  }
  text += text_of(table, style);
  if (details || study.items.size() == 1)
    for (const GrrItem& item : study.items) text += item_text(item, style);
  return text;
}

}  // namespace slabd::cli::study
