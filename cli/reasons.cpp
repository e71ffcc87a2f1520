// SPDX-License-Identifier: Apache-2.0
//
// slabctl reasons: reasons for failed, undecided or stopped items and blocks, the most frequent first.
#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <map>
#include <memory>

#include "cli/command.h"
#include "cli/database.h"
#include "cli/exit.h"
#include "cli/slab_choice.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/document.h"
#include "cli/trend/yield.h"
#include "report/json.h"
#include "report/slab_view.h"

namespace slabd::cli {
namespace {

struct Options {
  DatabaseOptions database;
  SlabChoice choice;
  DocumentOptions document;
  TableOutput output;
};

/// Bars of the items, all stations together; blocks that were stopped by their reason.
std::vector<trend::ParetoBar> bars_of(const report::Table& table, report::Language language) {
  std::map<std::pair<std::int64_t, std::string>, trend::ParetoBar> bars;
  for (const report::Table::Row& row : table.rows) {
    const auto number = [&](std::size_t column) { return std::get<std::int64_t>(row[column].number); };
    trend::ParetoBar& bar = bars[{number(0), row[1].text}];
    const std::optional<ItemId> item = item_from_name(row[1].text);
    bar.name = item ? report::item_word(*item, language)
                    : report::reason_sentence(static_cast<std::uint16_t>(number(0)), language);
    bar.failed += static_cast<std::size_t>(number(4));
    bar.others += static_cast<std::size_t>(number(5) + number(6));
  }
  std::vector<trend::ParetoBar> list;
  for (auto& [at, bar] : bars) list.push_back(std::move(bar));
  return list;
}

report::Table empty_table(int slabs, report::Language language) {
  const auto say = [&](std::string_view en, std::string_view zh) { return report::pick(language, en, zh); };
  report::Table table{{say("reason", "原因代码"), "reason"},         {say("item", "检测项目") + "<", "item"},
                      {say("station", "检测位"), "station"},         {say("to", "至") + "?", "station_to"},
                      {say("failed", "不合格"), "failed"},           {say("undecided", "无法判定"), "undecided"},
                      {say("stopped", "已停止"), "stopped"},         {say("count", "次数"), "count"},
                      {say("sum %", "累计 %"), "cumulative_percent"}};
  table.title = fmt::format(
      fmt::runtime(say("Reasons of {} slabs, the most frequent first", "{} 块板的原因，按次数排列")), slabs);
  return table;
}

void write_document(const DocumentOptions& to, const report::Table& table, std::uint8_t emulated) {
  if (to.out.empty()) return;
  report::Report document;
  document.language = to.wanted();
  document.judged = false;
  document.emulated = emulated;
  document.title = report::pick(to.wanted(), "Reasons", "不合格原因");
  report::Section& section = document.sections.emplace_back();
  section.parts.emplace_back(report::Figures{{trend::pareto_figure(bars_of(table, to.wanted()), to.wanted())}});
  section.parts.emplace_back(table);
  to.write(document);
}

int show_reasons(Options options) {
  options.document.check();
  const auto reader = open_database(options.database);
  options.choice.all = true;
  // Counts by verdict, for each reason with its item ("block" for a block) and its stations.
  std::map<std::tuple<int, std::string_view, int, int>, std::map<Verdict, int>> counts;
  int slabs = 0;
  int total = 0;
  std::uint8_t emulated = 0;
  for (const storage::Inspection& slab : ended_slabs(*reader, options.choice)) {
    ++slabs;
    emulated = static_cast<std::uint8_t>(emulated | slab.emulated);
    if (slab.verdict == Verdict::pass) continue;  // all that is required of it has passed
    const auto record = need(reader->slab(slab.slab_key), kNotReachable);
    if (!record) continue;  // the daemon has pruned it meanwhile
    const auto count = [&](int reason, std::string_view item, int station, int to, Verdict verdict) {
      if (reason <= 0 || verdict == Verdict::pass || verdict == Verdict::none) return;
      ++counts[{reason, item, station, to}][verdict];
      ++total;
    };
    std::array<bool, limits::kStationsMax + 1> stopped{};  // by station: its items do not have reasons of their own
    for (int station = 1; station <= record->summary.header.stations; ++station)
      if (const auto [verdict, reason] = report::shown(*record, station); reason != 0 && reason < kReasonItemBase) {
        count(reason, "block", station, 0, verdict);
        stopped.at(static_cast<std::size_t>(station)) = true;
      }
    for (const Item& item : report::items_in_force(*record))
      if (has_value(item.value) || (item.required && !stopped.at(item.station) && !stopped.at(item.station_to)))
        count(info(item.id).reason, info(item.id).name, item.station, item.station_to, item.verdict);
  }
  report::Table table =
      empty_table(slabs, options.output.json || options.output.csv ? report::Language::en : options.document.wanted());
  for (auto& [at, by] : counts) {
    const auto& [reason, item, station, to] = at;
    const int stopped = by[Verdict::not_measured] + by[Verdict::aborted];
    table.add(reason, item, station == 0 ? report::Cell("") : report::Cell(station),
              to == 0 ? report::Cell("") : report::Cell(to), by[Verdict::fail], by[Verdict::indeterminate], stopped,
              by[Verdict::fail] + by[Verdict::indeterminate] + stopped);
  }
  const auto times = [](const report::Table::Row& row) { return std::get<std::int64_t>(row[7].number); };
  std::ranges::stable_sort(table.rows, std::greater(), times);
  std::int64_t sum = 0;
  for (report::Table::Row& row : table.rows)
    row.emplace_back(100.0 * static_cast<double>(sum += times(row)) / total, 1);
  write_document(options.document, table, emulated);
  report::Json json("slabd.reasons/1");
  options.output.print(table, json.field("slabs", slabs), "reasons");
  return kDone;
}

}  // namespace

void add_reasons(args::Command& app) {
  auto options = std::make_shared<Options>();
  args::Command command = app.add_subcommand("reasons", "How often each reason failed, stopped or left undecided");
  command->footer(
      "\nReads ended slabs only, all of them without a filter.\nExample: slabctl reasons --since 7d --html > "
      "reasons.html\n         slabctl reasons --since 7d --out pareto.pdf");
  options->choice.add_filters_to(*command);
  options->document.add_to(*command);
  options->database.add_to(*command);
  options->output.add_to(*command, "slabd.reasons/1");
  command->runs([options] { return show_reasons(*options); });
}

}  // namespace slabd::cli
