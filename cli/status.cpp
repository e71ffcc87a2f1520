// SPDX-License-Identifier: Apache-2.0
//
// slabctl status: queries the running daemon over its control socket, one JSON line in each direction.
#include <fmt/core.h>

#include <cstdlib>
#include <memory>
#include <nlohmann/json.hpp>

#include "base/plain_text.h"
#include "cli/client/arms.h"
#include "cli/client/control.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/render.h"
#include "cli/terminal/say.h"
#include "cli/watch/screen.h"
#include "report/json.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

struct Options {
  std::string config;
  std::string socket;
  LanguageOption language;
  bool as_json = false;
  bool watch = false;
};

/// The text of `document[path...]`, "-" if missing; a newer or older daemon may have other keys.
std::string text_at(const json& document, std::initializer_list<const char*> path) {
  const json* at = &document;
  for (const char* key : path) {
    if (!at->is_object() || !at->contains(key)) return "-";
    at = &(*at)[key];
  }
  if (at->is_string()) return plain(at->get<std::string>());
  if (at->is_boolean()) return at->get<bool>() ? "yes" : "no";
  if (at->is_number_float()) return fmt::format("{:.1f}", at->get<double>());
  return at->is_null() ? "-" : plain(at->dump());
}

/// The label in 12 columns.
std::string line(const std::string& label, const std::string& text) {
  const std::size_t width = report::display_width(label);
  return label + std::string(width < 12 ? 12 - width : 0, ' ') + " " + text + "\n";
}

/// The name of a state, or "yes" or "no", in the chosen language.
std::string word_at(const json& document, std::initializer_list<const char*> path) {
  return std::string(translated(text_at(document, path)));
}

std::string slab_text(const json& status, const report::Style& style) {
  std::string text;
  if (status.contains("slab") && status["slab"].is_object()) {
    const std::string no = text_at(status, {"slab", "no"});
    const std::string id = text_at(status, {"slab", "id"});
    const std::string type = text_at(status, {"slab", "type"});
    const std::string done = text_at(status, {"slab", "stations_done"});
    const std::string stations = text_at(status, {"slab", "stations"});
    const json& mould = status["slab"].value("mould", json(nullptr));
    text += line(say("slab"), mould.is_number()
                                  ? say("{} \"{}\" type {}, mould {}, {} of {} stations scanned", no, id, type,
                                        mould.get<int>(), done, stations)
                                  : say("{} \"{}\" type {}, {} of {} stations scanned", no, id, type, done, stations));
  } else {
    text += line(say("slab"), say("none open"));
  }
  if (!status.contains("last_slab") || !status["last_slab"].is_object()) return text;
  const std::string word = text_at(status, {"last_slab", "verdict"});
  const Verdict verdict = verdict_from_name(word).value_or(Verdict::none);
  const json& reason = status["last_slab"].value("reason", json(0));
  const std::string why = reason.is_number_unsigned() ? reason_text(reason.get<std::uint16_t>()) : "";
  text += line(say("last slab"),
               fmt::format("{} {} {}{}", text_at(status, {"last_slab", "no"}), verdict_words(verdict, style), why,
                           text_at(status, {"last_slab", "emulated"}) == "yes" ? say(" EMULATED") : ""));
  return text;
}

std::string time_at(const json& document, const char* key) {
  const json& value = document.value(key, json(0));
  const std::int64_t utime_us = value.is_number_integer() ? value.get<std::int64_t>() : 0;
  return utime_us == 0 ? say("never") : report::iso_time(utime_us);
}

std::string watch_text(const json& calibration, const char* key, const char* label) {
  std::string text;
  const json& watch = calibration.value(key, json(nullptr));
  if (!watch.is_object()) return text;
  const std::string passed = text_at(watch, {"passed"});
  text +=
      line(std::string(translated(label)),
           say("{}, {}{}, due {}{}", text_at(watch, {"id"}),
               watch.value("checked_utime_us", json(0)) == 0 ? say("last check never")
                                                             : say("last check {}", time_at(watch, "checked_utime_us")),
               passed == "yes"  ? say(" passed")
               : passed == "no" ? say(" FAILED")
                                : "",
               time_at(watch, "due_utime_us"), text_at(watch, {"overdue"}) == "yes" ? say(" (OVERDUE)") : ""));
  return text;
}

/// Slab types that scans can distinguish only by the slab's ends, or not at all.
std::string alike_text(const json& status) {
  std::string text;
  if (!status.contains("alike_recipes") || !status["alike_recipes"].is_array()) return text;
  for (const json& pair : status["alike_recipes"]) text += line(say("slab types"), quote(text_at(pair, {"text"})));
  return text;
}

