// SPDX-License-Identifier: Apache-2.0
#include "cli/study/compare.h"

#include <fmt/core.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <memory>
#include <set>

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

std::string interval(const Estimate& estimate, int digits) {
  return fmt::format("{} ({} .. {})", report::figure(estimate.value, digits), report::figure(estimate.low, digits),
                     report::figure(estimate.high, digits));
}

std::string where(const ThingKey& key) {
  return key.block == 0 ? key.id : fmt::format("{} block {}", key.id, key.block);
}

/// Relative or absolute difference that is only rounding: tables have at most six decimals.
constexpr double kSameErrors = 1e-9;

void judge_item(CompareItem& item) {
  if (!has_value(item.allowed)) return;
  item.judgement = Judgement::undecided;
  if (item.errors.max_abs > item.allowed) {
    item.judgement = Judgement::not_capable;
    item.reason = fmt::format("off by more than {:g}", item.allowed);
  } else if (item.missing > 0) {
    // Blocks that are hard to measure may also be measured with a larger error.
    item.reason = fmt::format("{} of {} not measured", item.missing, item.missing + item.pairs.size());
  } else if (item.errors.std <= kSameErrors * std::fmax(item.errors.max_abs, 1.0)) {
    item.reason = "all errors are the same: coarse figures, or one table copied";
  } else if (!has_value(item.limits.lower.low)) {
    item.reason = fmt::format("too few: {} pairs", item.pairs.size());
  } else if (item.limits.lower.low >= -item.allowed && item.limits.upper.high <= item.allowed) {
    item.judgement = Judgement::capable;
  } else {
    item.reason = "the agreement limits' intervals reach beyond";
  }
}

}  // namespace

void add_to(Side& side, const std::string& id, const Reading& reading) {
  if (!has_value(reading.value)) return;
  SideValue& there = side[{id, reading.item, reading.block}];
  const auto before = static_cast<double>(there.count);
  ++there.count;
  if (there.count == 1) {
    there.reading = reading;
    return;
  }
  // Most of U is common to all repeats, so averaging does not reduce it.
  there.reading.value = (before * there.reading.value + reading.value) / (before + 1.0);
  there.reading.U = (before * there.reading.U + reading.U) / (before + 1.0);
}

Result<Side> side_of(const CsvTable& table) {
  if (const Status good = table.expect({"id", "item", "value"}, {"block", "U"}); !good.ok()) return good.error();
  Side side;
  for (std::size_t row = 0; row < table.rows(); ++row) {
    Reading reading;
    reading.item = table.cell(row, "item");
    for (const char* column : {"id", "item", "value"})
      if (table.cell(row, column).empty()) return error(Code::config, "%s: no %s", table.place(row).c_str(), column);
    const Result<int> block = table.block(row);
    const Result<double> value = table.number(row, "value");
    const Result<double> U = table.number(row, "U");
    if (!block.ok()) return block.error();
    if (!value.ok()) return value.error();
    if (!U.ok()) return U.error();
    if (U.value() <= 0.0) return error(Code::config, "%s: U must be above 0", table.place(row).c_str());
    reading.block = block.value();
    reading.value = value.value();
    reading.U = U.value();
    add_to(side, table.cell(row, "id"), reading);
  }
  return side;
}

