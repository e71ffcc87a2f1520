// SPDX-License-Identifier: Apache-2.0
#include <fmt/core.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <tuple>

#include "cli/command.h"
#include "cli/database.h"
#include "cli/exit.h"
#include "cli/study/grr.h"
#include "cli/study/study.h"
#include "cli/study/study_report.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/progress.h"
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

/// The values of one item, before the table is known to be complete.
struct LooseTable {
  GrrItem item;
  std::map<std::tuple<std::size_t, std::size_t, std::size_t>, GrrCell> cells;
  std::string first_place;  ///< place of `item.about`
  std::string twice;
  std::string limits_differ;
  bool any = false;

  void put(const PlannedReading& planned) {
    if (first_place.empty()) {
      first_place = planned.place;
      item.about = planned.reading;
    } else if (limits_differ.empty() && !same_limits(item.about, planned.reading)) {
      limits_differ = fmt::format("limits are {} at {} and {} at {}; say the tolerance of the study with --tolerance",
                                  limits_text(item.about), first_place, limits_text(planned.reading), planned.place);
    }
    const auto key = std::tuple{place_of(item.parts, planned.part), place_of(item.appraisers, planned.appraiser),
                                place_of(item.trials, planned.trial)};
    any = any || has_value(planned.reading.value);
    const auto [at, fresh] = cells.try_emplace(key, GrrCell{planned.place, planned.reading.value});
    if (!fresh && twice.empty())
      twice = fmt::format("{} and {} both give part {}, appraiser {}, trial {}", at->second.place, planned.place,
                          planned.part, planned.appraiser, planned.trial);
  }

  /// Fills `item.crossed`. Returns an empty text if the table is complete.
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
  return report::figure(value, 1);
}

/// Table cell of a judgement.
report::Cell judged_cell(const GrrJudgement& judged) {
  report::Cell cell = study::judged(judged.judgement, judged.reason, std::nullopt);
  if (judged.conditional) cell.text.replace(0, name(judged.judgement).size(), "conditional");
  return cell;
}

std::string item_text(const GrrItem& item, report::Style style) {
  const Anova& a = item.by_anova;
  report::Table table{"analysis of variance", "SS", "df", "MS", "F", "p"};
  for (const auto& [what, row] : {std::pair{"parts", &a.part},
                                  {"appraisers", &a.appraiser},
                                  {"interaction", &a.interaction},
                                  {"repeatability", &a.repeatability},
                                  {"repeatability, pooled", &a.pooled},
                                  {"total", &a.total}})
    table.add(what, fmt::format("{:.6g}", row->ss), report::Cell(row->df, 0), fmt::format("{:.6g}", row->ms),
              report::Cell(row->f, 3), report::Cell(row->p, 3));
  return fmt::format(
      "\n{} [{}]: {} parts, {} appraisers ({}), {} trials\n\n{}ndc {} ({} by ranges){}\n\n"
      "{}interaction {} with the repeatability: p {} {} {}\n{}\n",
      item.about.item, unit_of(item.about.item), item.parts.size(), item.appraisers.size(), join(item.appraisers),
      item.trials.size(), report::text_of(components_table(item)), report::figure(a.components.ndc(), 2),
      report::figure(item.by_range.value_or(Components()).ndc(), 2),
      item.by_range ? "" : fmt::format("; the ranges' factors end at {}", kGrrRangeMax), report::text_of(table),
      a.is_pooled ? "pooled" : "not pooled", report::figure(a.interaction.p, 3),
      a.interaction.p > kPoolAbove ? ">" : "<=", kPoolAbove, report::cell_text(judged_cell(item.judged), style));
}

void write_components(report::Json& json, std::string_view key, const Components& c, double tolerance) {
  json.key(key).begin_object().field("EV", c.EV).field("AV", c.AV).field("INT", c.INT).field("GRR", c.GRR);
  json.field("PV", c.PV).field("TV", c.TV).field("percent_of_variation", c.of_variation());
  json.field("percent_of_tolerance", c.of_tolerance(tolerance)).field("ndc", c.ndc()).field("AV_zeroed", c.av_zeroed);
  json.field("INT_zeroed", c.int_zeroed).field("PV_zeroed", c.pv_zeroed).end_object();
}

