// SPDX-License-Identifier: Apache-2.0
//
// slabctl yield: share of slabs that passed at their first inspection, by day, shift, slab type or mould.
#include <fmt/core.h>

#include <algorithm>
#include <memory>

#include "cli/command.h"
#include "cli/database.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/document.h"
#include "cli/terminal/json_language.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/render.h"
#include "cli/trend/yield.h"
#include "report/json.h"

namespace slabd::cli {
namespace {

using trend::GroupBy;
using trend::YieldGroup;

struct Options {
  DatabaseOptions database;
  std::string by = "day";
  std::string shifts = "06:00,14:00,22:00";
  std::string since;
  std::string until;
  int type = 0;
  DocumentOptions document;
  TableOutput output;
};

/// The reason of most of the slabs that did not pass; the lower code of two.
std::string main_reason(const YieldGroup& group, report::Language language) {
  const auto most = std::max_element(group.reasons.begin(), group.reasons.end(),
                                     [](const auto& a, const auto& b) { return a.second < b.second; });
  if (most == group.reasons.end()) return {};
  return fmt::format("{} x {}", most->second, report::reason_sentence(most->first, language));
}

/// `sentences`: language of the reasons. A program gets English names and sentences in the language that it chose.
report::Table yield_table(std::vector<YieldGroup> groups, const std::string& by, report::Language language,
                          report::Language sentences) {
  const auto say = [&](std::string_view en, std::string_view zh) { return report::pick(language, en, zh); };
  report::Table table{{by == "type"    ? say("slab type", "板型")
                       : by == "mould" ? say("mould, 0: unknown", "模具，0：未知")
                       : by == "shift" ? say("shift", "班次")
                                       : say("day", "日期"),
                       "group"},
                      {say("slabs", "板数"), "inspected"},
                      {say("passed", "合格"), "passed"},
                      {say("failed", "不合格"), "failed"},
                      {say("undecided", "无法判定"), "undecided"},
                      {say("not measured", "未测量"), "not_measured"},
                      {say("yield %", "一次合格率 %"), "yield_percent"},
                      {say("from", "下限"), "yield_low_percent"},
                      {say("to", "上限"), "yield_high_percent"},
                      {say("aborted", "中止"), "aborted"},
                      {say("again", "复检"), "again"},
                      {say("most frequent reason", "最常见原因") + "<", "main_reason"}};
  table.title = say("First-pass yield", "一次合格率");
  YieldGroup total = trend::total_of(groups);
  total.name = say("all", "合计");
  if (groups.size() > 1) groups.push_back(total);
  for (const YieldGroup& group : groups)
    table.add(group.name, group.inspected, group.passed, group.failed, group.undecided, group.not_measured,
              report::Cell(100.0 * group.yield.value, 1), report::Cell(100.0 * group.yield.low, 1),
              report::Cell(100.0 * group.yield.high, 1), group.aborted, group.again, main_reason(group, sentences));
  return table;
}

int show_yield(const Options& options) {
  options.document.check();
  const GroupBy by = options.by == "type"    ? GroupBy::type
                     : options.by == "mould" ? GroupBy::mould
                     : options.by == "shift" ? GroupBy::shift
                                             : GroupBy::day;
  const trend::Shifts shifts = need(trend::parse_shifts(options.shifts), kUsage);
  storage::InspectionFilter filter;
  if (!options.since.empty()) filter.since_utime_us = time_of("--since", options.since);
  if (!options.until.empty()) filter.until_utime_us = time_of("--until", options.until);
  filter.slab_type = options.type;
  const auto reader = open_database(options.database);
  const storage::Inspections inspections = need(reader->inspections(filter), kNotReachable);
  const bool emulated = inspections.emulated != 0;
  const std::size_t others = inspections.others;
  const std::vector<YieldGroup> groups = trend::first_pass_yield(inspections.list, by, shifts);
  if (!options.document.out.empty()) {
    const report::Language language = options.document.wanted();
    report::Report document;
    document.language = language;
    document.judged = false;
    if (emulated) document.emulated = inspections.emulated;
    const report::Table table = yield_table(groups, options.by, language, language);
    document.title = table.title;
    report::Section& section = document.sections.emplace_back();
    section.parts.emplace_back(report::Figures{{trend::yield_figure(groups, language)}});
    section.parts.emplace_back(table);
    options.document.write(document);
  }
  if (!options.output.json && !options.output.csv && !options.output.html) {
    if (emulated) fmt::print("! EMULATED slabs: no verdict on concrete\n");
    if (others > 0) fmt::print("! {} {} slabs are not counted\n", others, emulated ? "real" : "emulated");
  }
  report::Json json("slabd.yield/1");
  json.field("by", options.by).field("emulated", emulated).field("other_emulation", others);
  const bool for_programs = options.output.json || options.output.csv;
  const report::Language names = for_programs ? report::Language::en : options.document.wanted();
  const report::Language sentences = options.output.json ? json_language(options.document.language) : names;
  options.output.print(yield_table(groups, options.by, names, sentences), json, "groups");
  return kDone;
}

}  // namespace

void add_yield(args::Command& app) {
  auto options = std::make_shared<Options>();
  args::Command command = app.add_subcommand("yield", "First-pass yield by day, shift, slab type or mould");
  command->footer(
      "\nA slab counts once, at its first inspection that was not aborted; later ones are counted as again. The\n"
      "interval is that of Clopper and Pearson at 95 %. Days and shifts are in local time (TZ); a shift over midnight\n"
      "belongs to the day of its begin.\n"
      "Examples: slabctl yield --since 30d\n"
      "          slabctl yield --by shift --since 7d --out yield.pdf");
  command->add_option("--by", options->by, "Groups")
      ->check(args::one_of({"day", "shift", "type", "mould"}))
      ->capture_default_str();
  command->add_option("--shifts", options->shifts, "Begins of the shifts, local time")->capture_default_str();
  command->add_option("--since", options->since, "Began then or later: 2026-11-20, 2026-11-20T08:00:00Z, 7d, 12h");
  command->add_option("--until", options->until, "Began before that");
  command->add_option("--slab-type", options->type, "Only this SLAB_TYPE")->check(args::range(1, 65'535));
  options->document.add_to(*command);
  options->database.add_to(*command);
  options->output.add_to(*command, "slabd.yield/1");
  command->runs([options] { return show_yield(*options); });
}

}  // namespace slabd::cli
