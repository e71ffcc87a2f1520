// SPDX-License-Identifier: Apache-2.0
//
// slabctl status: queries the running daemon over its control socket, one JSON line in each direction.
#include <fmt/core.h>

#include <memory>
#include <nlohmann/json.hpp>

#include "base/plain_text.h"
#include "cli/client/control.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/render.h"
#include "cli/watch/screen.h"
#include "report/json.h"
#include "report/words.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

struct Options {
  std::string config;
  std::string socket;
  std::string language = "en";
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

std::string line(const char* label, const std::string& text) {
  return fmt::format("{:12} {}\n", label, text);
}

std::string slab_text(const json& status, const Style& style) {
  std::string text;
  if (status.contains("slab") && status["slab"].is_object()) {
    text +=
        line("slab", fmt::format("{} \"{}\" type {}, {} of {} stations scanned", text_at(status, {"slab", "no"}),
                                 text_at(status, {"slab", "id"}), text_at(status, {"slab", "type"}),
                                 text_at(status, {"slab", "stations_done"}), text_at(status, {"slab", "stations"})));
  } else {
    text += line("slab", "none open");
  }
  if (!status.contains("last_slab") || !status["last_slab"].is_object()) return text;
  const std::string word = text_at(status, {"last_slab", "verdict"});
  const Verdict verdict = verdict_from_name(word).value_or(Verdict::none);
  const json& reason = status["last_slab"].value("reason", json(0));
  const std::string why = reason.is_number_unsigned() ? reason_text(reason.get<std::uint16_t>()) : "";
  text +=
      line("last slab", fmt::format("{} {} {}{}", text_at(status, {"last_slab", "no"}), verdict_text(verdict, style),
                                    why, text_at(status, {"last_slab", "emulated"}) == "yes" ? " EMULATED" : ""));
  return text;
}

std::string time_at(const json& document, const char* key) {
  const json& value = document.value(key, json(0));
  const std::int64_t utime_us = value.is_number_integer() ? value.get<std::int64_t>() : 0;
  return utime_us == 0 ? "never" : iso_time(utime_us);
}

std::string watch_text(const json& calibration, const char* key, const char* label) {
  std::string text;
  const json& watch = calibration.value(key, json(nullptr));
  if (!watch.is_object()) return text;
  const std::string passed = text_at(watch, {"passed"});
  text += line(label,
               fmt::format("{}, last check {}{}, due {}{}", text_at(watch, {"id"}), time_at(watch, "checked_utime_us"),
                           passed == "yes"  ? " passed"
                           : passed == "no" ? " FAILED"
                                            : "",
                           time_at(watch, "due_utime_us"), text_at(watch, {"overdue"}) == "yes" ? " (OVERDUE)" : ""));
  return text;
}

/// Slab types that scans can distinguish only by the slab's ends, or not at all.
std::string alike_text(const json& status) {
  std::string text;
  if (!status.contains("alike_recipes") || !status["alike_recipes"].is_array()) return text;
  for (const json& pair : status["alike_recipes"]) text += line("slab types", text_at(pair, {"text"}));
  return text;
}

std::string calibration_text(const json& status) {
  std::string text;
  if (!status.contains("calibration") || !status["calibration"].is_object()) return text;
  const json& calibration = status["calibration"];
  text += line("calibration", fmt::format("{} ({}), expires {}", text_at(calibration, {"id"}),
                                          text_at(calibration, {"source"}), time_at(calibration, "expires_utime_us")));
  if (calibration.contains("stations") && calibration["stations"].is_array())
    for (const json& table : calibration["stations"])
      text += line("stations",
                   fmt::format("{} of slab type {}: {} mastered, {}", text_at(table, {"id"}),
                               text_at(table, {"slab_type"}), text_at(table, {"mastered"}), text_at(table, {"state"})));
  text += watch_text(calibration, "reference_block", "ref. block");
  text += watch_text(calibration, "monitor_ball", "monitor ball");
  if (const json& scanner = calibration.value("scanner", json(nullptr)); scanner.is_object())
    text += line("acceptance", fmt::format("{} of the scanner: {}, expires {}", text_at(scanner, {"id"}),
                                           text_at(scanner, {"state"}), time_at(scanner, "expires_utime_us")));
  return text;
}

/// `text` after `separator`; empty without a text.
std::string after(const char* separator, const std::string& text) {
  return text.empty() || text == "-" ? "" : separator + text;
}

/// Counts of rejected messages on the pose link, if there are any.
std::string pose_faults_text(const json& status) {
  std::string text;
  std::string faults;
  for (const char* key : {"other_type", "wrong_sender", "second_publisher", "not_finite", "not_unit", "out_of_reach",
                          "repeated", "time_back", "time_unit", "jumps", "gaps", "lost", "stale", "wrong_frame"}) {
    const std::string count = text_at(status, {"links", "pose", key});
    if (count != "0" && count != "-") faults += fmt::format("{}{} {}", faults.empty() ? "" : ", ", count, key);
  }
  if (!faults.empty()) text += line("", fmt::format("since the start: {}", faults));
  if (const std::string now = text_at(status, {"links", "pose", "refusal"}); now != "-" && !now.empty())
    text += line("", fmt::format("now refused: {}", now));
  return text;
}

std::string status_text(const json& status) {
  std::string text;
  const Style style = style_for(stdout);
  if (const std::uint8_t shown = watch::emulation_at(status, "emulation"); shown != 0)
    text += fmt::format("{}\n", coloured(report::emulation_banner(shown, watch::emulation_at(status, "emulation_now"),
                                                                  report::Language::en),
                                         "7", style));
  text += line("software", text_at(status, {"software"}));
  text += line("state", fmt::format("{}, up {} s, session {}", text_at(status, {"state"}),
                                    text_at(status, {"uptime_s"}), text_at(status, {"session"})));
  if (text_at(status, {"fault", "code"}) != "0" && text_at(status, {"fault", "code"}) != "-")
    text += line("FAULT", fmt::format("{}: {}; {}", text_at(status, {"fault", "code"}),
                                      text_at(status, {"fault", "text"}), text_at(status, {"fault", "cure"})));
  if (status.contains("warn") && status["warn"].is_array())
    for (const json& warning : status["warn"])
      text += line("warning", plain(warning.is_string() ? warning.get<std::string>() : warning.dump()));
  text += line("plc", fmt::format("{} clients, heartbeat {}{}", text_at(status, {"links", "plc", "clients"}),
                                  text_at(status, {"links", "plc", "alive"}) == "yes" ? "alive" : "missing",
                                  after("; ", text_at(status, {"links", "plc", "trouble"}))));
  text += line("robot", text_at(status, {"links", "pose", "ok"}) == "yes"
                            ? "poses arrive" + after("; ", text_at(status, {"links", "pose", "note"}))
                            : fmt::format("{}: {}", text_at(status, {"links", "pose", "code"}),
                                          text_at(status, {"links", "pose", "text"})));
  text += pose_faults_text(status);
  const std::string scanner_why = text_at(status, {"links", "scanner", "text"});
  text += line("scanner", fmt::format("online {}, {} stray files{}", text_at(status, {"links", "scanner", "online"}),
                                      text_at(status, {"links", "scanner", "strays"}),
                                      scanner_why == "-" ? "" : after("; ", scanner_why)));
  if (const nlohmann::json& chain = status.value("chain", nlohmann::json(nullptr)); chain.is_object())
    text += line("chain", fmt::format("entry {} of the chain of results, SHA-256 {}",
                                      text_at(status, {"chain", "entries"}), text_at(status, {"chain", "sha256"})));
  text += line("store", fmt::format("ok {}, {} results wait for the PLC", text_at(status, {"links", "store", "ok"}),
                                    text_at(status, {"results_pending"})));
  if (const std::string why = text_at(status, {"links", "store", "text"}); why != "-" && !why.empty())
    text += line("", why);
  text += calibration_text(status);
  text += alike_text(status);
  if (status.contains("maintenance") && status["maintenance"].is_object())
    text +=
        line("maintenance",
             fmt::format("\"{}\" by {}, {} views; SCAN is refused; ends by itself in {} s without another step",
                         text_at(status, {"maintenance", "session"}), text_at(status, {"maintenance", "operator"}),
                         text_at(status, {"maintenance", "views"}), text_at(status, {"maintenance", "lease_left_s"})));
  text += slab_text(status, style);
  text += line("blocks", fmt::format("{} measured, last {} ms, longest {} ms", text_at(status, {"blocks", "measured"}),
                                     text_at(status, {"blocks", "last_ms"}), text_at(status, {"blocks", "max_ms"})));
  text += line("memory",
               fmt::format("{} kB, peak {} kB, of it {} B for inspection", text_at(status, {"memory", "rss_kb"}),
                           text_at(status, {"memory", "peak_kb"}), text_at(status, {"memory", "inspection_bytes"})));
  text += line("config", text_at(status, {"config"}));
  text += line("database", text_at(status, {"db"}));
  return text;
}

int show_status(const Options& options) {
  std::string path = options.socket;
  bool usable = true;
  if (path.empty()) {
    // slabd also runs with an invalid configuration, in fault 504, and takes its socket from it.
    daemon::Config config;
    usable = config_from(options.config, config);
    path = config.control_socket;
  }
  if (options.watch) return watch::run(path, options.language == "zh" ? report::Language::zh : report::Language::en);
  const std::string answer = need(ask_daemon(path, "{\"verb\":\"status\"}\n"), usable ? kNotReachable : kBadInput);
  const json status = json::parse(answer, nullptr, false);
  if (!status.is_object() || status.value("schema", "") != "slabd.status/1")
    stop(kNotReachable, fmt::format("{} does not speak slabd.status/1: {}", path, answer.substr(0, 200)));
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
  command->add_option("--language", options->language, "Language of the screen")
      ->check(args::one_of({"en", "zh"}))
      ->capture_default_str();
  command->runs([options] { return show_status(*options); });
}

}  // namespace slabd::cli
