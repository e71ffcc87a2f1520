// SPDX-License-Identifier: Apache-2.0
//
// slabctl doctor, gauges: whether every gauge sends values and was checked with its master, as the daemon sees it.
#include <fmt/core.h>

#include <nlohmann/json.hpp>

#include "cli/client/control.h"
#include "cli/doctor/doctor.h"
#include "cli/terminal/say.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

void examine_gauge(const json& gauge, Examination& report) {
  const std::string name = gauge.value("name", std::string());
  const std::string trouble = gauge.value("trouble", std::string());
  const std::string source = gauge.value("source", std::string());
  if (!trouble.empty())
    return report.failed("gauge", fmt::format("{} ({}): {}", name, source, quote(trouble)),
                         say("look at the instrument, its address and its network; docs/GAUGES.md"));
  if (gauge["stuck"].get<bool>())
    return report.warning("gauge",
                          say("{} has given the same value for {} slabs", name, gauge["same_slabs"].get<int>()),
                          say("look at the sensor and its cable"));
  const json& master = gauge["master"];
  if (!master.is_null() && master["state"] != "ok")
    return report.failed("gauge",
                         say("{}: {}", name,
                             quote(reason_of(master["state"] == "unchecked"      ? GaugeState::unchecked
                                             : master["state"] == "check_failed" ? GaugeState::check_failed
                                                                                 : GaugeState::check_overdue))),
                         say("put the master into its place and run slabctl gauge check {}", name));
  if (gauge["value"].is_null()) return report.note("gauge", say("{} ({}) has sent no value yet", name, source));
  report.ok("gauge", say("{}: {:.3f}, {:.0f} s ago", name, gauge["value"].get<double>(), gauge["age_s"].get<double>()));
}

}  // namespace

void examine_gauges(const config::Config& config, bool daemon_runs, Examination& report) {
  if (config.gauges.empty() || !daemon_runs) return;
  const Result<std::string> answer = ask_daemon(config.control_socket, "{\"verb\":\"gauges\"}\n");
  const json status = answer ? json::parse(answer.value(), nullptr, false) : json();
  if (!status.is_object() || !status.contains("gauges"))
    return report.unknown("gauge", say("the daemon does not describe its gauges"));
  for (const json& gauge : status["gauges"]) examine_gauge(gauge, report);
}

}  // namespace slabd::cli
