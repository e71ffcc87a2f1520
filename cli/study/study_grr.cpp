// SPDX-License-Identifier: Apache-2.0
//
// slabctl study grr: a plan of who measured what, from a table, scans or stored slabs.
#include <fmt/core.h>
#include <chrono>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <set>

#include "cli/command.h"
#include "cli/database.h"
#include "cli/exit.h"
#include "cli/study/grr_study.h"
#include "cli/study/study.h"
#include "cli/study/study_report.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/progress.h"

namespace slabd::cli::study {
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

/// An item that is named but not in the study is most likely a slip, and would leave its tolerance unheard.
void need_known(const GrrOptions& options, const std::map<std::string, double>& tolerances,
                const std::vector<Placing>& placings) {
  std::set<std::string> measured;
  for (const Placing& placing : placings)
    if (has_value(placing.reading.value)) measured.insert(placing.reading.item);
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

/// A path as the plan says it, from the plan's own folder.
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
    meter.emplace(recipe, *length_unit(options.scan.unit), options.scan.threads);
  } else if (plan.has("slab")) {
    reader = open_database(options.database);
  }
  PlanReaders readers;
  std::vector<Take> scans;
  SamePart same_part;
  std::size_t row = 0;  // each row of the plan is read once, in their order
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
  std::map<std::int64_t, std::set<int>> blocks_used;  // by slab key; 0: all of them
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
    Take take = take_of(records.value().front());
    // A plan with a column of blocks names a slab once for each of them.
    if (used.contains(0) || used.contains(block) || (block == 0 && !used.empty()))
      return error(Code::config, "slab '%s' (key %lld)%s is in the plan already: one measurement used twice",
                   slab.c_str(), static_cast<long long>(key),
                   block == 0 ? "" : fmt::format(", block {},", block).c_str());
    if (used.empty()) scans.push_back(take);
    used.insert(block);
    return take.readings;
  };
  const auto placings = need(placings_of(plan, readers));
  need_known(options, tolerances, placings);
  const Interaction interaction = options.interaction == "keep"   ? Interaction::keep
                                  : options.interaction == "pool" ? Interaction::pool
                                                                  : Interaction::automatic;
  const auto tolerance = [&](const std::string& item) {
    const auto found = tolerances.find(item);
    return found == tolerances.end() ? kNoValue : found->second;
  };
  StudyNotes notes = same_part.settle(options.same_part);
  GrrStudy study = grr_study(placings, options.items, tolerance, interaction);
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
  write_document(grr_report(study, options.document.wanted()), options.document.out);
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
  command->add_option("--item", options->items, "Of this item alone; repeatable")
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
