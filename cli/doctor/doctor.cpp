// SPDX-License-Identifier: Apache-2.0
#include "cli/doctor/doctor.h"

#include <fmt/core.h>

#include <algorithm>
#include <memory>

#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/json_language.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/render.h"
#include "cli/terminal/say.h"
#include "report/json.h"

namespace slabd::cli {
namespace {

struct Options {
  std::string config;
  double listen_s = 2.0;
  bool scan = false;
  bool no_write = false;
  bool as_json = false;
  LanguageOption language;
};

constexpr std::size_t kLabelWidth = 14;

std::string_view colour_of(Health health) {
  switch (health) {
    case Health::ok: return "32";
    case Health::note:
    case Health::unknown: return "2";
    case Health::warning: return "33";
    case Health::failed: return "1;31";
  }
  return "0";
}

/// `text` with blanks up to `columns`.
std::string padded(std::string_view text, std::size_t columns) {
  const std::size_t width = report::display_width(text);
  return std::string(text) + std::string(width < columns ? columns - width : 0, ' ');
}

void print_finding(const Finding& finding) {
  const std::string word = padded(translated(name(finding.health)), 8);
  fmt::print("{} {} {}\n", report::coloured(word, colour_of(finding.health), style_for(stdout)),
             padded(translated(finding.check), kLabelWidth), finding.saw);
  if (!finding.cure.empty()) fmt::print("{:{}} -> {}\n", "", 9 + kLabelWidth, finding.cure);
  std::fflush(stdout);
}

std::string json_of(const Examination& report) {
  report::Json json("slabd.doctor/1");
  return json.field("findings", report.findings()).text();
}

void summarise(const Examination& report) {
  const auto count = [&](Health health) {
    return std::count_if(report.findings().begin(), report.findings().end(),
                         [&](const Finding& f) { return f.health == health; });
  };
  const auto failed = count(Health::failed);
  const auto warnings = count(Health::warning);
  const auto unknown = count(Health::unknown);
  fmt::print("\n");
  if (failed != 0)
    fmt::print("{}{}\n", say("{} of {} checks failed", failed, report.findings().size()),
               failed > 1 ? say("; mend the first one first") : "");
  else if (warnings != 0)
    fmt::print("{}\n", say("nothing failed, {} warnings", warnings));
  else
    fmt::print("{}\n", say("all is well"));
  if (unknown != 0) fmt::print("{}\n", say("{} could not be looked at", unknown));
}

int examine(const Options& options) {
  set_language(options.language, options.as_json && json_language(options.language) == report::Language::en);
  Examination report(options.as_json);
  config::Config config;
  std::vector<Recipe> recipes;
  const bool usable = examine_files(options.config, config, recipes, report);
  if (usable) {
    examine_machine(config, report);
    examine_clock(report);
    examine_disk(config, !options.no_write, report);
    const std::string status = examine_daemon(config, report);
    if (!status.empty()) examine_limits(config, report);
    examine_routes(config, report);
    examine_plc(config, !status.empty(), report);
    examine_robots(config, options.listen_s, report);
    examine_camera(config, report);
    examine_scanners(config, status, options.scan, report);
    examine_calibrations(config, status, report);
    examine_gauges(config, !status.empty(), report);
  } else {
    // slabd also runs with such a configuration, in fault 504 or with its previous one, and takes its socket from it.
    // The other checks are not possible.
    (void)examine_daemon(config, report);
  }
  if (options.as_json)
    fmt::print("{}", json_of(report));
  else
    summarise(report);
  if (!usable) return kBadInput;
  return report.any(Health::failed) ? kNotReachable : kDone;
}

}  // namespace

std::string_view name(Health health) {
  switch (health) {
    case Health::ok: return "ok";
    case Health::note: return "note";
    case Health::warning: return "warning";
    case Health::failed: return "failed";
    case Health::unknown: return "unknown";
  }
  return "unknown";
}

bool Examination::any(Health health) const {
  return std::any_of(findings_.begin(), findings_.end(), [&](const Finding& f) { return f.health == health; });
}

void Examination::add(Finding finding) {
  if (!subject_.empty()) finding.saw = say("{}: {}", subject_, finding.saw);
  if (!quiet_) print_finding(finding);
  findings_.push_back(std::move(finding));
}

void add_doctor(args::Command& app) {
  auto options = std::make_shared<Options>();
  args::Command command = app.add_subcommand("doctor", "Look at everything the line needs, and say what to do");
  command->footer(
      "\nIn order: configuration, recipes, computer, clock, disks, daemon and its limits, routes, PLC, robot, "
      "scanner,\n"
      "calibration. Nothing is changed; 64 MB are written beside the scans and deleted. --scan has the scanner take "
      "one\n"
      "scan: the daemon goes to maintenance for it, so no slab may be open and the robot must stand.\n\n"
      "Exit status: 0 nothing failed, 3 the configuration cannot be used (then only the daemon is checked), 4 "
      "something "
      "failed.\n"
      "Example: slabctl doctor --scan");
  command->add_option("--config", options->config, "The daemon's configuration")->default_val(default_config());
  command->add_option("--listen-s", options->listen_s, "How long to listen to the robot")
      ->default_val(2.0)
      ->check(within(0.5, 60.0));
  command->add_flag("--scan", options->scan, "Have one scan taken");
  command->add_flag("--no-write", options->no_write, "Write nothing; the disks' speed is not measured");
  options->language.add_to(*command, "Language of the text and of the sentences of --json");
  command->add_flag("--json", options->as_json, "Print slabd.doctor/1 on stdout");
  command->runs([options] { return examine(*options); });
}

}  // namespace slabd::cli
