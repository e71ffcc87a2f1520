// SPDX-License-Identifier: Apache-2.0
//
// slabctl study repeat: the same thing measured again and again, from scans, stored slabs, a table, or on the line.
#include <fmt/core.h>
#include <chrono>
#include <memory>
#include <optional>
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

bool failed(const Error& why, int& exit_status) {
  complain(why.text.view());
  exit_status = exit_for(why.code);
  return false;
}

bool from_scans(const RepeatOptions& options, std::vector<Take>& takes, std::string& source, SamePart& part,
                int& exit_status) {
  Recipe recipe;
  if (!options.scan.load(recipe, exit_status)) return false;
  if (options.block < 1 || options.block > recipe.stations()) {
    complain(fmt::format("scans are of one block: --block 1..{}", recipe.stations()));
    exit_status = kUsage;
    return false;
  }
  const auto files = scan_files(options.scans);
  if (!files.ok()) return failed(files.error(), exit_status);
  warn_unconfirmed(recipe);
  ScanMeter meter(recipe, *length_unit(options.scan.unit), options.scan.threads);
  for (const std::string& file : files.value()) {
    const ProgressNote note(stderr, fmt::format("measuring {} ...", file), std::chrono::seconds(1));
    auto readings = meter.measure(file, options.block);
    if (!readings.ok()) return failed(readings.error(), exit_status);
    part.add_scan("", file, options.block, meter.shape());
    takes.push_back({file, std::move(readings.value())});
  }
  source = fmt::format("{} scans of block {}, recipe {}", takes.size(), options.block, recipe.name.view());
  return true;
}

bool from_slabs(const RepeatOptions& options, std::vector<Take>& takes, std::string& source, SamePart& part,
                int& exit_status) {
  const auto reader = open_database(options.database, exit_status);
  if (reader == nullptr) return false;
  std::set<std::int64_t> seen;  // a slab that is named twice, once by its id perhaps, was not measured twice
  for (const std::string& wanted : options.slabs) {
    const auto records = slabs_named(*reader, wanted, options.runs);
    if (!records.ok()) return failed(records.error(), exit_status);
    if (records.value().empty()) return failed(no_slab_named(wanted), exit_status);
    for (const storage::SlabRecord& record : records.value()) {
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
  if (options.attempts && options.block == 0) {
    complain("--attempts are repeats of one block: --block K");
    exit_status = kUsage;
    return false;
  }
  if (options.attempts)
    std::erase_if(takes,
                  [&](const Take& t) { return t.readings.empty() || t.readings.front().block != options.block; });
  source = fmt::format("{} {}: {}", takes.size(), options.attempts ? "attempts" : "stored runs",
                       takes.empty() ? "none" : takes.front().name + " .. " + takes.back().name);
  return true;
}

bool from_line(const RepeatOptions& options, std::vector<Take>& takes, std::string& source, int& exit_status) {
  Recipe recipe;
  if (!options.scan.load(recipe, exit_status)) return false;
  if (options.live > recipe.stations() || (options.block != 0 && options.block != options.live)) {
    complain(fmt::format("--live {}: recipe {} has blocks 1..{}, and --block is not needed", options.live,
                         recipe.name.view(), recipe.stations()));
    exit_status = kUsage;
    return false;
  }
  warn_unconfirmed(recipe);
  const LiveOrder order{options.database.config, options.live, options.count, options.enter, options.scan.threads};
  if (!live_takes(order, recipe, takes, exit_status)) return false;
  source = fmt::format("{} scans of block {} on the line, recipe {}", takes.size(), options.live, recipe.name.view());
  return true;
}

bool from_table(const RepeatOptions& options, std::vector<Take>& takes, std::string& source, int& exit_status) {
  const auto table = CsvTable::read(options.values);
  if (!table.ok()) return failed(table.error(), exit_status);
  auto read = takes_of(table.value());
  if (!read.ok()) return failed(read.error(), exit_status);
  takes = std::move(read.value());
  source = fmt::format("{} runs in {}", takes.size(), options.values);
  return true;
}

bool task_of(const RepeatOptions& options, GaugeTask& task) {
  for (const auto& [option, texts, target] : {std::tuple{"--reference", &options.references, &task.references},
                                              std::tuple{"--tolerance", &options.tolerances, &task.tolerances}})
    for (const std::string& text : *texts) {
      std::string item;
      double value = 0.0;
      if (!parse_assignment(option, text, item, value)) return false;
      if (target == &task.tolerances && !(value > 0.0)) {
        complain(fmt::format("--tolerance '{}': a width above 0, upper limit minus lower limit", text));
        return false;
      }
      (*target)[item] = value;
    }
  return true;
}

/// An item that is named but measured nowhere is most likely a slip.
bool all_known(const RepeatOptions& options, const GaugeTask& task, const std::vector<Take>& takes,
               const RepeatStudy& study) {
  const auto there = [&](const std::string& wanted) {
    for (const Characteristic& c : study.characteristics)
      if (wanted == c.about.item || wanted == fmt::format("{}@{}", c.about.item, c.about.block)) return true;
    std::vector<std::string> names;
    for (const Take& take : takes)
      for (const Reading& reading : take.readings) names.push_back(reading.item);
    const std::string meant = nearest(wanted.substr(0, wanted.find('@')), names);
    complain(fmt::format("'{}' was not measured here{}", wanted,
                         meant.empty() ? "" : fmt::format(", did you mean '{}'?", meant)));
    return false;
  };
  for (const std::string& item : options.items)
    if (!there(item)) return false;
  for (const auto* of : {&task.references, &task.tolerances})
    for (const auto& [item, value] : *of)
      if (!there(item)) return false;
  return true;
}

int run_repeat(const RepeatOptions& options) {
  if (!options.document.usable()) return kUsage;
  const int sources = (options.scans.empty() ? 0 : 1) + (options.slabs.empty() ? 0 : 1) +
                      (options.values.empty() ? 0 : 1) + (options.live == 0 ? 0 : 1);
  if (sources != 1) {
    complain("say what was repeated: scans or a folder of them, --slab, --values, or --live; one of them");
    return kUsage;
  }
  GaugeTask task;
  if (!task_of(options, task)) return kUsage;
  std::vector<Take> takes;
  std::string source;
  int exit_status = kDone;
  SamePart part;
  const bool good = !options.scans.empty()   ? from_scans(options, takes, source, part, exit_status)
                    : !options.slabs.empty() ? from_slabs(options, takes, source, part, exit_status)
                    : options.live != 0      ? from_line(options, takes, source, exit_status)
                                             : from_table(options, takes, source, exit_status);
  if (!good) return exit_status;
  StudyNotes notes;
  if (!part.settle(options.same_part, notes)) return kBadInput;
  if (takes.size() < 2) {
    complain(fmt::format("{}: a repeat needs two runs at least", source));
    return kBadInput;
  }
  RepeatStudy study = repeat_study(takes, options.items, options.block, task, options.values.empty());
  study.source = source;
  study.notes = std::move(notes);
  if (!all_known(options, task, takes, study)) return kUsage;
  for (const std::string& warning : study.warnings) complain("warning: " + warning);
  if (const int status = write_document(repeat_report(study, options.document.wanted()), options.document.out);
      status != kDone)
    return status;
  if (options.json) {
    fmt::print("{}", repeat_json(study));
  } else {
    print_repeat(study, options.details);
  }
  return exit_of(study.judgement());
}

}  // namespace

void add_repeat(args::Command& study, int& exit_status) {
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
  command->callback([options, &exit_status] { exit_status = run_repeat(*options); });
}

}  // namespace slabd::cli::study
