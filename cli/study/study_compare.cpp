// SPDX-License-Identifier: Apache-2.0
//
// slabctl study compare: a laboratory's table against stored slabs, scans, or another table.
#include <fmt/core.h>
#include <algorithm>
#include <chrono>
#include <filesystem>
#include <memory>
#include <set>

#include "cli/command.h"
#include "cli/database.h"
#include "cli/exit.h"
#include "cli/study/compare.h"
#include "cli/study/study.h"
#include "cli/study/study_report.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/progress.h"

namespace slabd::cli::study {
namespace {

struct CompareOptions {
  std::string contact;
  std::string values;
  std::string scans;
  ScanOptions scan;
  DatabaseOptions database;
  std::size_t runs = 1;
  std::vector<std::string> items;
  std::vector<std::string> allowed;
  std::string same_part;
  DocumentOptions document;
  bool json = false;
};

Status from_table(const CompareOptions& options, Side& side) {
  const auto table = CsvTable::read(options.values);
  if (!table.ok()) return table.error();
  auto read = side_of(table.value());
  if (!read.ok()) return read.error();
  side = std::move(read.value());
  return success();
}

/// Columns id, block, scan; paths from the table's own folder.
Status from_scans(const CompareOptions& options, const Recipe& recipe, Side& side, SamePart& part) {
  const auto table = CsvTable::read(options.scans);
  if (!table.ok()) return table.error();
  if (const Status good = table.value().expect({"id", "block", "scan"}, {}); !good.ok()) return good;
  ScanMeter meter(recipe, *length_unit(options.scan.unit), options.scan.threads);
  for (std::size_t row = 0; row < table.value().rows(); ++row) {
    const Result<int> block = table.value().block(row);
    if (!block.ok()) return block.error();
    const std::string& name = table.value().cell(row, "scan");
    if (block.value() == 0 || name.empty())
      return error(Code::config, "%s: no block or no scan", table.value().place(row).c_str());
    const std::string path = (std::filesystem::path(options.scans).parent_path() / name).string();
    const ProgressNote note(stderr, fmt::format("measuring {} ...", path), std::chrono::seconds(1));
    const auto readings = meter.measure(path, block.value());
    if (!readings.ok()) return readings.error();
    const std::string& id = table.value().cell(row, "id");
    part.add_scan(fmt::format("{}, block {}", id, block.value()), path, block.value(), meter.shape());
    for (const Reading& reading : readings.value()) add_to(side, id, reading);
  }
  return success();
}

/// Of the slabs that the laboratory names, what it measured on them.
Status from_slabs(const CompareOptions& options, const Side& contact, storage::Reader& reader, Side& side,
                  SamePart& part) {
  std::set<std::string> ids;
  for (const auto& [key, value] : contact) ids.insert(key.id);
  std::map<std::int64_t, std::string> called;  // key -> what the laboratory calls the slab
  for (const std::string& id : ids) {
    const auto records = slabs_named(reader, id, options.runs);
    if (!records.ok()) return records.error();
    // Of an id without a slab the rows are named as unmatched.
    for (const storage::SlabRecord& record : records.value()) {
      const std::int64_t key = record.summary.header.key;
      if (const auto [other, fresh] = called.try_emplace(key, id); !fresh)
        return error(Code::config,
                     "'%s' and '%s' both mean the slab of key %lld: one inspection counts once; name it one way",
                     other->second.c_str(), id.c_str(), static_cast<long long>(key));
      part.add_slab(id, record.summary.header);
      for (const Reading& reading : take_of(record).readings)
        if (contact.contains({id, reading.item, reading.block})) add_to(side, id, reading);
    }
  }
  return success();
}

void name_unmatched(const std::vector<ThingKey>& things, const char* side) {
  constexpr std::size_t kNamed = 20;
  for (std::size_t i = 0; i < std::min(things.size(), kNamed); ++i)
    complain(fmt::format("{}: {}, {}, {}", side, things[i].id, things[i].item,
                         things[i].block == 0 ? "whole slab" : fmt::format("block {}", things[i].block)));
  if (things.size() > kNamed) complain(fmt::format("{}: and {} more", side, things.size() - kNamed));
}

void keep_items(Side& side, const std::vector<std::string>& items) {
  if (items.empty()) return;
  std::erase_if(
      side, [&](const auto& entry) { return std::find(items.begin(), items.end(), entry.first.item) == items.end(); });
}

int run_compare(const CompareOptions& options) {
  options.document.check();
  if (!options.values.empty() && !options.scans.empty())
    stop(kUsage, "--values or --scans, not both; without them stored slabs are compared");
  std::map<std::string, double> allowed;
  for (const std::string& text : options.allowed) {
    const auto [item, value] = parse_assignment("--max-error", text);
    if (!(value > 0.0)) stop(kUsage, fmt::format("--max-error '{}': a size above 0", text));
    allowed[item] = value;
  }
  const auto table = need(CsvTable::read(options.contact));
  auto contact = need(side_of(table));
  Side measured;
  SamePart part;
  if (!options.values.empty()) {
    need(from_table(options, measured));
  } else if (!options.scans.empty()) {
    const Recipe recipe = options.scan.load();
    warn_unconfirmed(recipe);
    need(from_scans(options, recipe, measured, part));
  } else {
    const auto reader = open_database(options.database);
    need(from_slabs(options, contact, *reader, measured, part));
  }
  StudyNotes notes = part.settle(options.same_part);
  keep_items(contact, options.items);
  keep_items(measured, options.items);
  CompareStudy study = compare(contact, measured, allowed);
  study.source = fmt::format("{} against {}",
                             !options.values.empty()  ? options.values
                             : !options.scans.empty() ? options.scans
                                                      : std::string("stored slabs"),
                             options.contact);
  study.notes = std::move(notes);
  name_unmatched(study.only_reference, "not measured by slabd");
  // Of a scan the laboratory need not have measured everything.
  if (!options.values.empty()) name_unmatched(study.only_measured, "not in the contact table");
  if (study.items.empty())
    stop(kBadInput, fmt::format("{}: nothing in it was measured by slabd too; ids, items and blocks must be the same",
                                options.contact));
  const auto need_compared = [&](const char* option, const std::string& item) {
    if (std::none_of(study.items.begin(), study.items.end(), [&](const CompareItem& c) { return c.item == item; }))
      stop(kUsage, fmt::format("{}: '{}' was not compared", option, item));
  };
  for (const std::string& item : options.items) need_compared("--item", item);
  for (const auto& [item, value] : allowed) need_compared("--max-error", item);
  write_document(compare_report(study, options.document.wanted()), options.document.out);
  fmt::print("{}", options.json ? compare_json(study) : compare_text(study));
  return exit_of(study.judgement());
}

}  // namespace

void add_compare(args::Command& study) {
  auto options = std::make_shared<CompareOptions>();
  args::Command command = study.add_subcommand("compare", "Against a laboratory: errors, agreement limits, regression");
  command->footer(
      "\nCONTACT is the laboratory's table with the columns id (slab id or key), item, value and, if you like, block "
      "and\n"
      "U (k = 2). Compared with the newest inspection of each slab, or with --values (the same columns), or with "
      "--scans\n"
      "(columns id, block, scan). Several values of one thing are averaged on either side; what only one side has is\n"
      "named. The line is Deming's, because both sides err: by the stated U, or with equal errors.\n"
      "--max-error judges: capable when the agreement limits with their intervals lie inside, not capable when any\n"
      "error is larger, else undecided; also when slabd measured less of an item than is in CONTACT, or all errors\n"
      "are the same.\n"
      "Example: slabctl study compare cmm.csv --max-error jaw_distance=0.2\n"
      "Exit status: 0 done, and capable where judged; 1 not capable or undecided.");
  command->add_option("CONTACT", options->contact, "The laboratory's table")->required();
  command->add_option("--values", options->values, "What slabd found, as a table");
  command->add_option("--scans", options->scans, "Scans to measure, as a table");
  options->scan.add_to(*command);
  command->add_option("--runs", options->runs, "Of each slab id: the mean of this many inspections, the newest")
      ->check(args::range(std::size_t{1}, std::size_t{100'000}))
      ->capture_default_str();
  command->add_option("--item", options->items, "Of this item alone; repeatable")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  command->add_option("--max-error", options->allowed, "Largest error allowed: ITEM=VALUE; repeatable")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  add_same_part(*command, options->same_part);
  options->document.add_to(*command);
  options->database.add_to(*command);
  command->add_flag("--json", options->json, "Print slabd.study_compare/1 on stdout");
  command->runs([options] { return run_compare(*options); });
}

}  // namespace slabd::cli::study
