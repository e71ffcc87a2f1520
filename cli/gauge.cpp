// SPDX-License-Identifier: Apache-2.0
//
// slabctl gauge list, check, history, enter: what the gauges read now, their master checks, and their values slab by
// slab. A check is stored by the daemon, or directly if it does not run.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "cli/client/calibration_change.h"
#include "cli/client/control.h"
#include "cli/command.h"
#include "cli/database.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/document.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/render.h"
#include "report/figures.h"
#include "report/json.h"
#include "report/words.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

/// A value that is older belongs to the time before the master was in its place.
constexpr double kCheckAgeS = 60.0;
constexpr double kHour_us = 3.6e9;

struct Options {
  std::string config;
  std::string gauge;
  std::string who;
  std::string why;
  double value = kNoValue;
  std::uint32_t slab_no = 0;
  std::size_t limit = 20;
  DatabaseOptions database;
  LanguageOption language;
  TableOutput output;
  bool checks = false;
  bool as_json = false;
};

json ask(const config::Config& config, const json& request) {
  const std::string answer = need(ask_daemon(config.control_socket, request.dump() + "\n"));
  json parsed = json::parse(answer, nullptr, false);
  if (!parsed.is_object()) stop(kInternal, say("the daemon's answer cannot be read"));
  if (parsed.contains("error")) stop(kBadInput, quote(parsed["error"].get<std::string>()));
  return parsed;
}

const GaugeSettings& gauge_of(const config::Config& config, const std::string& name) {
  std::vector<std::string> names;
  for (const GaugeSettings& gauge : config.gauges) {
    if (gauge.name == name) return gauge;
    names.emplace_back(gauge.name.view());
  }
  if (names.empty()) stop(kUsage, say("{}: there is no [[gauge]]", config.path));
  const std::string meant = nearest(name, names);
  stop(kUsage,
       meant.empty() ? say("there is no gauge {}", name) : say("there is no gauge {}; did you mean {}?", name, meant));
}

double number_of(const json& j, const char* key) {
  const auto found = j.find(key);
  return found == j.end() || !found->is_number() ? kNoValue : found->get<double>();
}

/// State of a gauge's master in a few words.
std::string check_words(const json& master, std::int64_t now_us) {
  if (master.is_null()) return say("without a master");
  const json& check = master["check"];
  if (check.is_null()) return say("never checked");
  const double left_h = static_cast<double>(check["due_utime_us"].get<std::int64_t>() - now_us) / kHour_us;
  const std::string deviation = fmt::format("{:+.3f}", check["deviation"].get<double>());
  if (!check["passed"].get<bool>()) return say("failed, {} off", deviation);
  return left_h < 0.0 ? say("overdue by {:.1f} h, {} off", -left_h, deviation)
                      : say("due in {:.1f} h, {} off", left_h, deviation);
}

std::string state_words(std::string_view state) {
  return report::gauge_state_sentence(gauge_state_of(state), language_in_use());
}

int list(const Options& options) {
  const config::Config config = config_from(options.config);
  const json answer = ask(config, {{"verb", "gauges"}});
  if (options.as_json) {
    fmt::print("{}\n", answer.dump(2));
    return kDone;
  }
  set_language(options.language);
  if (answer["gauges"].empty()) {
    fmt::print("{}", say("no gauges: {} has no [[gauge]]\n", config.path));
    return kDone;
  }
  report::Table table{say("gauge<"), say("value"),  say("unit<"),  say("age s"),
                      say("slab"),   say("state<"), say("master<")};
  std::string notes;
  bool good = true;
  const std::int64_t now_us = wall_clock_us();
  for (const json& gauge : answer["gauges"]) {
    const std::string name = gauge["name"].get<std::string>();
    const std::uint32_t slab_no = gauge["slab_no"].get<std::uint32_t>();
    table.add(name, report::Cell(number_of(gauge, "value"), 4), gauge["unit"].get<std::string>(),
              report::Cell(number_of(gauge, "age_s"), 1), slab_no == 0 ? "-" : std::to_string(slab_no),
              state_words(gauge["state"].get<std::string>()), check_words(gauge["master"], now_us));
    if (const std::string trouble = gauge["trouble"].get<std::string>(); !trouble.empty())
      notes += fmt::format("! {} ({}): {}\n", name, gauge["source"].get<std::string>(), quote(trouble));
    if (gauge["stuck"].get<bool>())
      notes += "! " + say("{} has given the same value for {} slabs: is the sensor stuck?\n", name,
                          gauge["same_slabs"].get<int>());
    const bool needs_master = !gauge["master"].is_null() && gauge["master"]["state"] != "ok";
    good = good && !needs_master && !gauge["stuck"].get<bool>();
  }
  fmt::print("{}{}", report::text_of(table, style_for(stdout)), notes);
  if (answer["slab_no"].is_null()) fmt::print("{}", say("no slab is open; the states are those for the last one\n"));
  return good ? kDone : kNotPass;
}

