// SPDX-License-Identifier: Apache-2.0
//
// slabctl trend: one characteristic over the slabs: stability and capability of the process, and stations that differ
// from the others.
#include <fmt/core.h>

#include <algorithm>
#include <memory>
#include <set>

#include "cli/command.h"
#include "cli/database.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/document.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/render.h"
#include "cli/trend/trend_figure.h"
#include "report/figures.h"
#include "report/json.h"
#include "report/words.h"

namespace slabd::cli {
namespace {

using trend::Index;
using trend::Signal;
using trend::StationBias;
using trend::Trend;

struct Options {
  DatabaseOptions database;
  std::string item;
  std::string since;
  std::string until;
  DocumentOptions document;
  std::size_t slabs = 200;
  int block = 0;
  int type = 0;
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

std::string as_json(const Trend& t) {
  Json json("slabd.trend/1");
  json.field("item", info(t.item).name).field("unit", info(t.item).unit);
  json.field("slab_type", only_if(t.slab_type != 0, t.slab_type)).field("block", only_if(t.block != 0, t.block));
  json.field("value_is", t.is_mean ? "mean of the slab" : "single").field("slabs", t.chart.count);
  json.field("not_measured", t.not_measured).field("preliminary", t.chart.preliminary());
  json.field("emulated", t.emulated != 0).field("other_emulation", t.other_emulation);
  json.field("other_limits", t.other_limits).field("incomplete_slabs", t.incomplete).field("nominal", t.nominal);
  json.field("lower", t.lower).field("upper", t.upper).key("chart").begin_object().field("mean", t.chart.mean);
  json.field("sigma", t.chart.sigma).field("std", t.chart.std).field("moving_range", t.chart.moving_range);
  json.field("lower_control", t.chart.lower_control).field("upper_control", t.chart.upper_control);
  json.field("range_control", t.chart.range_control).end_object();
  json.key("capability").begin_object().field("confidence", 0.95).field("block", t.capable_block);
  json.field("values", t.singles.count).field("cp", t.capable.cp).field("cpk", t.capable.cpk).end_object();
  json.key("series").begin_array();
  for (std::size_t i = 0; i < t.values.size(); ++i) {
    json.begin_object().field("key", t.keys[i]).field("slab_id", t.ids[i]);
    write_time(json, "began", t.began_utime_us[i]);
    json.field("value", t.values[i]).field("signal", name(t.chart.signals[i])).end_object();
  }
  json.end_array();
  json.list("stations", t.stations, [&](const StationBias& s) {
    json.field("station", s.station).field("slabs", s.slabs).field("bias", s.bias).field("bias_sigma", s.bias_sigma);
    json.field("drift", s.drift).field("drift_sigma", s.drift_sigma).field("biased", s.biased());
    json.field("drifting", s.drifting());
  });
  return json.text();
}

/// Preliminary figures are printed faint.
std::string faint(std::string text, bool yes, Style style) {
  return yes && style.colour ? "\x1b[2m" + text + "\x1b[0m" : text;
}

std::string trend_text(const Trend& t, bool other_types) {
  std::string text;
  const Style style = style_for(stdout);
  const int digits = decimals(t.item);
  text += fmt::format("{} [{}]{}, {} slabs{}", info(t.item).name, slabd::name(info(t.item).unit),
                      t.block != 0 ? fmt::format(" of block {}", t.block) : (t.is_mean ? ", mean of each slab" : ""),
                      t.chart.count, t.slab_type != 0 ? fmt::format(" of type {}", t.slab_type) : "");
  if (t.not_measured > 0) text += fmt::format(", {} values not measured", t.not_measured);
  text += "\n";
  if (other_types)
    text += fmt::format("slabs of other types are left out: {} is the newest slab's, --slab-type takes another\n",
                        t.slab_type);
  if (t.emulated != 0) text += fmt::format("{}\n", report::emulation_notice(t.emulated, report::Language::en));
  if (t.other_emulation > 0)
    text += fmt::format("{} {} slabs left out: the newest slab is {}\n", t.other_emulation,
                        t.emulated != 0 ? "real" : "emulated", t.emulated != 0 ? "emulated" : "real");
  if (t.other_limits > 0)
    text += fmt::format("{} values left out that were judged by other limits than the newest\n", t.other_limits);
  if (t.incomplete > 0)
    text += fmt::format("{} slabs left out of the chart in which a block's value is missing\n", t.incomplete);
  if (t.values.empty()) return text;
  text += fmt::format("{} .. {}\n\n", iso_time(t.began_utime_us.front()), iso_time(t.began_utime_us.back()));
  text += fmt::format("  {}\n\n", trend::sparkline(t.values, 72, style.unicode));
  const bool few = t.chart.preliminary();
  std::size_t signals = 0;
  for (const Signal signal : t.chart.signals) signals += signal == Signal::none ? 0U : 1U;
  text +=
      faint(fmt::format(
                "mean {}   nominal {}   limits {} .. {}\ncontrol limits {} .. {}   sigma {} short-term, {} long-term\n",
                figure(t.chart.mean, digits), figure(t.nominal, digits), figure(t.lower, digits),
                figure(t.upper, digits), figure(t.chart.lower_control, digits), figure(t.chart.upper_control, digits),
                figure(t.chart.sigma, digits), figure(t.chart.std, digits)),
            few, style);
  if (few) {
    text += fmt::format("preliminary: {} slabs of {}; no capability, no signals before that\n", t.chart.count,
                        trend::kValuesMin);
  } else {
    text +=
        fmt::format("Cp {}   Cpk {}   (95 %, {} values{})\n", trend::index_text(t.capable.cp),
                    trend::index_text(t.capable.cpk), t.singles.count,
                    t.is_mean && t.capable_block != 0 ? fmt::format(" of block {}, the worst", t.capable_block) : "");
    text += fmt::format("{} of {} values out of control\n", signals, t.chart.count);
  }
  if (t.stations.empty()) return text;
  const Table stations = trend::stations_table(t, report::Language::en);
  return text + fmt::format("\n{}\n{}", stations.title, faint(text_of(stations, style), few, style));
}

int show_trend(const Options& options) {
  options.document.check();
  const std::optional<ItemId> item = item_from_name(options.item);
  if (!item) {
    std::vector<std::string> names;
    std::string known;
    for (std::size_t i = 0; i < kItemCount; ++i) {
      names.emplace_back(info(static_cast<ItemId>(i)).name);
      known += (known.empty() ? "" : ", ") + names.back();
    }
    const std::string meant = nearest(options.item, names);
    stop(kUsage, fmt::format("no item '{}'{}; items are {}", options.item,
                             meant.empty() ? "" : fmt::format(", did you mean '{}'?", meant), known));
  }
  storage::ItemFilter filter;
  filter.item = *item;
  filter.slabs = options.slabs;
  filter.slab_type = options.type;
  filter.block = options.block;
  if (!options.since.empty()) filter.since_utime_us = time_of("--since", options.since);
  if (!options.until.empty()) filter.until_utime_us = time_of("--until", options.until);
  const auto reader = open_database(options.database);
  auto values = reader->values(filter);
  // Slab types differ in blocks and limits: without --slab-type that of the newest slab is used.
  bool other_types = false;
  if (values && !values.value().empty()) {
    filter.slab_type = values.value().back().slab_type;
    other_types = std::any_of(values.value().begin(), values.value().end(),
                              [&](const storage::ItemValue& value) { return value.slab_type != filter.slab_type; });
    if (other_types) values = reader->values(filter);
  }
  if (!values) stop(kNotReachable, values.error().text.view());
  // Emulated and real slabs are separated as well; the newest slab selects which are shown.
  std::size_t others = 0;
  const bool emulated = !values.value().empty() && values.value().back().emulated != 0;
  if (const auto is_other = [&](const storage::ItemValue& value) { return (value.emulated != 0) != emulated; };
      std::any_of(values.value().begin(), values.value().end(), is_other)) {
    std::set<std::int64_t> keys;
    for (const storage::ItemValue& value : values.value())
      if (is_other(value)) keys.insert(value.slab_key);
    others = keys.size();
    std::erase_if(values.value(), is_other);
  }
  Trend t = trend::trend_of(*item, options.block, values.value());
  for (const storage::ItemValue& value : values.value())
    t.emulated = static_cast<std::uint8_t>(t.emulated | value.emulated);
  t.other_emulation = others;
  options.document.write(trend::document_of(t, options.document.wanted()));
  fmt::print("{}", options.json ? as_json(t) : trend_text(t, other_types));
  return kDone;
}

}  // namespace

void add_trend(args::Command& app) {
  auto options = std::make_shared<Options>();
  args::Command command =
      app.add_subcommand("trend", "One characteristic over the slabs: control chart, Cpk, stations");
  command->footer(
      "\nWithout --block the chart shows each slab's mean, and a table how far every station lies off the others.\n"
      "Fewer than 25 slabs are preliminary: no Cp, no Cpk, no signals.\n"
      "Examples: slabctl trend seat_slope\n"
      "          slabctl trend jaw_distance --block 4 --slabs 500 --out jaw-4.pdf\n"
      "          slabctl trend seat_flatness --since 7d --json");
  command->add_option("ITEM", options->item, "As `slabctl show` names it, such as seat_slope")->required();
  command->add_option("--block", options->block, "Only this block; of a spacing or pair, its first station")
      ->check(args::range(1, static_cast<int>(limits::kStationsMax)));
  command->add_option("--slabs", options->slabs, "How many slabs, the newest")
      ->check(args::range(std::size_t{2}, std::size_t{100'000}))
      ->capture_default_str();
  command->add_option("--slab-type", options->type, "Only this SLAB_TYPE; default: that of the newest slab")
      ->check(args::range(1, 65'535));
  command->add_option("--since", options->since, "Began then or later: 2026-11-20, 2026-11-20T08:00:00Z, 7d, 12h");
  command->add_option("--until", options->until, "Began before that");
  options->document.add_to(*command);
  options->database.add_to(*command);
  command->add_flag("--json", options->json, "Print slabd.trend/1 on stdout");
  command->runs([options] { return show_trend(*options); });
}

}  // namespace slabd::cli