std::string calibration_text(const ArmStatus<json>& arm) {
  std::string text;
  const json& calibration = arm.calibration;
  if (!calibration.is_object()) return text;
  if (!arm.scanner.empty()) text += line(with_id(say("scanner"), plain(arm.scanner)), "");
  text += line(say("calibration"), say("{} ({}), expires {}", text_at(calibration, {"id"}),
                                       word_at(calibration, {"source"}), time_at(calibration, "expires_utime_us")));
  if (calibration.contains("stations") && calibration["stations"].is_array())
    for (const json& table : calibration["stations"])
      text += line(say("stations"),
                   say("{} of slab type {}: {} mastered, {}", text_at(table, {"id"}), text_at(table, {"slab_type"}),
                       text_at(table, {"mastered"}), word_at(table, {"state"})));
  text += watch_text(calibration, "reference_block", marked("ref. block"));
  text += watch_text(calibration, "monitor_ball", marked("monitor ball"));
  if (const json& scanner = calibration.value("scanner", json(nullptr)); scanner.is_object())
    text += line(say("acceptance"), say("{} of the scanner: {}, expires {}", text_at(scanner, {"id"}),
                                        word_at(scanner, {"state"}), time_at(scanner, "expires_utime_us")));
  if (arm.temperature_c.is_number())
    text += line(say("scanner at"), say("{:.1f} deg C", arm.temperature_c.get<double>()));
  return text;
}

/// The tie of the robots' bases, on a line with two robots.
std::string tie_text(const json& status) {
  const json tie = status.value("tie", json(nullptr));
  if (!tie.is_object()) return line(say("tie"), say("none: scans of the second robot cannot be used"));
  std::string text = line(say("tie"), say("{} of robot {}, expires {}", text_at(tie, {"id"}), text_at(tie, {"robot"}),
                                          time_at(tie, "expires_utime_us")));
  if (const std::string why = text_at(tie, {"trouble"}); why != "-" && !why.empty()) text += line("", quote(why));
  return text;
}

/// `text` after `separator`; empty without a text.
std::string after(const char* separator, const std::string& text) {
  return text.empty() || text == "-" ? "" : std::string(translated(separator)) + quote(text);
}

/// Counts of rejected messages on the pose link, if there are any.
std::string pose_faults_text(const json& pose) {
  std::string text;
  std::string faults;
  for (const char* key : {"other_type", "wrong_sender", "second_publisher", "not_finite", "not_unit", "out_of_reach",
                          "repeated", "time_back", "time_unit", "jumps", "gaps", "lost", "stale", "wrong_frame"}) {
    const std::string count = text_at(pose, {key});
    if (count != "0" && count != "-") faults += (faults.empty() ? "" : say(", ")) + say("{} {}", count, key);
  }
  if (!faults.empty()) text += line("", say("since the start: {}", faults));
  if (const std::string now = text_at(pose, {"refusal"}); now != "-" && !now.empty())
    text += line("", say("now refused: {}", quote(now)));
  return text;
}

Code code_at(const json& status, std::initializer_list<const char*> path) {
  return static_cast<Code>(std::strtoul(text_at(status, path).c_str(), nullptr, 10));
}

std::string robot_text(const ArmStatus<json>& arm) {
  const json& pose = arm.pose;
  return line(with_id(say("robot"), plain(arm.robot)),
              text_at(pose, {"ok"}) == "yes" ? say("poses arrive") + after(marked("; "), text_at(pose, {"note"}))
                                             : say("{}: {}", text_at(pose, {"code"}),
                                                   code_text(code_at(pose, {"code"}), text_at(pose, {"text"})))) +
         pose_faults_text(pose);
}

std::string scanner_text(const ArmStatus<json>& arm) {
  const json& link = arm.scanner_link;
  return line(with_id(say("scanner"), plain(arm.scanner)),
              say("online {}, {} stray files{}", word_at(link, {"online"}), text_at(link, {"strays"}),
                  after(marked("; "), text_at(link, {"text"}))));
}

std::string uptime_text(const json& status) {
  if (language_in_use() == report::Language::en) return text_at(status, {"uptime_s"}) + " s";
  return watch::age_text(std::strtod(text_at(status, {"uptime_s"}).c_str(), nullptr), language_in_use());
}