int check(const Options& options) {
  const config::Config config = config_from(options.config);
  set_language(options.language);
  const GaugeSettings& gauge = gauge_of(config, options.gauge);
  if (!gauge.master.given) stop(kUsage, say("{} has no master in the configuration", gauge.name.view()));
  // A typed value would pass with exchanged cables.
  if (has_value(options.value) && gauge.link != GaugeLink::manual)
    stop(kUsage, say("--value is for gauges with source \"operator\": slabd reads {} itself ({})", gauge.name.view(),
                     gauge.source.view()));
  finish_killed_change(config);
  storage::KeepGaugeCheck change;
  change.check.gauge = gauge.name;
  change.check.unit = gauge.unit;
  change.check.master_value = gauge.master.value;
  change.check.master_u = gauge.master.u;
  change.check.within = gauge.master.limit;
  change.check.source = gauge.channel;
  // As entered values count, so that a wrong scale does not pass.
  if (has_value(options.value)) change.check.value = gauge.scale * options.value;
  if (!has_value(options.value)) {
    const json answer = ask(config, {{"verb", "gauges"}});
    const auto found = std::find_if(answer["gauges"].begin(), answer["gauges"].end(),
                                    [&](const json& one) { return one["name"] == options.gauge; });
    if (found == answer["gauges"].end())
      stop(kBadInput,
           say("the running slabd does not have the gauge {}: restart it with this configuration", gauge.name.view()));
    if ((*found)["channel"] != gauge.channel.view())
      stop(kBadInput, say("the running slabd reads {} from {}, and the configuration has {}: restart it",
                          gauge.name.view(), quote((*found)["channel"].get<std::string>()), gauge.channel.view()));
    // An instrument cannot tell a master from a slab.
    if (gauge.link == GaugeLink::modbus && !answer["slab_no"].is_null())
      stop(kRefused, say("slab {} is open, and the master's value would count for it: check {} between two slabs",
                         answer["slab_no"].get<std::uint32_t>(), gauge.name.view()));
    const double age_s = number_of(*found, "age_s");
    const std::string trouble = (*found)["trouble"].get<std::string>();
    if (!trouble.empty()) stop(kNotReachable, fmt::format("{}: {}", options.gauge, quote(trouble)));
    if (!(age_s <= kCheckAgeS))
      stop(kNotReachable, say("{} has sent no value for {} s: measure the master now", gauge.name.view(), kCheckAgeS));
    const auto slab_no = (*found)["slab_no"].get<std::uint32_t>();
    if (gauge.link != GaugeLink::modbus && slab_no != 0)
      stop(kRefused, say("the newest value of {} is of slab {}: send the master's value with SLAB_NO 0",
                         gauge.name.view(), slab_no));
    change.check.value = number_of(*found, "value");
    if (!has_value(change.check.value)) stop(kNotReachable, say("{} has no value", gauge.name.view()));
  }
  change.note = {options.who.empty() ? default_operator() : options.who, options.why, wall_clock_us()};
  const ChangeAnswer done = need(change_calibration(config, change));
  const bool passed = passes(change.check);
  const double deviation = change.check.value - change.check.master_value;
  if (options.as_json) {
    report::Json document("slabd.gauge_check/1");
    document.field("id", done.id).field("gauge", gauge.name).field("unit", name(gauge.unit));
    document.field("value", change.check.value).field("master", change.check.master_value);
    document.field("deviation", deviation).field("limit", change.check.within).field("passed", passed);
    report::write_time(document, "checked", change.note.utime_us);
    fmt::print("{}", document.text());
  } else {
    fmt::print("{}", say("{}: {:.4f} {}, master {:.4f}, {:+.4f} off, limit {:.4f}: {}\n", done.id, change.check.value,
                         name(gauge.unit), change.check.master_value, deviation, change.check.within,
                         passed ? say("passed") : say("FAILED, its items are not measured until a check passes")));
  }
  return passed ? kDone : kNotPass;
}

report::Table checks_table(const std::vector<storage::GaugeCheckRecord>& checks) {
  report::Table table{{say("gauge<"), "gauge"},   {say("time<"), "time"},         {say("value"), "value"},
                      {say("master"), "master"},  {say("off"), "deviation"},      {say("limit"), "limit"},
                      {say("result<"), "result"}, {say("operator<"), "operator"}, {say("reason<"), "reason"}};
  table.title = say("Master checks, newest first");
  for (const storage::GaugeCheckRecord& record : checks)
    table.add(record.check.gauge.view(), report::iso_time(record.check.utime_us), report::Cell(record.check.value, 4),
              report::Cell(record.check.master_value, 4),
              report::Cell(record.check.value - record.check.master_value, 4), report::Cell(record.check.within, 4),
              record.check.passed ? say("passed") : say("failed"), record.note.who, record.note.why);
  return table;
}

report::Table values_table(const std::string& gauge, const std::vector<storage::GaugeSlabValue>& values) {
  report::Table table{{say("key"), "key"},     {say("slab<"), "slab_id"}, {say("began<"), "began"},
                      {say("value"), "value"}, {say("age s"), "age_s"},   {say("slab no"), "slab_no"},
                      {say("seq"), "seq"},     {say("state<"), "state"}};
  table.title = say("Values of {}, newest slab first", gauge);
  for (const storage::GaugeSlabValue& value : values)
    table.add(value.slab_key, value.slab_id.view(), report::iso_time(value.began_utime_us),
              report::Cell(value.reading.value, 4), report::Cell(value.reading.age_s, 1), value.reading.slab_no,
              value.reading.seq, name(value.reading.state));
  return table;
}