/// Adds all readings of one plan line.
void place_all(const std::string& place, const CsvTable& plan, std::size_t row, int block, bool every_block,
               std::vector<Reading> readings, std::vector<PlannedReading>& out) {
  const std::string& part = plan.cell(row, "part");
  for (Reading& reading : readings) {
    if (block != 0 && reading.block != block) continue;
    const std::string own = block_text(reading.block, reading.block_to);
    const std::string label = part.empty() ? own : every_block && reading.block != 0 ? part + "/" + own : part;
    out.push_back({place, label, plan.cell(row, "appraiser"), plan.cell(row, "trial"), std::move(reading)});
  }
}

}  // namespace

report::Table components_table(const GrrItem& item, Reader reader) {
  const Components& c = item.by_anova.components;
  const Components r = item.by_range.value_or(Components());
  report::Table table{pick(reader, "source", "来源"),
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
    table.add(what, report::Cell(own, digits), percent(100.0 * own / c.TV), percent(600.0 * own / item.tolerance),
              report::Cell(other, digits), percent(100.0 * other / r.TV));
  };
  add(pick(reader, "repeatability EV", "重复性 EV"), c.EV, r.EV);
  add(pick(reader, "reproducibility AV", "再现性 AV"), c.AV, r.AV, c.av_zeroed);
  if (!item.by_anova.is_pooled) add(pick(reader, "interaction INT", "交互作用 INT"), c.INT, kNoValue, c.int_zeroed);
  add(pick(reader, "gauge R&R", "GRR"), c.GRR, r.GRR);
  add(pick(reader, "parts PV", "零件变差 PV"), c.PV, r.PV, c.pv_zeroed);
  add(pick(reader, "total TV", "总变差 TV"), c.TV, r.TV);
  if (reader) table.add("ndc", report::Cell(c.ndc(), 2), "", "", report::Cell(r.ndc(), 2), "");
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

Result<std::vector<PlannedReading>> planned_readings_of(const CsvTable& plan, const PlanReaders& readers) {
  const bool scans = plan.has("scan");
  const bool slabs = plan.has("slab");
  const Status good = scans   ? plan.expect({"appraiser", "trial", "scan", "block"}, {"part"})
                      : slabs ? plan.expect({"appraiser", "trial", "slab"}, {"part", "block"})
                              : plan.expect({"appraiser", "trial", "part", "value"}, {"item", "lower", "upper"});
  if (!good.ok()) return good.error();
  std::vector<PlannedReading> out;
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

GrrStudy grr_study(const std::vector<PlannedReading>& readings_as_planned, const std::vector<std::string>& items,
                   const std::function<double(const std::string&)>& tolerance, Interaction interaction) {
  std::map<std::pair<std::size_t, std::string>, LooseTable> tables;
  for (const PlannedReading& planned : readings_as_planned) {
    const std::string& item = planned.reading.item;
    if (!items.empty() && std::find(items.begin(), items.end(), item) == items.end()) continue;
    tables[{rank_of(item), item}].put(planned);
  }
  GrrStudy study;
  std::vector<std::pair<std::string, std::vector<std::string>>> refused;  // cause, and the items that it concerns
  for (auto& [key, loose] : tables) {
    GrrItem& item = loose.item;
    item.tolerance = tolerance(key.second);
    // Items that are never measured, or that are only of the whole slab, are skipped unless they were named.
    const bool named = !items.empty() || has_value(item.tolerance);
    if (!named && (!loose.any || (tables.size() > 1 && item.parts.size() < 2))) continue;
    std::string hole = loose.fill();
    // Different limits have no tolerance in common. A part judged by other limits may also be another object
    // with the same name.
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
      const auto known = std::find_if(refused.begin(), refused.end(), [&](const auto& r) { return r.first == hole; });
      if (known != refused.end())
        known->second.push_back(key.second);
      else
        refused.push_back({hole, {key.second}});
      continue;
    }
    item.by_range = average_range(item.crossed);
    if (!has_value(item.tolerance)) item.tolerance = item.about.upper - item.about.lower;
    item.judged = judge(item.crossed, item.by_anova.components, item.tolerance);
    study.items.push_back(std::move(item));
  }
  for (const auto& [cause, of] : refused) {
    const bool all = study.items.empty() && refused.size() == 1 && of.size() > 2;
    study.refused.push_back(fmt::format("{}: {}", all ? fmt::format("all {} items", of.size()) : join(of), cause));
  }
  return study;
}

std::string grr_json(const GrrStudy& study) {
  report::Json json("slabd.study_grr/1");
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
  const report::Style style = style_for(stdout);
  text += fmt::format("{}\n", study.source);
  for (const std::string& sentence : study.notes.sentences()) text += fmt::format("! {}\n", sentence);
  text += "\n";
  report::Table table{"gauge R&R", "unit<", "EV", "AV", "GRR", "% of T", "% of TV", "ndc", "judgement<"};
  for (const GrrItem& item : study.items) {
    const Components& c = item.by_anova.components;
    const int digits = decimals_of(item.about.item) + 1;
    table.add(item.about.item, unit_of(item.about.item), report::figure(c.EV, digits), report::figure(c.AV, digits),
              report::figure(c.GRR, digits), percent(c.of_tolerance(item.tolerance)), percent(c.of_variation()),
              report::figure(c.ndc(), 2), judged_cell(item.judged));
  }
  text += report::text_of(table, style);
  if (details || study.items.size() == 1)
    for (const GrrItem& item : study.items) text += item_text(item, style);
  return text;
}

// slabctl study grr: a plan of measurements, from a table, scans or stored slabs.

namespace {

struct GrrOptions {
  std::string plan;
  ScanOptions scan;
  DatabaseOptions database;
  std::vector<std::string> items;
  std::vector<std::string> tolerances;
  std::string interaction = "auto";
  std::string same_part;
  bool details = false;
  DocumentOptions document;
  bool json = false;
};

/// Rejects named items that are not in the study, because they are probably typing errors and their tolerance would be
/// ignored.
void need_known(const GrrOptions& options, const std::map<std::string, double>& tolerances,
                const std::vector<PlannedReading>& readings_as_planned) {
  std::set<std::string> measured;
  for (const PlannedReading& planned : readings_as_planned)
    if (has_value(planned.reading.value)) measured.insert(planned.reading.item);
  const std::vector<std::string> names(measured.begin(), measured.end());
  const auto there = [&](const char* option, const std::string& item) {
    if (measured.contains(item)) return;
    const std::string meant = nearest(item, names);
    stop(kUsage, fmt::format("{}: '{}' was not measured here{}", option, item,
                             meant.empty() ? "" : fmt::format(", did you mean '{}'?", meant)));
  };
  for (const std::string& item : options.items) there("--item", item);
  for (const auto& [item, width] : tolerances) there("--tolerance", item);
}

/// A path of the plan, relative to the plan's folder.
std::string beside(const std::string& plan, const std::string& path) {
  return (std::filesystem::path(plan).parent_path() / path).string();
}

int run_grr(const GrrOptions& options) {
  options.document.check();
  std::map<std::string, double> tolerances;
  for (const std::string& text : options.tolerances) {
    const auto [item, value] = parse_assignment("--tolerance", text);
    if (!(value > 0.0))
      stop(kUsage, fmt::format("--tolerance '{}': a width above 0, upper limit minus lower limit", text));
    tolerances[item] = value;
  }
  const auto plan = need(CsvTable::read(options.plan), kBadInput);
  std::optional<ScanMeter> meter;
  std::unique_ptr<storage::Reader> reader;
  if (plan.has("scan")) {
    const Recipe recipe = options.scan.load();
    warn_unconfirmed(recipe);
    meter.emplace(recipe, options.scan.form.form(), options.scan.threads);
  } else if (plan.has("slab")) {
    reader = open_database(options.database);
  }
  PlanReaders readers;
  std::vector<MeasuredOnce> scans;
  SamePart same_part;
  std::size_t row = 0;  // each row of the plan is read once, in order
  const auto part_of = [&](int block) {
    const std::string name = plan.cell(row++, "part");
    return !name.empty() || block == 0 ? name : fmt::format("block {}", block);
  };
  readers.scan = [&](const std::string& path, int block) -> Result<std::vector<Reading>> {
    const ProgressNote note(stderr, fmt::format("measuring {} ...", path), std::chrono::seconds(1));
    auto read = meter->measure(beside(options.plan, path), block);
    if (!read.ok()) return read;
    same_part.add_scan(part_of(block), path, block, meter->shape());
    scans.push_back({path, read.value()});
    return read;
  };
  std::map<std::int64_t, std::set<int>> blocks_used;  // by slab key; 0: all blocks
  readers.slab = [&](const std::string& slab, int block) -> Result<std::vector<Reading>> {
    auto records = slabs_named(*reader, slab, 1000);
    if (!records.ok()) return records.error();
    if (records.value().empty()) return no_slab_named(slab);
    if (records.value().size() > 1)
      return error(Code::config, "slab id '%s' has %zu inspections; name the key of the one that is meant",
                   slab.c_str(), records.value().size());
    const SlabHeader& header = records.value().front().summary.header;
    const std::int64_t key = header.key;
    same_part.add_slab(part_of(0), header);
    std::set<int>& used = blocks_used[key];
    MeasuredOnce measurement = measurement_of(records.value().front());
    // A plan with a column of blocks has one row per block of a slab.
    if (used.contains(0) || used.contains(block) || (block == 0 && !used.empty()))
      return error(Code::config, "slab '%s' (key %lld)%s is in the plan already: one measurement used twice",
                   slab.c_str(), static_cast<long long>(key),
                   block == 0 ? "" : fmt::format(", block {},", block).c_str());
    if (used.empty()) scans.push_back(measurement);
    used.insert(block);
    return measurement.readings;
  };
  const auto readings_as_planned = need(planned_readings_of(plan, readers));
  need_known(options, tolerances, readings_as_planned);
  const Interaction interaction = options.interaction == "keep"   ? Interaction::keep
                                  : options.interaction == "pool" ? Interaction::pool
                                                                  : Interaction::automatic;
  const auto tolerance = [&](const std::string& item) {
    const auto found = tolerances.find(item);
    return found == tolerances.end() ? kNoValue : found->second;
  };
  StudyNotes notes = same_part.settle(options.same_part);
  GrrStudy study = grr_study(readings_as_planned, options.items, tolerance, interaction);
  study.source = options.plan;
  study.notes = std::move(notes);
  if (const std::string twice = same_scan_twice(scans); !twice.empty())
    study.refused.push_back(
        fmt::format("{} have the same values to the last digit: one measurement used twice", twice));
  for (const std::string& sentence : study.refused) complain(sentence);
  if (study.items.empty()) {
    if (study.refused.empty()) complain(fmt::format("{}: no such item was measured", options.plan));
    return kBadInput;
  }
  options.document.write(grr_report(study, options.document.wanted()));
  fmt::print("{}", options.json ? grr_json(study) : grr_text(study, options.details));
  return study.refused.empty() ? exit_of(study.judgement()) : kBadInput;
}

}  // namespace

void add_grr(args::Command& study) {
  auto options = std::make_shared<GrrOptions>();
  args::Command command = study.add_subcommand("grr", "Gauge R&R: repeatability, reproducibility, %GRR and ndc");
  command->footer(
      "\nPLAN is a table with the columns appraiser, trial and\n"
      "  part, value [, item, lower, upper]   values measured elsewhere\n"
      "  scan, block [, part]                 scans, from the plan's folder; a part is the block, or has a name\n"
      "  slab [, block, part]                 stored slabs by key; every block is a part (name/block)\n"
      "Appraisers are re-clampings, homings of the robot, or shifts. Every appraiser measures every part equally "
      "often.\n"
      "Judged by 6 GRR / T from the analysis of variance, without tolerance by GRR / TV and ndc: below 10 % capable,\n"
      "above 30 % not, between a decision of people. Fewer than 10 parts, 2 appraisers, 2 trials: undecided.\n"
      "An interaction with p > 0.05 is pooled with the repeatability.\n"
      "Example: slabctl study grr plan.csv --item seat_slope --tolerance seat_slope=0.2\n"
      "Exit status: 0 capable, 1 not capable or undecided, 3 the plan has a hole.");
  command->add_option("PLAN", options->plan, "The table of who measured what")->required();
  options->scan.add_to(*command);
  command->add_option("--item", options->items, "Only this item; repeatable")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  command->add_option("--tolerance", options->tolerances, "T, upper limit minus lower limit: ITEM=WIDTH; repeatable")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  command
      ->add_option("--interaction", options->interaction,
                   "auto: pooled when not significant; keep: never pooled; pool: always")
      ->check(args::one_of({"auto", "keep", "pool"}))
      ->capture_default_str();
  add_same_part(*command, options->same_part);
  command->add_flag("--details", options->details, "The tables behind every item");
  options->document.add_to(*command);
  options->database.add_to(*command);
  command->add_flag("--json", options->json, "Print slabd.study_grr/1 on stdout");
  command->runs([options] { return run_grr(*options); });
}

}  // namespace slabd::cli::study
