// SPDX-License-Identifier: Apache-2.0
//
// slabctl study repeat: the same thing measured again and again, from scans, stored slabs, a table, or on the line.
#include <fmt/core.h>
#include <chrono>
#include <memory>
#include <set>

#include "cli/command.h"
#include "cli/database.h"
#include "cli/exit.h"
#include "cli/study/repeat.h"
#include "cli/study/study.h"
#include "cli/study/study_live.h"
#include "cli/study/study_report.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/progress.h"

namespace slabd::cli::study {
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

/// What was measured, and where it comes from in words.
struct Runs {
  std::vector<Take> takes;
  std::string source;
};

Runs from_scans(const RepeatOptions& options, SamePart& part) {
  const Recipe recipe = options.scan.load();
  if (options.block < 1 || options.block > recipe.stations())
    stop(kUsage, fmt::format("scans are of one block: --block 1..{}", recipe.stations()));
  const auto files = need(scan_files(options.scans));
  warn_unconfirmed(recipe);
  std::vector<Take> takes;
  ScanMeter meter(recipe, *length_unit(options.scan.unit), options.scan.threads);
  for (const std::string& file : files) {
    const ProgressNote note(stderr, fmt::format("measuring {} ...", file), std::chrono::seconds(1));
    takes.push_back({file, need(meter.measure(file, options.block))});
    part.add_scan("", file, options.block, meter.shape());
  }
  std::string source = fmt::format("{} scans of block {}, recipe {}", takes.size(), options.block, recipe.name.view());
  return {std::move(takes), std::move(source)};
}

Runs from_slabs(const RepeatOptions& options, SamePart& part) {
  const auto reader = open_database(options.database);
  std::vector<Take> takes;
  std::set<std::int64_t> seen;  // a slab that is named twice, once by its id perhaps, was not measured twice
  for (const std::string& wanted : options.slabs) {
    const auto records = need(slabs_named(*reader, wanted, options.runs));
    if (records.empty()) stop(no_slab_named(wanted));
    for (const storage::SlabRecord& record : records) {
      if (!seen.insert(record.summary.header.key).second) continue;
      part.add_slab("", record.summary.header);
      if (!options.attempts) {
        takes.push_back(take_of(record));
        continue;
      }
      for (Take& take : attempts_of(record)) takes.push_back(std::move(take));
    }
  }
  // Attempts at other blocks are no runs of this one.
  if (options.attempts && options.block == 0) stop(kUsage, "--attempts are repeats of one block: --block K");
  if (options.attempts)
    std::erase_if(takes,
                  [&](const Take& t) { return t.readings.empty() || t.readings.front().block != options.block; });
  std::string source = fmt::format("{} {}: {}", takes.size(), options.attempts ? "attempts" : "stored runs",
                                   takes.empty() ? "none" : takes.front().name + " .. " + takes.back().name);
  return {std::move(takes), std::move(source)};
}

Runs from_line(const RepeatOptions& options) {
  const Recipe recipe = options.scan.load();
  if (options.live > recipe.stations() || (options.block != 0 && options.block != options.live))
    stop(kUsage, fmt::format("--live {}: recipe {} has blocks 1..{}, and --block is not needed", options.live,
                             recipe.name.view(), recipe.stations()));
  warn_unconfirmed(recipe);
  const LiveOrder order{options.database.config, options.live, options.count, options.enter, options.scan.threads};
  std::vector<Take> takes = live_takes(order, recipe);
  std::string source =
      fmt::format("{} scans of block {} on the line, recipe {}", takes.size(), options.live, recipe.name.view());
  return {std::move(takes), std::move(source)};
}

Runs from_table(const RepeatOptions& options) {
  const auto table = need(CsvTable::read(options.values));
  std::vector<Take> takes = need(takes_of(table));
  std::string source = fmt::format("{} runs in {}", takes.size(), options.values);
  return {std::move(takes), std::move(source)};
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

/// An item that is named but measured nowhere is most likely a slip.
void need_known(const RepeatOptions& options, const GaugeTask& task, const std::vector<Take>& takes,
                const RepeatStudy& study) {
  const auto there = [&](const std::string& wanted) {
    for (const Characteristic& c : study.characteristics)
      if (wanted == c.about.item || wanted == fmt::format("{}@{}", c.about.item, c.about.block)) return;
    std::vector<std::string> names;
    for (const Take& take : takes)
      for (const Reading& reading : take.readings) names.push_back(reading.item);
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
  const auto [takes, source] = !options.scans.empty()   ? from_scans(options, part)
                               : !options.slabs.empty() ? from_slabs(options, part)
                               : options.live != 0      ? from_line(options)
                                                        : from_table(options);
  StudyNotes notes = part.settle(options.same_part);
  if (takes.size() < 2) stop(kBadInput, fmt::format("{}: a repeat needs two runs at least", source));
  RepeatStudy study = repeat_study(takes, options.items, options.block, task, options.values.empty());
  study.source = source;
  study.notes = std::move(notes);
  need_known(options, task, takes, study);
  for (const std::string& warning : study.warnings) complain("warning: " + warning);
  write_document(repeat_report(study, options.document.wanted()), options.document.out);
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
  command->add_option("--runs", options->runs, "Of a slab id: how many inspections, the newest")
      ->check(args::range(std::size_t{2}, std::size_t{100'000}))
      ->capture_default_str();
  command->add_flag("--attempts", options->attempts, "Every attempt at --block is a run, not only the valid one");
  command->add_option("--values", options->values, "A table of values measured elsewhere");
  command
      ->add_option("--live", options->live,
                   "On the running line: scans of the block that the robot stands over, through the daemon")
      ->check(args::range(1, static_cast<int>(limits::kStationsMax)));
  command->add_option("--count", options->count, "With --live: how many scans")
      ->check(args::range(std::size_t{2}, std::size_t{1000}))
      ->capture_default_str();
  command->add_flag("--enter", options->enter, "With --live: Enter before every scan, when the robot has come back");
  command->add_option("--block", options->block, "Of this block alone; needed for scans")
      ->check(args::range(1, static_cast<int>(limits::kStationsMax)));
  command->add_option("--item", options->items, "Of this item alone; repeatable")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  command
      ->add_option("--reference", options->references, "What it really is: ITEM=VALUE, or ITEM@BLOCK=VALUE; repeatable")
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
