// SPDX-License-Identifier: Apache-2.0
//
// slabctl compare: two slabs item by item, or two periods characteristic by characteristic.
#include <fmt/core.h>

#include <algorithm>
#include <memory>

#include "cli/command.h"
#include "cli/database.h"
#include "cli/exit.h"
#include "cli/slab_choice.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/document.h"
#include "cli/terminal/json_language.h"
#include "cli/terminal/parse.h"
#include "cli/trend/comparison.h"
#include "cli/trend/stored.h"
#include "cli/trend/trend_figure.h"
#include "report/json.h"
#include "report/slab_view.h"

namespace slabd::cli {
namespace {

using report::Language;
using report::pick;
using trend::PeriodDifference;
using trend::PlaceDifference;
using trend::Trend;

struct Options {
  DatabaseOptions database;
  std::vector<std::string> slabs;
  std::vector<std::string> periods;
  int type = 0;
  bool all = false;
  DocumentOptions document;
  TableOutput output;
};

struct Period {
  std::int64_t since_utime_us = 0;
  std::int64_t until_utime_us = 0;
};

Period period_of(const std::string& text) {
  const std::size_t dots = text.find("..");
  if (dots == std::string::npos)
    stop(kUsage, fmt::format("--period {}: FROM..TO, such as 2026-11-01..2026-11-08 or 14d..7d", text));
  const Period period{time_of("--period", text.substr(0, dots)), time_of("--period", text.substr(dots + 2))};
  if (period.since_utime_us >= period.until_utime_us)
    stop(kUsage, fmt::format("--period {}: it ends before it begins", text));
  return period;
}

report::Table slab_table(const std::vector<PlaceDifference>& places, bool all, Language language) {
  report::Table table{{pick(language, "characteristic", "检测项目"), "item"},
                      {pick(language, "station", "检测位"), "station"},
                      {pick(language, "to", "至") + "?", "station_to"},
                      {"A", "a"},
                      {"B", "b"},
                      {"B - A", "difference"},
                      {"U", "U"},
                      {"En", "en"},
                      {pick(language, "A is", "A 结论") + "<", "verdict_a"},
                      {pick(language, "B is", "B 结论") + "<", "verdict_b"}};
  for (const PlaceDifference& place : places) {
    if (!all && !place.differs()) continue;
    const int digits = report::decimals(place.a.id);
    table.add(info(place.a.id).name, place.a.station == 0 ? report::Cell("") : report::Cell(place.a.station),
              place.a.station_to == 0 ? report::Cell("") : report::Cell(place.a.station_to),
              report::Cell(place.a.value, digits), report::Cell(place.b.value, digits),
              report::Cell(place.difference, digits), report::Cell(place.U, digits), report::Cell(place.en, 2),
              name(place.a.verdict), name(place.b.verdict));
  }
  return table;
}

/// The table of a document and of the terminal, and the table of programs with all places.
struct Comparison {
  report::Table shown;
  report::Table all;
  std::string kind;
  std::string subject;
  std::string note;
  std::uint8_t emulated = 0;  ///< emulation bits of all its slabs
};

Comparison of_slabs(storage::Reader& reader, const Options& options, Language language) {
  const storage::SlabRecord a = named_slab(reader, options.slabs[0]);
  const storage::SlabRecord b = named_slab(reader, options.slabs[1]);
  if (a.summary.header.key == b.summary.header.key)
    complain(fmt::format("warning: {} and {} are the same slab, key {}", options.slabs[0], options.slabs[1],
                         a.summary.header.key));
  for (const storage::SlabRecord* slab : {&a, &b})
    if (report::is_aborted(*slab))
      stop(kBadInput, fmt::format("slab key {} was aborted: there is nothing to compare", slab->summary.header.key));
  if (a.summary.header.slab_type != b.summary.header.slab_type)
    stop(kBadInput, fmt::format("slabs of types {} and {}: they have other nominals", a.summary.header.slab_type,
                                b.summary.header.slab_type));
  const std::vector<PlaceDifference> places =
      trend::differences_of(report::items_in_force(a), report::items_in_force(b));
  Comparison result;
  result.kind = "slabs";
  result.emulated = static_cast<std::uint8_t>(a.summary.header.emulated | b.summary.header.emulated);
  result.shown = slab_table(places, options.all, language);
  result.all = slab_table(places, true, language);
  const auto named = [](const storage::SlabRecord& slab) {
    return fmt::format("{} \"{}\"", slab.summary.header.key, slab.summary.header.slab_id.view());
  };
  result.subject = fmt::format("A {}, B {}", named(a), named(b));
  const auto differ = std::count_if(places.begin(), places.end(), [](const PlaceDifference& p) { return p.differs(); });
  const auto compared =
      std::count_if(places.begin(), places.end(), [](const PlaceDifference& p) { return has_value(p.en); });
  result.note =
      fmt::format(fmt::runtime(pick(language, "{} of {} places differ by more than the U of both (En above 1)",
                                    "{} / {} 处之差超过两者的 U（En 大于 1）")),
                  differ, compared);
  return result;
}

Comparison of_periods(storage::Reader& reader, const Options& options, Language language) {
  std::vector<Period> periods;
  for (const std::string& text : options.periods) periods.push_back(period_of(text));
  int slab_type = options.type;
  const auto trend_in = [&](ItemId item, const Period& period) {
    storage::ItemFilter filter;
    filter.item = item;
    filter.slabs = 100'000;
    filter.slab_type = slab_type;
    filter.since_utime_us = period.since_utime_us;
    filter.until_utime_us = period.until_utime_us;
    bool other_types = false;
    Trend result = trend::read_trend(reader, filter, other_types);
    if (slab_type == 0) slab_type = result.slab_type;
    return result;
  };
  std::vector<std::pair<Trend, Trend>> pairs;
  for (std::size_t i = 0; i < kItemCount; ++i) {
    Trend after = trend_in(static_cast<ItemId>(i), periods[1]);  // first: its newest slab selects the type
    Trend before = trend_in(static_cast<ItemId>(i), periods[0]);
    if (before.values > 0 && after.values > 0) pairs.emplace_back(std::move(before), std::move(after));
  }
  Comparison result;
  result.kind = "periods";
  report::Table table{{pick(language, "characteristic", "检测项目"), "item"},
                      {"n A", "slabs_a"},
                      {"n B", "slabs_b"},
                      {pick(language, "mean A", "均值 A"), "mean_a"},
                      {pick(language, "mean B", "均值 B"), "mean_b"},
                      {"B - A", "difference"},
                      {pick(language, "from", "下限"), "difference_low"},
                      {pick(language, "to", "上限"), "difference_high"},
                      {pick(language, "outside A", "超限 A"), "outside_a"},
                      {pick(language, "outside B", "超限 B"), "outside_b"},
                      {pick(language, "judgement", "判定") + "<", "judgement"}};
  std::size_t differ = 0;
  const std::size_t comparisons = pairs.size();
  for (auto& [before, after] : pairs) {
    result.emulated = static_cast<std::uint8_t>(result.emulated | before.emulated | after.emulated);
    const PeriodDifference d = trend::difference_of(std::move(before), std::move(after), comparisons);
    const int digits = report::decimals(d.after.item);
    if (d.differs()) ++differ;
    table.add(info(d.after.item).name, d.before.chart.count, d.after.chart.count,
              report::Cell(d.before.chart.mean, digits), report::Cell(d.after.chart.mean, digits),
              report::Cell(d.difference.value, digits), report::Cell(d.difference.low, digits),
              report::Cell(d.difference.high, digits), d.before.outside.size(), d.after.outside.size(),
              d.differs() ? pick(language, "differs", "有差异") : std::string());
  }
  result.shown = result.all = std::move(table);
  result.subject = fmt::format("A {}, B {}", options.periods[0], options.periods[1]);
  result.note = fmt::format(
      fmt::runtime(pick(language,
                        "{} of {} characteristics differ (95 % for all together, Welch's t of the slabs' values)",
                        "{} / {} 个检测项目有差异（全部合计 95 %，按板值的 Welch t 检验）")),
      differ, comparisons);
  return result;
}

int compare(const Options& options) {
  options.document.check();
  const bool slabs = options.slabs.size() == 2 && options.periods.empty();
  const bool periods = options.slabs.empty() && options.periods.size() == 2;
  if (!slabs && !periods) stop(kUsage, "name two slabs, or give --period FROM..TO twice");
  const auto reader = open_database(options.database);
  const auto in = [&](Language language) {
    return slabs ? of_slabs(*reader, options, language) : of_periods(*reader, options, language);
  };
  if (!options.document.out.empty()) {
    const Language language = options.document.wanted();
    Comparison comparison = in(language);
    report::Report document;
    document.language = language;
    document.judged = false;
    document.emulated = comparison.emulated;
    document.title = pick(language, "Comparison", "对比");
    document.subject = comparison.subject;
    comparison.shown.title = comparison.note;
    report::Section& section = document.sections.emplace_back();
    section.parts.emplace_back(report::Paragraph{comparison.note});
    section.parts.emplace_back(std::move(comparison.shown));
    options.document.write(document);
  }
  Comparison comparison = in(options.output.json ? json_language(options.document.language) : Language::en);
  report::Json json("slabd.comparison/1");
  json.field("of", comparison.kind).field("subject", comparison.subject).field("note", comparison.note);
  report::write_emulation(json, comparison.emulated);
  const bool for_people = !options.output.json && !options.output.csv;
  report::Table& table = for_people ? comparison.shown : comparison.all;
  table.title = fmt::format("{}\n{}", comparison.subject, comparison.note);
  if (for_people && comparison.emulated != 0)
    table.title += fmt::format("\n! {}", report::emulation_notice(comparison.emulated, Language::en));
  options.output.print(table, json, "rows");
  return kDone;
}

}  // namespace

void add_compare(args::Command& app) {
  auto options = std::make_shared<Options>();
  args::Command command = app.add_subcommand("compare", "Two slabs, or two periods: what differs");
  command->footer(
      "\nTwo slabs: places whose values differ by more than the uncertainties of both (En above 1); --all lists every\n"
      "place. Two periods: means of the slabs' values with an interval of the difference.\n"
      "Examples: slabctl compare SLAB-0042 SLAB-0043\n"
      "          slabctl compare --period 14d..7d --period 7d..1m");
  command->add_option("SLAB", options->slabs, "Two slabs: keys (see history) or slab ids");
  command->add_option("--period", options->periods, "FROM..TO, twice: the slabs that began in it");
  command->add_option("--slab-type", options->type, "Only this SLAB_TYPE; default: that of the newest slab")
      ->check(args::range(1, 65'535));
  command->add_flag("--all", options->all, "All places of two slabs, not only those that differ");
  options->document.add_to(*command);
  options->database.add_to(*command);
  options->output.add_to(*command, "slabd.comparison/1");
  command->runs([options] { return compare(*options); });
}

}  // namespace slabd::cli
