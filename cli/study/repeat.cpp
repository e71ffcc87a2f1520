// SPDX-License-Identifier: Apache-2.0
#include "cli/study/repeat.h"

#include <fmt/core.h>

#include <algorithm>
#include <chrono>
#include <memory>
#include <set>
#include <tuple>

#include "cli/command.h"
#include "cli/database.h"
#include "cli/exit.h"
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

double known(const std::map<std::string, double>& of, const Reading& about) {
  const auto own = of.find(fmt::format("{}@{}", about.item, about.block));
  if (own != of.end()) return own->second;
  const auto all = of.find(about.item);
  return all == of.end() ? kNoValue : all->second;
}

std::string range_text(double low, double high, int digits) {
  return fmt::format("{} .. {}", report::figure(low, digits), report::figure(high, digits));
}

/// Scatter is small compared with values: a hundredth of a micrometre, a hundred-thousandth of a degree.
constexpr int kSmallDigits = 5;
std::string small(double value) {
  return report::figure(value, kSmallDigits);
}

/// The largest range of any block, as the paper reports for its Figs. 18 and 19.
report::Table worst_table(const RepeatStudy& study) {
  report::Table table{"characteristic", "unit<", "blocks", "missing", "worst std", "block<", "worst range", "block<"};
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

report::Table characteristics_table(const RepeatStudy& study, Reader reader) {
  report::Table table{pick(reader, "characteristic", "检测项目"),
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
              c.missing == 0 ? report::Cell(c.spread.count)
                             : report::Cell(fmt::format("{} ({} missing)", c.spread.count, c.missing)),
              report::Cell(c.spread.mean, decimals_of(c.about.item)), small(c.spread.std),
              range_text(c.spread.std_low, c.spread.std_high, kSmallDigits), small(c.spread.range),
              small(c.spread.deviation_max));
  return table;
}

report::Table gauges_table(const RepeatStudy& study, Reader reader) {
  report::Table table{pick(reader, "type-1 study", "第一类量具研究"),
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
    // A document contains the reasons as separate sentences.
    table.add(subject_of(c.about, reader), report::Cell(g.reference, digits), report::Cell(g.tolerance, digits),
              small(g.bias), range_text(g.bias_low, g.bias_high, kSmallDigits), report::Cell(g.p, 3),
              report::Cell(g.cg, 2), report::Cell(g.cgk, 2), judged(g.judgement, reader ? "" : g.reason, reader));
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

RepeatStudy repeat_study(std::span<const MeasuredOnce> measurements, const std::vector<std::string>& items, int block,
                         const GaugeTask& task, bool scans) {
  RepeatStudy study;
  using Key = std::tuple<std::size_t, std::string, int, int>;
  std::map<Key, Characteristic> found;
  std::map<const Characteristic*, std::size_t> first;  // first run with this characteristic
  for (std::size_t run = 0; run < measurements.size(); ++run) {
    study.runs.push_back(measurements[run].name);
    for (const Reading& reading : measurements[run].readings) {
      if (block != 0 && reading.block != block) continue;
      if (!items.empty() && std::find(items.begin(), items.end(), reading.item) == items.end()) continue;
      Characteristic& c = found[{rank_of(reading.item), reading.item, reading.block, reading.block_to}];
      if (c.values.empty()) {
        c.about = reading;
        first[&c] = run;
      } else if (c.limits_differ.empty() && !same_limits(c.about, reading)) {
        c.limits_differ = fmt::format("limits are {} in {} and {} in {}", limits_text(c.about),
                                      measurements[first[&c]].name, limits_text(reading), measurements[run].name);
      }
      c.values.resize(measurements.size(), kNoValue);
      c.values[run] = reading.value;
    }
  }
  const std::string twice = scans ? same_scan_twice(measurements) : std::string();
  if (!twice.empty())
    study.warnings.push_back(
        fmt::format("{} have the same values to the last digit: one scan taken twice, not two repeats", twice));
  if (measurements.size() < kGaugeRunsMin)
    study.warnings.push_back(fmt::format(
        "{} runs; a type-1 study needs {}{}", measurements.size(), kGaugeRunsMin,
        measurements.size() == 10 ? ": the standard deviation of ten is known to 0.69 .. 1.83 times itself" : ""));
  std::set<std::string> warned;  // one warning per item, so that a changed recipe does not fill the screen
  for (auto& [key, c] : found) {
    std::vector<double> values;
    for (const double value : c.values)
      if (has_value(value)) values.push_back(value);
    const double reference = known(task.references, c.about);
    // An item that is not required and was never measured is skipped, unless it was named or has a reference.
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
            fmt::format("{}: {}; no tolerance in common, so none is used (--tolerance {}=T sets one)",
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
  report::Json json("slabd.study_repeat/1");
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
  if (details || blocks.size() <= 1) text += report::text_of(characteristics_table(study)) + "\n";
  if (blocks.size() > 1) text += report::text_of(worst_table(study)) + "\n";
  if (const report::Table gauges = gauges_table(study); !gauges.rows.empty())
    text += fmt::format("{}Cg = 0.2 T / (6 s), Cgk = (0.1 T - |bias|) / (3 s); capable from {} with {} runs\n",
                        report::text_of(gauges, style_for(stdout)), kGaugeCapable, kGaugeRunsMin);
  return text;
}

// slabctl study repeat: repeated measurements of the same object, from scans, stored slabs, a table, or on the line.

namespace {

struct RepeatOptions {
  std::vector<std::string> scans;
  ScanOptions scan;
  std::vector<std::string> slabs;
  std::size_t runs = 1000;
  bool attempts = false;
  std::string values;
  int live = 0;
  std::size_t count = 50;
  bool enter = false;
  ScannerChoice scanner;
  DatabaseOptions database;
  int block = 0;
  std::vector<std::string> items;
  std::vector<std::string> references;
  std::vector<std::string> tolerances;
  std::string same_part;
  bool details = false;
  DocumentOptions document;
  bool json = false;
};

/// Measurements and their source in words.
struct Runs {
  std::vector<MeasuredOnce> measurements;
  std::string source;
};

Runs from_scans(const RepeatOptions& options, SamePart& part) {
  const Recipe recipe = options.scan.load();
  if (options.block < 1 || options.block > recipe.stations())
    stop(kUsage, fmt::format("scans are of one block: --block 1..{}", recipe.stations()));
  const auto files = need(scan_files(options.scans));
  warn_unconfirmed(recipe);
  std::vector<MeasuredOnce> measurements;
  ScanMeter meter(recipe, options.scan.form.form(), options.scan.threads);
  for (const std::string& file : files) {
    const ProgressNote note(stderr, fmt::format("measuring {} ...", file), std::chrono::seconds(1));
    measurements.push_back({file, need(meter.measure(file, options.block))});
    part.add_scan("", file, options.block, meter.shape());
  }
  std::string source =
      fmt::format("{} scans of block {}, recipe {}", measurements.size(), options.block, recipe.name.view());
  return {std::move(measurements), std::move(source)};
}

Runs from_slabs(const RepeatOptions& options, SamePart& part) {
  const auto reader = open_database(options.database);
  std::vector<MeasuredOnce> measurements;
  std::set<std::int64_t> seen;  // a slab that is named twice, for example once by its id, counts once
  for (const std::string& wanted : options.slabs) {
    const auto records = need(slabs_named(*reader, wanted, options.runs));
    if (records.empty()) stop(no_slab_named(wanted));
    for (const storage::SlabRecord& record : records) {
      if (!seen.insert(record.summary.header.key).second) continue;
      part.add_slab("", record.summary.header);
      if (!options.attempts) {
        measurements.push_back(measurement_of(record));
        continue;
      }
      for (MeasuredOnce& measurement : attempts_of(record)) measurements.push_back(std::move(measurement));
    }
  }
  // Attempts at other blocks are not runs of this one.
  if (options.attempts && options.block == 0) stop(kUsage, "--attempts are repeats of one block: --block K");
  if (options.attempts)
    std::erase_if(measurements, [&](const MeasuredOnce& t) {
      return t.readings.empty() || t.readings.front().block != options.block;
    });
  std::string source =
      fmt::format("{} {}: {}", measurements.size(), options.attempts ? "attempts" : "stored runs",
                  measurements.empty() ? "none" : measurements.front().name + " .. " + measurements.back().name);
  return {std::move(measurements), std::move(source)};
}

Runs from_line(const RepeatOptions& options) {
  const Recipe recipe = options.scan.load();
  if (options.live > recipe.stations() || (options.block != 0 && options.block != options.live))
    stop(kUsage, fmt::format("--live {}: recipe {} has blocks 1..{}, and --block is not needed", options.live,
                             recipe.name.view(), recipe.stations()));
  warn_unconfirmed(recipe);
  const LiveOrder order{options.database.config, options.live,         options.count,
                        options.enter,           options.scan.threads, options.scanner};
  std::vector<MeasuredOnce> measurements = live_measurements(order, recipe);
  std::string source =
      fmt::format("{} scans of block {} on the line, recipe {}", measurements.size(), options.live, recipe.name.view());
  return {std::move(measurements), std::move(source)};
}

Runs from_table(const RepeatOptions& options) {
  const auto table = need(CsvTable::read(options.values));
  std::vector<MeasuredOnce> measurements = need(measurements_of(table));
  std::string source = fmt::format("{} runs in {}", measurements.size(), options.values);
  return {std::move(measurements), std::move(source)};
}

GaugeTask task_of(const RepeatOptions& options) {
  GaugeTask task;
  for (const auto& [option, texts, target] : {std::tuple{"--reference", &options.references, &task.references},
                                              std::tuple{"--tolerance", &options.tolerances, &task.tolerances}})
    for (const std::string& text : *texts) {
      const auto [item, value] = parse_assignment(option, text);
      if (target == &task.tolerances && !(value > 0.0))
        stop(kUsage, fmt::format("--tolerance '{}': a width above 0, upper limit minus lower limit", text));
      (*target)[item] = value;
    }
  return task;
}

/// Rejects named items that are never measured, because they are probably typing errors.
void need_known(const RepeatOptions& options, const GaugeTask& task, const std::vector<MeasuredOnce>& measurements,
                const RepeatStudy& study) {
  const auto there = [&](const std::string& wanted) {
    for (const Characteristic& c : study.characteristics)
      if (wanted == c.about.item || wanted == fmt::format("{}@{}", c.about.item, c.about.block)) return;
    std::vector<std::string> names;
    for (const MeasuredOnce& measurement : measurements)
      for (const Reading& reading : measurement.readings) names.push_back(reading.item);
    const std::string meant = nearest(wanted.substr(0, wanted.find('@')), names);
    stop(kUsage, fmt::format("'{}' was not measured here{}", wanted,
                             meant.empty() ? "" : fmt::format(", did you mean '{}'?", meant)));
  };
  for (const std::string& item : options.items) there(item);
  for (const auto* of : {&task.references, &task.tolerances})
    for (const auto& [item, value] : *of) there(item);
}

int run_repeat(const RepeatOptions& options) {
  options.document.check();
  const int sources = (options.scans.empty() ? 0 : 1) + (options.slabs.empty() ? 0 : 1) +
                      (options.values.empty() ? 0 : 1) + (options.live == 0 ? 0 : 1);
  if (sources != 1)
    stop(kUsage, "say what was repeated: scans or a folder of them, --slab, --values, or --live; one of them");
  const GaugeTask task = task_of(options);
  SamePart part;
  const auto [measurements, source] = !options.scans.empty()   ? from_scans(options, part)
                                      : !options.slabs.empty() ? from_slabs(options, part)
                                      : options.live != 0      ? from_line(options)
                                                               : from_table(options);
  StudyNotes notes = part.settle(options.same_part);
  if (measurements.size() < 2) stop(kBadInput, fmt::format("{}: a repeat needs two runs at least", source));
  RepeatStudy study = repeat_study(measurements, options.items, options.block, task, options.values.empty());
  study.source = source;
  study.notes = std::move(notes);
  need_known(options, task, measurements, study);
  for (const std::string& warning : study.warnings) complain("warning: " + warning);
  options.document.write(repeat_report(study, options.document.wanted()));
  fmt::print("{}", options.json ? repeat_json(study) : repeat_text(study, options.details));
  return exit_of(study.judgement());
}

}  // namespace

void add_repeat(args::Command& study) {
  auto options = std::make_shared<RepeatOptions>();
  args::Command command = study.add_subcommand("repeat", "One thing measured many times: scatter, range, Cg and Cgk");
  command->footer(
      "\nWithout --reference: mean, standard deviation with its 95 % interval, range and largest deviation of every\n"
      "characteristic, as the paper's ten repeats. With it: a type-1 study. Capable needs 50 runs, none missing, and "
      "Cg\n"
      "and Cgk of 1.33; anything else is not. T is the recipe's tolerance where it has two limits, else say "
      "--tolerance.\n\n"
      "--values: a table with the columns item, value and, if you like, run, block, lower, upper.\n"
      "Examples: slabctl study repeat scans/ --recipe p5600.toml --block 3\n"
      "          slabctl study repeat --slab MASTER-1                 # every inspection of this slab\n"
      "          slabctl study repeat --slab MASTER-1 --block 3 --reference seat_slope=1.4312\n"
      "          slabctl study repeat --slab 12 --attempts --block 3  # the attempts at one block\n"
      "          slabctl study repeat --live 3 --count 50 --enter --recipe p5600.toml  # on the line, robot coming "
      "back\n"
      "Exit status: 0 done, and capable where a reference is given; 1 not capable or undecided.");
  command->add_option("SCAN", options->scans, "Scan files, or folders of them in the order of their names");
  options->scan.add_to(*command);
  command->add_option("--slab", options->slabs, "Stored slabs: a key, or a slab id for all its inspections; repeatable")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  command->add_option("--runs", options->runs, "Number of inspections of a slab id, the newest")
      ->check(args::range(std::size_t{2}, std::size_t{100'000}))
      ->capture_default_str();
  command->add_flag("--attempts", options->attempts, "Every attempt at --block is a run, not only the valid one");
  command->add_option("--values", options->values, "A table of values measured elsewhere");
  command->add_option("--live", options->live, "On the running line: scans of the block below the robot, by the daemon")
      ->check(args::range(1, static_cast<int>(limits::kStationsMax)));
  command->add_option("--count", options->count, "With --live: how many scans")
      ->check(args::range(std::size_t{2}, std::size_t{1000}))
      ->capture_default_str();
  options->scanner.add_to(*command);
  command->add_flag("--enter", options->enter, "With --live: Enter before every scan, when the robot has come back");
  command->add_option("--block", options->block, "Only this block; needed for scans")
      ->check(args::range(1, static_cast<int>(limits::kStationsMax)));
  command->add_option("--item", options->items, "Only this item; repeatable")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  command->add_option("--reference", options->references, "True value: ITEM=VALUE, or ITEM@BLOCK=VALUE; repeatable")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  command
      ->add_option("--tolerance", options->tolerances,
                   "T, upper limit minus lower limit: ITEM=WIDTH, or ITEM@BLOCK=WIDTH; repeatable")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  add_same_part(*command, options->same_part);
  command->add_flag("--details", options->details, "Every block in a line of its own");
  options->document.add_to(*command);
  options->database.add_to(*command);
  command->add_flag("--json", options->json, "Print slabd.study_repeat/1 on stdout");
  command->runs([options] { return run_repeat(*options); });
}

}  // namespace slabd::cli::study
