// SPDX-License-Identifier: Apache-2.0
//
// slabctl trend: one characteristic over the slabs: stability and capability of the process, and stations that differ
// from the others; without an item the capability of all characteristics in one table.
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
#include "cli/trend/stored.h"
#include "cli/trend/trend_figure.h"
#include "report/figures.h"
#include "report/json.h"
#include "report/words.h"

namespace slabd::cli {
namespace {

using trend::Point;
using trend::Signal;
using trend::StationBias;
using trend::Trend;
using trend::ValueIs;

struct Options {
  DatabaseOptions database;
  std::string item;
  std::string since;
  std::string until;
  DocumentOptions document;
  std::size_t slabs = 200;
  int block = 0;
  int type = 0;
  int mould = 0;
  bool json = false;
};

std::string_view name(Signal signal) {
  switch (signal) {
    case Signal::none: break;
    case Signal::beyond_limits: return "beyond_limits";
    case Signal::jump: return "jump";
    case Signal::nine_on_one_side: return "nine_on_one_side";
  }
  return "none";
}

std::string_view name(ValueIs value_is) {
  switch (value_is) {
    case ValueIs::single: break;
    case ValueIs::mean: return "mean of the slab";
    case ValueIs::largest: return "largest deviation of the slab";
  }
  return "single";
}

/// Fields that a trend and a row of the capability table share.
void write_judgement(report::Json& json, const Trend& t, report::Language language) {
  json.field("slabs", t.chart.count).field("not_measured", t.not_measured);
  json.field("preliminary", t.chart.preliminary()).field("other_limits", t.other_limits);
  json.field("incomplete_slabs", t.incomplete).field("nominal", t.nominal).field("lower", t.lower);
  json.field("upper", t.upper)
      .field("limits_differ", t.limits_differ)
      .key("capability")
      .begin_object()
      .field("confidence", 0.95);
  json.field("block", t.capable_block).field("values", t.singles.count).field("cp", t.capable.cp);
  json.field("cpk", t.capable.cpk).end_object();
  json.key("performance").begin_object().field("values", t.values).field("distribution", trend::name(t.whole.model));
  json.field("p", t.whole.p).field("pp", t.whole.pp).field("ppk", t.whole.ppk);
  json.field("outside", t.whole.outside.count).field("outside_share", t.whole.outside.share).end_object();
  json.field("signals", t.signals()).field("judgement", study::name(t.judgement));
  const std::string reason = trend::judgement_reason(t, language);
  json.field("judgement_reason", report::only_if(!reason.empty(), reason));
}

std::string as_json(const Trend& t, int mould, report::Language language) {
  report::Json json("slabd.trend/1");
  json.field("item", info(t.item).name).field("unit", info(t.item).unit);
  json.field("slab_type", report::only_if(t.slab_type != 0, t.slab_type))
      .field("block", report::only_if(t.block != 0, t.block))
      .field("mould", report::only_if(mould != 0, mould));
  json.field("value_is", name(t.value_is));
  json.field("emulated", t.emulated != 0).field("other_emulation", t.other_emulation);
  write_judgement(json, t, language);
  json.key("chart").begin_object().field("mean", t.chart.mean);
  json.field("sigma", t.chart.sigma).field("std", t.chart.std).field("moving_range", t.chart.moving_range);
  json.field("lower_control", t.chart.lower_control).field("upper_control", t.chart.upper_control);
  json.field("range_control", t.chart.range_control).end_object();
  json.list("series", t.points, [&](const Point& point) {
    json.field("key", point.key).field("slab_id", point.id);
    report::write_time(json, "began", point.began_utime_us);
    json.field("value", point.value).field("signal", name(point.signal)).field("measured", point.blocks);
    json.field("lowest", point.lowest).field("highest", point.highest).field("outside", point.outside);
  });
  json.list("outside", t.outside, [&](const trend::OutsideValue& value) {
    json.field("key", value.key).field("slab_id", value.id).field("station", value.item.station);
    json.field("station_to", report::only_if(value.item.station_to != 0, value.item.station_to));
    json.field("value", value.item.value).field("verdict", value.item.verdict);
  });
  json.list("stations", t.stations, [&](const StationBias& s) {
    json.field("station", s.station).field("slabs", s.slabs).field("bias", s.bias).field("bias_sigma", s.bias_sigma);
    json.field("drift", s.drift).field("drift_sigma", s.drift_sigma).field("biased", s.biased());
    json.field("drifting", s.drifting());
  });
  return json.text();
}

std::string as_json(const std::vector<Trend>& trends, int mould, report::Language language) {
  report::Json json("slabd.capability/1");
  const int slab_type = trends.empty() ? 0 : trends.front().slab_type;
  json.field("slab_type", report::only_if(slab_type != 0, slab_type));
  json.field("mould", report::only_if(mould != 0, mould));
  json.field("emulated", std::any_of(trends.begin(), trends.end(), [](const Trend& t) { return t.emulated != 0; }));
  json.list("items", trends, [&](const Trend& t) {
    json.field("item", info(t.item).name).field("unit", info(t.item).unit);
    write_judgement(json, t, language);
  });
  return json.text();
}

/// Preliminary figures are printed faint.
std::string faint(std::string text, bool yes, report::Style style) {
  return yes && style.colour ? "\x1b[2m" + text + "\x1b[0m" : text;
}

/// Slabs and values that are not in the figures.
std::string left_out_text(const Trend& t, bool other_types) {
  std::string text;
  if (other_types)
    text += fmt::format("slabs of other types are left out: {} is the newest slab's, --slab-type takes another\n",
                        t.slab_type);
  if (t.emulated != 0) text += fmt::format("{}\n", report::emulation_notice(t.emulated, report::Language::en));
  if (t.other_emulation > 0)
    text += fmt::format("{} {} slabs left out: the newest slab is {}\n", t.other_emulation,
                        t.emulated != 0 ? "real" : "emulated", t.emulated != 0 ? "emulated" : "real");
  if (t.other_limits > 0)
    text += fmt::format("{} values left out that were judged by other limits than the newest\n", t.other_limits);
  return text;
}

std::string lines_text(std::string_view title, const std::vector<std::string>& lines) {
  if (lines.empty()) return {};
  std::string text = fmt::format("{}\n", title);
  for (const std::string& line : lines) text += fmt::format("  {}\n", line);
  return text;
}

std::string trend_text(const Trend& t, bool other_types) {
  constexpr std::size_t kOutsideShown = 10;
  constexpr auto kLanguage = report::Language::en;
  std::string text;
  const report::Style style = style_for(stdout);
  const int digits = report::decimals(t.item);
  text += fmt::format("{} [{}]{}, {} slabs{}", info(t.item).name, slabd::name(info(t.item).unit),
                      t.block != 0                     ? fmt::format(" of block {}", t.block)
                      : t.value_is == ValueIs::mean    ? ", mean of each slab"
                      : t.value_is == ValueIs::largest ? ", largest deviation of each slab"
                                                       : "",
                      t.chart.count, t.slab_type != 0 ? fmt::format(" of type {}", t.slab_type) : "");
  if (t.not_measured > 0) text += fmt::format(", {} values not measured", t.not_measured);
  text += "\n" + left_out_text(t, other_types);
  if (t.incomplete > 0)
    text += fmt::format("{} slabs in the chart without a value, because that of a block is missing\n", t.incomplete);
  if (t.points.empty()) return text;
  text += fmt::format("{} .. {}\n\n", report::iso_time(t.points.front().began_utime_us),
                      report::iso_time(t.points.back().began_utime_us));
  std::vector<double> series;
  for (const Point& point : t.points) series.push_back(point.value);
  text += fmt::format("  {}\n\n", trend::sparkline(series, 72, style.unicode));
  const bool few = t.chart.preliminary();
  if (t.judgement != study::Judgement::not_judged)
    text += fmt::format("{} {}\noutside the limits {}\n", report::symbol(study::as_verdict(t.judgement), style),
                        trend::judgement_text(t, kLanguage), trend::outside_text(t, kLanguage));
  text += lines_text("values outside the limits", trend::outside_lines(t, kOutsideShown, kLanguage));
  text +=
      faint(fmt::format(
                "mean {}   nominal {}   limits {} .. {}\ncontrol limits {} .. {}   sigma {} short-term, {} long-term\n",
                report::figure(t.chart.mean, digits), report::figure(t.nominal, digits),
                report::figure(t.lower, digits), report::figure(t.upper, digits),
                report::figure(t.chart.lower_control, digits), report::figure(t.chart.upper_control, digits),
                report::figure(t.chart.sigma, digits), report::figure(t.chart.std, digits)),
            few, style);
  if (few) {
    text += fmt::format("preliminary: {} slabs of {}; no capability, no signals before that\n", t.chart.count,
                        trend::kValuesMin);
  } else {
    text += fmt::format("Cp {}   Cpk {}   (95 %, from slab to slab, {} values{})\n", trend::estimate_text(t.capable.cp),
                        trend::estimate_text(t.capable.cpk), t.singles.count,
                        t.value_is != ValueIs::single && t.capable_block != 0
                            ? fmt::format(" of block {}, the worst", t.capable_block)
                            : "");
    text += fmt::format("Pp {}   Ppk {}   (95 %, all {} values; {})\n", trend::estimate_text(t.whole.pp),
                        trend::estimate_text(t.whole.ppk), t.values, trend::model_text(t.whole, kLanguage));
    text += fmt::format("{} of {} values out of control\n", t.signals(), t.chart.count);
    text += lines_text("signals", trend::signal_lines(t, kLanguage));
  }
  if (t.stations.empty()) return text;
  const report::Table stations = trend::stations_table(t, kLanguage);
  return text + fmt::format("\n{}\n{}", stations.title, faint(report::text_of(stations, style), few, style));
}

ItemId item_named(const std::string& wanted) {
  const std::optional<ItemId> item = item_from_name(wanted);
  if (item) return *item;
  std::vector<std::string> names;
  std::string known;
  for (std::size_t i = 0; i < kItemCount; ++i) {
    names.emplace_back(info(static_cast<ItemId>(i)).name);
    known += (known.empty() ? "" : ", ") + names.back();
  }
  const std::string meant = nearest(wanted, names);
  stop(kUsage, fmt::format("no item '{}'{}; items are {}", wanted,
                           meant.empty() ? "" : fmt::format(", did you mean '{}'?", meant), known));
}

storage::ItemFilter filter_of(const Options& options) {
  storage::ItemFilter filter;
  filter.slabs = options.slabs;
  filter.slab_type = options.type;
  filter.block = options.block;
  filter.mould = options.mould;
  if (!options.since.empty()) filter.since_utime_us = time_of("--since", options.since);
  if (!options.until.empty()) filter.until_utime_us = time_of("--until", options.until);
  return filter;
}

/// All characteristics that have values.
int show_capability(const Options& options) {
  const auto reader = open_database(options.database);
  storage::ItemFilter filter = filter_of(options);
  storage::SlabFilter newest;
  newest.limit = 100;  // the newest ones may be open or aborted, without values
  newest.since_utime_us = filter.since_utime_us;
  newest.until_utime_us = filter.until_utime_us;
  newest.mould = filter.mould;
  if (filter.slab_type == 0) {
    const auto slabs = need(reader->slabs(newest), kNotReachable);
    const auto with_values = std::find_if(slabs.begin(), slabs.end(), [](const storage::SlabSummary& slab) {
      return slab.ended_utime_us != 0 && slab.verdict != Verdict::aborted;
    });
    if (with_values != slabs.end()) filter.slab_type = with_values->header.slab_type;
  }
  std::vector<Trend> trends = trend::read_trends(*reader, filter);
  std::erase_if(trends, [](const Trend& t) { return t.values == 0 || !(has_value(t.lower) || has_value(t.upper)); });
  options.document.write(trend::document_of(trends, options.document.wanted()));
  if (options.json) {
    fmt::print("{}", as_json(trends, options.mould, json_language(options.document.language)));
    return kDone;
  }
  if (trends.empty()) fmt::print("no values\n");
  if (trends.empty()) return kDone;
  const report::Table table = trend::capability_table(trends, report::Language::en);
  fmt::print("{} of slab type {}\n{}\n{}\n{}\n{}", table.title, trends.front().slab_type,
             left_out_text(trends.front(), false), report::text_of(table, style_for(stdout)),
             lines_text("reasons", trend::reason_lines(trends, report::Language::en)),
             "`slabctl trend ITEM` shows one characteristic: its chart, its signals, the values outside the limits\n");
  return kDone;
}

int show_trend(const Options& options) {
  options.document.check();
  if (options.item.empty()) {
    if (options.block != 0) stop(kUsage, "--block needs an ITEM");
    return show_capability(options);
  }
  storage::ItemFilter filter = filter_of(options);
  filter.item = item_named(options.item);
  const auto reader = open_database(options.database);
  bool other_types = false;
  const Trend t = trend::read_trend(*reader, filter, other_types);
  options.document.write(trend::document_of(t, options.document.wanted()));
  fmt::print("{}", options.json ? as_json(t, options.mould, json_language(options.document.language))
                                : trend_text(t, other_types));
  return kDone;
}

}  // namespace

void add_trend(args::Command& app) {
  auto options = std::make_shared<Options>();
  args::Command command =
      app.add_subcommand("trend", "Capability of all characteristics; with ITEM its control chart, signals, stations");
  command->footer(
      "\nWithout ITEM: one table with the share outside the limits, Cp, Cpk, Pp and Ppk of every characteristic.\n"
      "Without --block the chart shows each slab's mean and range (of seat positions, whose mean is zero by the fit,\n"
      "the largest deviation), and a table how far every station lies off the others.\n"
      "Fewer than 25 slabs are preliminary: no Cp, no Cpk, no signals.\n"
      "Examples: slabctl trend\n"
      "          slabctl trend seat_slope\n"
      "          slabctl trend jaw_distance --block 4 --slabs 500 --out jaw-4.pdf\n"
      "          slabctl trend seat_vertical --block 4 --mould 7\n"
      "          slabctl trend seat_flatness --since 7d --json");
  command->add_option("ITEM", options->item,
                      "As `slabctl show` names it, such as seat_slope; none: all characteristics");
  command->add_option("--block", options->block, "Only this block; of a spacing or pair, its first station")
      ->check(args::range(1, static_cast<int>(limits::kStationsMax)));
  command->add_option("--slabs", options->slabs, "How many slabs, the newest")
      ->check(args::range(std::size_t{2}, std::size_t{100'000}))
      ->capture_default_str();
  command->add_option("--slab-type", options->type, "Only this SLAB_TYPE; default: that of the newest slab")
      ->check(args::range(1, 65'535));
  command->add_option("--mould", options->mould, "Only slabs of this mould")->check(args::range(1, 65'535));
  command->add_option("--since", options->since, "Began then or later: 2026-11-20, 2026-11-20T08:00:00Z, 7d, 12h");
  command->add_option("--until", options->until, "Began before that");
  options->document.add_to(*command);
  options->database.add_to(*command);
  command->add_flag("--json", options->json, "Print slabd.trend/1 (slabd.capability/1 without ITEM) on stdout");
  command->runs([options] { return show_trend(*options); });
}

}  // namespace slabd::cli