CompareStudy compare(const Side& reference, const Side& measured, const std::map<std::string, double>& allowed) {
  CompareStudy study;
  std::map<std::pair<std::size_t, std::string>, CompareItem> items;
  std::vector<Pair> all_mm;
  for (const auto& [key, theirs] : reference) {
    const auto found = measured.find(key);
    if (found == measured.end()) {
      study.only_reference.push_back(key);
      continue;
    }
    const Reading& ours = found->second.reading;
    const Pair pair{theirs.reading.value, ours.value, theirs.reading.U, ours.U};
    CompareItem& item = items[{rank_of(key.item), key.item}];
    item.item = key.item;
    item.things.push_back(key);
    item.pairs.push_back(pair);
    if (unit_of(key.item) == "mm") all_mm.push_back(pair);
  }
  for (const auto& [key, ours] : measured)
    if (!reference.contains(key)) study.only_measured.push_back(key);
  for (auto& [rank, item] : items) {
    std::vector<double> theirs;
    std::vector<double> ours;
    for (const Pair& pair : item.pairs) {
      theirs.push_back(pair.reference);
      ours.push_back(pair.value);
    }
    item.reference_mean = spread_of(theirs).mean;
    item.value_mean = spread_of(ours).mean;
    item.errors = errors_of(item.pairs);
    item.limits = agreement_limits(item.pairs);
    item.line = deming(item.pairs);
    item.missing =
        static_cast<std::size_t>(std::count_if(study.only_reference.begin(), study.only_reference.end(),
                                               [&](const ThingKey& thing) { return thing.item == item.item; }));
    if (const auto limit = allowed.find(item.item); limit != allowed.end()) item.allowed = limit->second;
    judge_item(item);
    study.items.push_back(std::move(item));
  }
  study.all_mm = errors_of(all_mm);
  return study;
}

Judgement CompareStudy::judgement() const {
  Judgement worst = Judgement::not_judged;
  for (const CompareItem& item : items) {
    if (item.judgement == Judgement::not_capable) return item.judgement;
    if (item.judgement == Judgement::undecided || worst == Judgement::not_judged) worst = item.judgement;
  }
  return worst;
}

std::string compare_json(const CompareStudy& study) {
  report::Json json("slabd.study_compare/1");
  json.field("software", daemon::software_version()).field("source", study.source);
  json.field("judgement", study.judgement());
  write_notes(json, study.notes);
  json.list("items", study.items, [&](const CompareItem& item) {
    json.field("item", item.item).field("unit", unit_of(item.item)).field("reference_mean", item.reference_mean);
    json.field("value_mean", item.value_mean);
    json.field("errors", item.errors).field("agreement_limits", item.limits);
    json.key("regression").begin_object().field("method", "deming").field("ok", item.line.ok);
    json.field("why_not", item.line.why_not).field("variance_ratio", item.line.ratio);
    json.field("variance_ratio_from_U", item.line.ratio_from_U).field("slope", item.line.slope);
    json.field("intercept", item.line.intercept).end_object();
    json.field("allowed", item.allowed).field("judgement", item.judgement).field("reason", item.reason);
    json.key("pairs").begin_array();
    for (std::size_t i = 0; i < item.pairs.size(); ++i) {
      json.begin_object().field("id", item.things[i].id).field("block", item.things[i].block);
      json.field("reference", item.pairs[i].reference).field("value", item.pairs[i].value);
      json.field("reference_U", item.pairs[i].reference_U).field("U", item.pairs[i].U).end_object();
    }
    json.end_array();
  });
  json.field("all_mm", study.all_mm).field("only_reference", study.only_reference);
  json.field("only_measured", study.only_measured);
  return json.text();
}

report::Table errors_table(const CompareStudy& study, Reader reader) {
  report::Table table{pick(reader, "characteristic", "检测项目"),
                      pick(reader, "unit<", "单位<"),
                      "n",
                      pick(reader, "reference", "参考值"),
                      pick(reader, "measured", "实测值"),
                      pick(reader, "mean error (95 %)", "平均误差（95 %）"),
                      pick(reader, "mean |error|", "平均绝对误差"),
                      pick(reader, "max |error|", "最大误差"),
                      pick(reader, "at<", "位置<"),
                      "En max"};
  table.title = pick(reader, "Errors: measured less reference", "误差：实测值减参考值");
  for (const CompareItem& item : study.items) {
    const int digits = decimals_of(item.item);
    table.add(subject_of({.item = item.item}, reader), unit_of(item.item), item.pairs.size(),
              report::Cell(item.reference_mean, digits), report::Cell(item.value_mean, digits),
              interval(item.errors.mean, digits), report::Cell(item.errors.mean_abs, digits),
              report::Cell(item.errors.max_abs, digits), where(item.things[item.errors.worst]),
              report::Cell(item.errors.en_max, 2));
  }
  return table;
}