std::string status_text(const json& status) {
  std::string text;
  const Code fault = code_at(status, {"fault", "code"});
  const report::Style style = style_for(stdout);
  if (const std::uint8_t shown = watch::emulation_at(status, "emulation"); shown != 0)
    text += fmt::format(
        "{}\n", report::coloured(
                    report::emulation_banner(shown, watch::emulation_at(status, "emulation_now"), language_in_use()),
                    "7", style));
  text += line(say("software"), text_at(status, {"software"}));
  text +=
      line(say("state"), say("{}, up {}, session {}", report::state_word(text_at(status, {"state"}), language_in_use()),
                             uptime_text(status), text_at(status, {"session"})));
  if (text_at(status, {"fault", "code"}) != "0" && text_at(status, {"fault", "code"}) != "-")
    text += line(say("FAULT"), say("{}: {}; {}", text_at(status, {"fault", "code"}),
                                   code_text(fault, text_at(status, {"fault", "text"})),
                                   code_cure(fault, text_at(status, {"fault", "cure"}))));
  for (const std::string& warning : watch::warnings_at(status, language_in_use()))
    text += line(say("warning"), plain(warning));
  text += line(say("plc"), say("{} clients, heartbeat {}{}", text_at(status, {"links", "plc", "clients"}),
                               text_at(status, {"links", "plc", "alive"}) == "yes" ? say("alive") : say("missing"),
                               after(marked("; "), text_at(status, {"links", "plc", "trouble"}))));
  const std::vector<ArmStatus<json>> arms = arms_in(status);
  for (const ArmStatus<json>& arm : arms) text += robot_text(arm);
  for (const ArmStatus<json>& arm : arms) text += scanner_text(arm);
  if (const nlohmann::json& chain = status.value("chain", nlohmann::json(nullptr)); chain.is_object())
    text += line(say("chain"), say("entry {} of the chain of results, SHA-256 {}",
                                   text_at(status, {"chain", "entries"}), text_at(status, {"chain", "sha256"})));
  text += line(say("store"), say("ok {}, {} results wait for the PLC", word_at(status, {"links", "store", "ok"}),
                                 text_at(status, {"results_pending"})));
  if (const std::string why = text_at(status, {"links", "store", "text"}); why != "-" && !why.empty())
    text += line("", quote(why));
  if (const nlohmann::json& plant = status.value("plant", nlohmann::json(nullptr)); plant.is_object())
    text +=
        line(say("plant"), say("{} results wait for the plant's database, the oldest for {:.0f} s{}",
                               text_at(status, {"plant", "unsent"}), plant.value("unsent_s", 0.0),
                               plant.value("late", false) ? say("; journalctl -u slabd-plant names the reason") : ""));
  for (const ArmStatus<json>& arm : arms) text += calibration_text(arm);
  if (arms.size() > 1) text += tie_text(status);
  text += alike_text(status);
  if (status.contains("maintenance") && status["maintenance"].is_object())
    text += line(say("maintenance"),
                 say("\"{}\" by {}, {} views; SCAN is refused; ends by itself in {} s without another step",
                     text_at(status, {"maintenance", "session"}), text_at(status, {"maintenance", "operator"}),
                     text_at(status, {"maintenance", "views"}), text_at(status, {"maintenance", "lease_left_s"})));
  text += slab_text(status, style);
  text += line(say("blocks"), say("{} measured, last {} ms, longest {} ms", text_at(status, {"blocks", "measured"}),
                                  text_at(status, {"blocks", "last_ms"}), text_at(status, {"blocks", "max_ms"})));
  text +=
      line(say("memory"), say("{} kB, peak {} kB, of it {} B for inspection", text_at(status, {"memory", "rss_kb"}),
                              text_at(status, {"memory", "peak_kb"}), text_at(status, {"memory", "inspection_bytes"})));
  text += line(say("config"), text_at(status, {"config"}));
  text += line(say("database"), text_at(status, {"db"}));
  return text;
}

int show_status(const Options& options) {
  set_language(options.language, options.as_json);
  std::string path = options.socket;
  bool usable = true;
  if (path.empty()) {
    // slabd also runs with an invalid configuration, in fault 504, and takes its socket from it.
    config::Config config;
    usable = config_from(options.config, config);
    path = config.control_socket;
  }
  if (options.watch) return watch::run(path, options.language.chosen());
  const std::string answer = need(ask_daemon(path, "{\"verb\":\"status\"}\n"), usable ? kNotReachable : kBadInput);
  const json status = json::parse(answer, nullptr, false);
  if (!status.is_object() || status.value("schema", "") != "slabd.status/1")
    stop(kNotReachable, say("{} does not answer with slabd.status/1: {}", path, answer.substr(0, 200)));
  // ASCII only: control characters are escaped.
  fmt::print("{}", options.as_json ? status.dump(2, ' ', true) + "\n" : status_text(status));
  return usable ? kDone : kBadInput;
}

}  // namespace

void add_status(args::Command& app) {
  auto options = std::make_shared<Options>();
  args::Command command = app.add_subcommand("status", "State, links and last verdict of the running daemon");
  command->footer(
      "\nExit status 4 when the daemon does not answer, 3 when the configuration is not usable (slabd runs with it, "
      "in\n"
      "fault 504, and is read all the same). With --watch the screen stays until q; it goes grey when the\n"
      "daemon's last answer is older than three seconds.\n"
      "Examples: slabctl status --json\n          slabctl status --watch --language zh");
  args::Option config = command->add_option("--config", options->config, "Configuration that names the control socket")
                            ->default_val(default_config());
  command->add_option("--socket", options->socket, "Control socket, instead of the configuration's")->excludes(config);
  args::Option as_json = command->add_flag("--json", options->as_json, "Print slabd.status/1 on stdout");
  command->add_flag("--watch", options->watch, "The operator's screen: slab map, links, last slabs, every second")
      ->excludes(as_json);
  options->language.add_to(*command, "Language of the text and of the screen");
  command->runs([options] { return show_status(*options); });
}

}  // namespace slabd::cli