int history(const Options& options) {
  const auto text = options.output.json || options.output.csv ? storage::TextFor::programs : storage::TextFor::people;
  const auto reader = open_database(options.database, text);
  set_language(options.language, options.output.json);
  if (options.checks || options.gauge.empty()) {
    const auto checks = need(reader->gauge_checks(options.gauge, options.limit), kNotReachable);
    options.output.print(checks_table(checks), report::Json("slabd.gauge_history/1"), "checks");
    return kDone;
  }
  const auto values = need(reader->gauge_values(options.gauge, options.limit), kNotReachable);
  options.output.print(values_table(options.gauge, values), report::Json("slabd.gauge_history/1"), "values");
  return kDone;
}

int enter(const Options& options) {
  const config::Config config = config_from(options.config);
  set_language(options.language);
  const GaugeSettings& gauge = gauge_of(config, options.gauge);
  static_cast<void>(
      ask(config,
          {{"verb", "gauge_enter"}, {"gauge", options.gauge}, {"value", options.value}, {"slab_no", options.slab_no}}));
  fmt::print("{}", say("{}: {:.4f} {} for slab {}\n", options.gauge, gauge.scale * options.value, name(gauge.unit),
                       options.slab_no));
  return kDone;
}

void add_config_option(args::Command& command, Options& options) {
  command.add_option("--config", options.config, "The daemon's configuration")->default_val(default_config());
}

}  // namespace

void add_gauge(args::Command& app) {
  args::Command gauges = app.add_subcommand("gauge", "Gauges of length, width, thickness, bottom: values and masters");
  gauges->require_subcommand(1);
  gauges->footer(
      "\nA gauge whose master check is missing, failed or overdue measures nothing: its items are not measured (114).\n"
      "docs/GAUGES.md has the daily check.");

  auto listed = std::make_shared<Options>();
  args::Command listing = gauges.add_subcommand("list", "Every gauge: its value, whether it counts, its next check");
  add_config_option(listing, *listed);
  listing->add_flag("--json", listed->as_json, "Print slabd.gauges/1 on stdout");
  listed->language.add_to(listing, "Language of the screen");
  listing->runs([listed] { return list(*listed); });

  auto checked = std::make_shared<Options>();
  args::Command checking = gauges.add_subcommand("check", "Compare a gauge with its master and store the result");
  checking->footer(
      "\nPut the master into the gauge's place first. The gauge's newest value is taken; --value is for gauges\n"
      "with source \"operator\". Exit 1 if the check failed.\nExample: slabctl gauge check length_left");
  checking->add_option("GAUGE", checked->gauge, "Its name in the configuration")->required();
  checking
      ->add_option("--value", checked->value,
                   "The number that the instrument shows for the master, for a gauge with source \"operator\"")
      ->check(within(-1e6, 1e6));
  checking->add_option("--why", checked->why, "Reason, if it is not the regular check");
  checking->add_option("--operator", checked->who, "Name of the operator (default: your login)");
  add_config_option(checking, *checked);
  checking->add_flag("--json", checked->as_json, "Print slabd.gauge_check/1 on stdout");
  checked->language.add_to(checking, "Language of the screen");
  checking->runs([checked] { return check(*checked); });

  auto shown = std::make_shared<Options>();
  args::Command showing = gauges.add_subcommand("history", "Values of a gauge slab by slab, or its master checks");
  showing->add_option("GAUGE", shown->gauge, "Its name; without it the checks of all gauges");
  showing->add_flag("--checks", shown->checks, "Its master checks instead of its values");
  showing->add_option("-n,--limit", shown->limit, "At most this many rows")
      ->check(args::range(std::size_t{1}, std::size_t{100'000}))
      ->capture_default_str();
  shown->database.add_to(showing);
  shown->output.add_to(showing, "slabd.gauge_history/1");
  shown->language.add_to(showing, "Language of the screen");
  showing->runs([shown] { return history(*shown); });

  auto entered = std::make_shared<Options>();
  args::Command entering = gauges.add_subcommand("enter", "Enter a value that a person has measured");
  entering->footer(
      "\nFor gauges with source \"operator\". The value counts for the slab of this number, if it is entered before\n"
      "SLAB_END and within valid_s. A restart of slabd forgets it.\nExample: slabctl gauge enter thickness_front 200.2 "
      "--slab-no 10042");
  entering->add_option("GAUGE", entered->gauge, "Its name in the configuration")->required();
  entering->add_option("VALUE", entered->value, "The number that the instrument shows, before `scale`")
      ->required()
      ->check(within(-1e6, 1e6));
  entering->add_option("--slab-no", entered->slab_no, "SLAB_NO of the slab, as `slabctl status` shows it")->required();
  add_config_option(entering, *entered);
  entered->language.add_to(entering, "Language of the screen");
  entering->runs([entered] { return enter(*entered); });
}

}  // namespace slabd::cli
