// SPDX-License-Identifier: Apache-2.0
//
// slabctl metrics: exports the daemon's metrics for Prometheus. A daemon that does not answer is also exported as a
// value.
#include <fmt/core.h>
#include <memory>
#include <nlohmann/json.hpp>

#include "base/durable.h"
#include "cli/client/control.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"

namespace slabd::cli {
namespace {

struct Options {
  std::string config;
  std::string socket;
  std::string out;
  bool reset = false;
};

constexpr const char* kUp = "# HELP slabd_up 1: the daemon answers\n# TYPE slabd_up gauge\nslabd_up {}\n";

int tell(const Options& options, const std::string& text, int status) {
  if (options.out.empty()) {
    fmt::print("{}", text);
    return status;
  }
  // The file is replaced as a whole, because the collector may read it at any time.
  OutFile out(options.out, {.synced = true, .mode = 0664});
  out.write(text);
  need(out.close(), kNotReachable);
  return status;
}

/// Reason for an answer without metrics.
std::string refusal_in(const nlohmann::json& answer) {
  if (answer.is_object() && answer.value("schema", "") == "slabd.error/1") return answer.value("error", "");
  return "is it older than slabctl?";
}

int show_metrics(const Options& options) {
  std::string path = options.socket;
  bool usable = true;
  if (path.empty()) {
    // With an invalid configuration old metrics must not remain: slabd, in fault 504, takes its socket from it.
    config::Config config;
    usable = config_from(options.config, config);
    path = config.control_socket;
  }
  const Result<std::string> answer =
      ask_daemon(path, options.reset ? "{\"verb\":\"metrics\",\"reset\":true}\n" : "{\"verb\":\"metrics\"}\n");
  const nlohmann::json metrics =
      answer.ok() ? nlohmann::json::parse(answer.value(), nullptr, false) : nlohmann::json(nullptr);
  if (metrics.is_object() && metrics.value("schema", "") == "slabd.metrics/1")
    return tell(options, fmt::format(kUp, 1) + metrics.value("text", ""), usable ? kDone : kBadInput);
  complain(answer.ok() ? "slabd gave no figures: " + refusal_in(metrics) : std::string(answer.error().text.view()));
  return tell(options, fmt::format(kUp, 0), usable ? kNotReachable : kBadInput);
}

}  // namespace

void add_metrics(args::Command& app) {
  auto options = std::make_shared<Options>();
  args::Command command = app.add_subcommand("metrics", "Figures of the daemon, as Prometheus text");
  command->footer(
      "\nslabd_up is 0 when the daemon does not answer (exit status 4). slabd-metrics.timer writes the file every 15 "
      "s,\nalso when the configuration is not usable (exit status 3).\n"
      "Example: slabctl metrics --out /run/slabd-metrics/slabd.prom");
  args::Option config = command->add_option("--config", options->config, "Configuration that names the control socket")
                            ->default_val(default_config());
  command->add_option("--socket", options->socket, "Control socket, instead of the configuration's")->excludes(config);
  command->add_option("--out", options->out, "Replace this file instead of printing");
  command->add_flag("--reset", options->reset, "Reset all maxima after these figures");
  command->runs([options] { return show_metrics(*options); });
}

}  // namespace slabd::cli