report::Table agreement_table(const CompareStudy& study, Reader reader) {
  report::Table table{pick(reader, "agreement", "一致性"),
                      pick(reader, "lower limit (95 %)", "下限（95 %）"),
                      pick(reader, "upper limit (95 %)", "上限（95 %）"),
                      pick(reader, "slope (95 %)", "斜率（95 %）"),
                      pick(reader, "intercept (95 %)", "截距（95 %）"),
                      pick(reader, "judgement<", "评定<")};
  table.title = pick(reader, "Limits of agreement and Deming's line", "一致性界限与 Deming 回归");
  for (const CompareItem& item : study.items) {
    const int digits = decimals_of(item.item);
    table.add(subject_of({.item = item.item}, reader), interval(item.limits.lower, digits),
              interval(item.limits.upper, digits), item.line.ok ? interval(item.line.slope, 4) : "-",
              item.line.ok ? interval(item.line.intercept, digits) : "-", judged(item.judgement, item.reason, reader));
  }
  return table;
}

std::string compare_text(const CompareStudy& study) {
  std::string text = study.source + "\n";
  for (const std::string& sentence : study.notes.sentences()) text += fmt::format("! {}\n", sentence);
  text += "\n" + report::text_of(errors_table(study));
  if (study.all_mm.count > 0)
    text += fmt::format("all {} lengths: mean |error| {} mm, max |error| {} mm\n", study.all_mm.count,
                        report::figure(study.all_mm.mean_abs, 3), report::figure(study.all_mm.max_abs, 3));
  text += "\n" + report::text_of(agreement_table(study), style_for(stdout));
  for (const CompareItem& item : study.items)
    if (!item.line.ok) text += fmt::format("no line for {}: {}\n", item.item, item.line.why_not);
  return text + "lines by Deming's regression, because both sides err\n";
}

// slabctl study compare: compares a laboratory's table with stored slabs, scans, or another table.

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

/// Reads columns id, block, scan; paths are relative to the table's folder.
Status from_scans(const CompareOptions& options, const Recipe& recipe, Side& side, SamePart& part) {
  const auto table = CsvTable::read(options.scans);
  if (!table.ok()) return table.error();
  if (const Status good = table.value().expect({"id", "block", "scan"}, {}); !good.ok()) return good;
  ScanMeter meter(recipe, options.scan.form.form(), options.scan.threads);
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

/// Reads the stored values of the slabs in the laboratory's table.
Status from_slabs(const CompareOptions& options, const Side& contact, storage::Reader& reader, Side& side,
                  SamePart& part) {
  std::set<std::string> ids;
  for (const auto& [key, value] : contact) ids.insert(key.id);
  std::map<std::int64_t, std::string> called;  // key -> the laboratory's name of the slab
  for (const std::string& id : ids) {
    const auto records = slabs_named(reader, id, options.runs);
    if (!records.ok()) return records.error();
    // The rows of an id without a slab are reported as unmatched.
    for (const storage::SlabRecord& record : records.value()) {
      const std::int64_t key = record.summary.header.key;
      if (const auto [other, fresh] = called.try_emplace(key, id); !fresh)
        return error(Code::config,
                     "'%s' and '%s' both mean the slab of key %lld: one inspection counts once; name it one way",
                     other->second.c_str(), id.c_str(), static_cast<long long>(key));
      part.add_slab(id, record.summary.header);
      for (const Reading& reading : measurement_of(record).readings)
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
  // The laboratory need not measure all features of a scan.
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
  options.document.write(compare_report(study, options.document.wanted()));
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
  command->add_option("--values", options->values, "Values of slabd, as a table");
  command->add_option("--scans", options->scans, "Scans to measure, as a table");
  options->scan.add_to(*command);
  command->add_option("--runs", options->runs, "Number of newest inspections of each slab id, whose mean is compared")
      ->check(args::range(std::size_t{1}, std::size_t{100'000}))
      ->capture_default_str();
  command->add_option("--item", options->items, "Only this item; repeatable")
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
