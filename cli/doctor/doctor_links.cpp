// SPDX-License-Identifier: Apache-2.0
//
// The daemon, scanners and calibrations by its status. If it does not run, the calibrations are read from the database.
#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <bit>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "cli/client/arms.h"
#include "cli/client/control.h"
#include "cli/client/live_capture.h"
#include "cli/client/record_options.h"
#include "cli/doctor/doctor.h"
#include "cli/terminal/say.h"
#include "cli/watch/screen.h"
#include "hal/hal.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

constexpr std::int64_t kExpiresSoon_us = 30LL * 86'400 * 1'000'000;

const json& at(const json& document, std::initializer_list<const char*> path) {
  static const json kNothing;
  const json* here = &document;
  for (const char* key : path) {
    if (!here->is_object() || !here->contains(key)) return kNothing;
    here = &(*here)[key];
  }
  return *here;
}
std::string text(const json& value) {
  if (value.is_string()) return value.get<std::string>();
  return value.is_null() ? "-" : value.dump();
}
/// The daemon's status; null if it does not run.
json status_of(const std::string& answer) {
  return answer.empty() ? json(nullptr) : json::parse(answer, nullptr, false);
}
bool yes(const json& value) {
  return value.is_boolean() && value.get<bool>();
}

/// True if the configuration is invalid: slabd has then no state of database and scanner, because it uses neither.
bool in_config_fault(const json& status) {
  const json& fault = at(status, {"fault", "code"});
  return fault.is_number() && fault.get<int>() == static_cast<int>(Code::config);
}
/// True if slabd still opens and checks its database: it has no state of it yet.
bool is_opening(const json& status) {
  return text(at(status, {"state"})) == "recover";
}

/// Cure of a daemon warning, by its bit of WARN (docs/PLC.md).
constexpr std::array kWarningCures = {
    marked("compare the recipe with the drawing, then confirmed = true; slabctl recipe show FILE lists what is not"),
    marked("slabctl calibrate new; docs/CALIBRATION.md"),
    marked("look into stray/ of the drop folder: does the scanner's software answer under other names, or twice? "
           "docs/DELIVERY.md"),
    marked("the PLC must copy RES_SEQ (IR 30) to RES_ACK (HR 2) once it has stored the record"),
    marked("set the clock (NTP); if it is right now, docs/OPERATING.md, \"The clock was wrong\""),
    marked("slabctl config check names file, line and key"),
    marked("free space on the disk of the scans or of the database (journalctl -u slabd shows which)"),
    marked("journalctl -u slabd shows why; does another slabd run?"),
    marked("slabctl calibrate check; docs/CALIBRATION.md, \"The daily check\""),
    marked("slabctl calibrate stations; docs/MASTERING.md"),
    marked("slabctl scanner verify; docs/SCANNER.md, \"Is it good enough?\""),
    marked("slabctl calibrate new, and apply it; docs/CALIBRATION.md"),
    marked("slabctl recipe reload --look lists the differences; slabctl recipe reload between two slabs"),
    marked(
        "expected on a test line; on a real one [line] simulation = false, real poses (flags, bits 0 and 4) and a real "
        "scanner; "
        "docs/PLC.md, STATUS bit 11"),
    marked("slabctl stations --krl FILE plans stops that differ; docs/ROBOT.md, \"The stations\""),
    marked("slabctl gauge list names gauge and reason; docs/GAUGES.md"),
};
static_assert(kWarningCures.size() == 16, "one for each bit of WARN");

/// The status contains the warnings as text, in the order of their bits.
void examine_warnings(const json& status, Examination& report) {
  const json& bits = at(status, {"warn_bits"});
  unsigned rest = bits.is_number_unsigned() ? bits.get<unsigned>() : 0U;
  for (const std::string& warning : watch::warnings_at(status, language_in_use())) {
    const auto bit = static_cast<std::size_t>(std::countr_zero(rest));
    rest &= rest - 1U;
    report.warning("daemon", warning,
                   bit < kWarningCures.size() ? std::string(translated(kWarningCures[bit])) : "docs/PLC.md, WARN");
  }
}

}  // namespace

std::string examine_daemon(const config::Config& config, Examination& report) {
  const Result<std::string> answer = ask_daemon(config.control_socket, "{\"verb\":\"status\"}\n");
  if (!answer) {
    report.failed("daemon", std::string(answer.error().text.view()), "systemctl start slabd; journalctl -u slabd");
    return {};
  }
  const json status = json::parse(answer.value(), nullptr, false);
  if (!status.is_object() || text(at(status, {"schema"})) != "slabd.status/1") {
    report.failed("daemon", say("it answers in a form this slabctl does not know"),
                  say("install slabd and slabctl of one version"));
    return {};
  }
  const std::string saw = say("{}, state {}", text(at(status, {"software"})),
                              report::state_word(text(at(status, {"state"})), language_in_use()));
  const json& fault = at(status, {"fault", "code"});
  if (fault.is_number() && fault.get<int>() != 0)
    report.failed("daemon",
                  say("{}, fault {}: {}", saw, fault.get<int>(),
                      code_text(static_cast<Code>(fault.get<int>()), text(at(status, {"fault", "text"})))),
                  code_cure(static_cast<Code>(fault.get<int>()), text(at(status, {"fault", "cure"}))));
  else if (is_opening(status))
    report.warning("daemon", say("{}: it still opens its database", saw),
                   say("run slabctl doctor again when slabctl status shows idle"));
  else
    report.ok("daemon", saw);
  std::error_code not_there;
  if (!std::filesystem::equivalent(text(at(status, {"config"})), config.path, not_there))
    report.warning("daemon", say("it runs with {}", text(at(status, {"config"}))),
                   say("look at that one with --config, or restart the daemon"));
  examine_warnings(status, report);
  if (!yes(at(status, {"links", "store", "ok"})) && !in_config_fault(status) && !is_opening(status))
    report.failed("database",
                  say("the daemon cannot write it: {}", quote(text(at(status, {"links", "store", "text"})))),
                  say("journalctl -u slabd names the reason"));
  if (const json& plant = at(status, {"plant"}); plant.is_object()) {
    const std::string waits = say("{} results wait for the plant's database, the oldest for {:.0f} s{}",
                                  plant.value("unsent", std::int64_t{0}), plant.value("unsent_s", 0.0), "");
    if (yes(at(plant, {"late"})))
      report.warning("plant", waits, say("journalctl -u slabd-plant names the reason; docs/PLANT.md"));
    else
      report.ok("plant", waits);
  }
  return answer.value();
}

void name_part(const config::Config& config, const std::string& part, const PartId& id, Examination& report) {
  report.set_subject(config.arms.several() ? with_id(part, std::string(id.view())) : std::string());
}

/// State of an arm in the daemon's status. nullopt, with a finding: the daemon has fewer arms.
static std::optional<ArmStatus<json>> arm_in(const json& status, std::size_t arm, std::string_view check,
                                             Examination& report) {
  std::vector<ArmStatus<json>> arms = arms_in(status);
  if (arm < arms.size()) return std::move(arms[arm]);
  report.failed(check, say("the daemon has no such scanner: it runs with another configuration"),
                say("systemctl restart slabd between two slabs"));
  return std::nullopt;
}

/// Checks the scanner of one arm.
static void examine_scanner(const config::Config& config, std::size_t arm, const json& status, bool scan,
                            Examination& report) {
  const config::ArmSettings& settings = config.arm(arm);
  const std::string drop(settings.scanner.drop_dir.view());
  const bool stream = settings.scanner_backend == hal::ScannerBackend::tcp;
  const std::string endpoint = fmt::format("{}:{}", settings.stream.host.view(), settings.stream.port);
  if (in_config_fault(status)) {
    report.unknown("scanner link", say("in fault 504 the daemon does not look for a scanner"));
  } else if (!status.is_null()) {
    const std::optional<ArmStatus<json>> state = arm_in(status, arm, "scanner link", report);
    if (!state) return;
    const json& link = state->scanner_link;
    const std::string why = text(at(link, {"text"}));
    if (yes(at(link, {"online"})))
      report.ok("scanner link", stream ? say("the scanner's gateway is connected to {}", endpoint)
                                       : say("{}/request and /inbox are there for the daemon", drop));
    else if (stream && why.find("cannot listen") != std::string::npos)
      report.failed("scanner link", quote(why),
                    say("ip address lists this computer's addresses; correct [scanner] listen"));
    else if (stream)
      report.failed("scanner link", say("no gateway is connected to {}", endpoint),
                    say("start the gateway; its address must be in [scanner] allow (docs/DELIVERY.md)"));
    else
      report.failed("scanner link", say("the daemon cannot use {}", drop),
                    say("mount the share, and make it writable for slabd"));
    const json& strays = at(link, {"strays"});
    if (strays.is_number() && strays.get<int>() != 0)
      report.warning("scanner link",
                     stream ? say("{} scans or connections were refused", strays.get<int>())
                            : say("{} files answered no request and lie in stray/", strays.get<int>()),
                     stream ? say("slabctl status shows what was wrong last; docs/DELIVERY.md")
                            : say("the scanner's software must name its file after the request"));
  }
  if (!scan) return report.note("scan", say("not tried"), say("slabctl doctor --scan has one taken"));
  if (status.is_null()) return report.unknown("scan", say("the daemon does not run"));
  Result<LiveCapture> capture = LiveCapture::begin(
      config.control_socket,
      {"doctor", "doctor", 60, false, config.arms.several() ? std::string(settings.by.scanner.view()) : ""});
  if (!capture) return report.failed("scan", quote(capture.error().text.view()), say("then try again"));
  const Result<LiveShot> shot = capture.value().shoot([](std::string_view) {});
  if (shot) {
    report.ok("scan", say("{} points {:.1f} s after the request; flange within {:.3f} mm", shot.value().points,
                          static_cast<double>(shot.value().scan_utime_us - shot.value().requested_utime_us) / 1e6,
                          shot.value().spread_mm));
    (void)capture.value().release(shot.value().scan_path);
  } else {
    report.failed("scan", quote(shot.error().text.view()),
                  std::string(report::cure_words(shot.error().code, language_in_use())));
  }
  (void)capture.value().end();
}

void examine_scanners(const config::Config& config, const std::string& status_text, bool scan, Examination& report) {
  const json status = status_of(status_text);
  for (std::size_t arm = 0; arm < config.arms.list.size(); ++arm) {
    name_part(config, say("scanner"), config.arm(arm).by.scanner, report);
    examine_scanner(config, arm, status, scan, report);
  }
  report.set_subject({});
}

static void examine_acceptance(std::string_view id, std::string_view standing, Examination& report) {
  const std::string cure = "slabctl scanner verify; docs/SCANNER.md";
  if (standing == "verified")
    report.ok("acceptance", say("{} of the scanner", id));
  else if (id.empty())
    report.warning("acceptance", say("the scanner was not verified: U rests on the recipe's specification"), cure);
  else
    report.warning("acceptance",
                   standing == "expired" ? say("{} of the scanner has expired", id)
                   : standing == "other_temperature"
                       ? say("the scanner's temperature is too far from that of {}", id)
                       : say("after {} the scanner was verified and out of its limits", id),
                   cure);
}

/// Examines a line with a measured hand-eye and without corrections that are used.
static void examine_uncorrected(const config::ArmSettings& arm, Examination& report) {
  if (has_value(arm.splice.absolute_mm) && has_value(arm.splice.absolute_rad)) return;
  report.failed(
      "stations", say("no station is corrected, and the robot's accuracy is not stated: no seat can pass"),
      say("set [robot] absolute_sigma_mm and absolute_sigma_deg, or master the stations (docs/MASTERING.md)"));
}

/// Names what the values of the configuration lack.
static void examine_commissioning(const config::ArmSettings& arm, Examination& report) {
  report.warning("calibration",
                 has_value(arm.splice.commissioning_mm)
                     ? say("commissioning values: the position of the scanner was not measured")
                     : say("commissioning values without [calibration] station_sigma_mm and station_sigma_deg: no seat "
                           "can pass"),
                 "slabctl calibrate new; docs/CALIBRATION.md");
}

/// Calibrations of one arm as stored, without the daemon.
static void examine_stored(const config::ArmSettings& settings, const LineCalibration& calibration,
                           Examination& report) {
  const std::int64_t now = hal::make_system_clock()->utime_us();
  if (fault_of(calibration, now) == CalibrationFault::expired)
    report.failed("calibration", say("{} has expired", calibration.id.view()),
                  "slabctl calibrate new; docs/CALIBRATION.md");
  else if (calibration.source == LineCalibration::Source::applied)
    report.ok("calibration", say("{} was applied last", calibration.id.view()));
  else if (!calibration.trouble.empty())
    report.failed("calibration", quote(calibration.trouble.view()), "slabctl calibrate new; docs/CALIBRATION.md");
  else if (calibration.source == LineCalibration::Source::commissioning && !has_value(settings.splice.commissioning_mm))
    examine_commissioning(settings, report);
  else
    report.warning("calibration", say("none has been applied"), "docs/CALIBRATION.md");
  examine_acceptance(calibration.scanner.id.view(), name(acceptance_state(calibration.scanner, now)), report);
  const bool corrected =
      std::any_of(calibration.tables.begin(), calibration.tables.end(),
                  [&](const StationsInForce& table) { return why_unused(table, calibration.id, now).empty(); });
  if (calibration.source == LineCalibration::Source::applied && !corrected) examine_uncorrected(settings, report);
  for (const LineCalibration::Watch* watch : {&calibration.block, &calibration.ball})
    if (const std::string note = quote(watch->note.view()); watch->failed)
      report.failed("daily check", watch->reference_id.empty() ? note : say("{}: {}", watch->reference_id.view(), note),
                    say("find the cause, then slabctl calibrate check"));
}

/// Calibrations of one arm as the daemon states them.
/// `several`: the line has several robots.
static void examine_in_force(const config::ArmSettings& settings, const json& calibration, bool several,
                             Examination& report) {
  const std::string source = text(at(calibration, {"source"}));
  const std::string id = text(at(calibration, {"id"}));
  const std::int64_t now = hal::make_system_clock()->utime_us();
  const json& expires = at(calibration, {"expires_utime_us"});
  const std::int64_t expires_us = expires.is_number() ? expires.get<std::int64_t>() : 0;
  if (source == "missing")
    report.failed("calibration", say("there is none"), "slabctl calibrate new; docs/CALIBRATION.md");
  else if (expires_us != 0 && expires_us < now)
    report.failed("calibration", say("{} has expired", id), "slabctl calibrate new; docs/CALIBRATION.md");
  else if (source == "commissioning")
    examine_commissioning(settings, report);
  else if (expires_us != 0 && expires_us - now < kExpiresSoon_us)
    report.warning("calibration", say("{} expires in {} days", id, (expires_us - now) / 86'400'000'000),
                   say("plan a new one"));
  else
    report.ok("calibration", id);
  const json& stations = at(calibration, {"stations"});
  const bool corrected = stations.is_array() && std::any_of(stations.begin(), stations.end(), [](const json& table) {
                           return text(at(table, {"state"})) == "used";
                         });
  if (source == "applied" && !corrected) examine_uncorrected(settings, report);
  const json& scanner = at(calibration, {"scanner"});
  examine_acceptance(scanner.is_object() ? text(at(scanner, {"id"})) : "", text(at(scanner, {"state"})), report);
  for (const json& table : at(calibration, {"stations"}))
    if (text(at(table, {"state"})) != "used")
      report.warning(
          "corrections", say("{} is {}", text(at(table, {"id"})), translated(text(at(table, {"state"})))),
          several
              ? say("slabctl calibrate stations with the mastered slabs (--slabs) again, for each scanner")
              : say("slabctl calibrate stations --again --apply; if the scanner was moved, master the stations again"));
  for (const char* watch : {"reference_block", "monitor_ball"}) {
    const json& check = at(calibration, {watch});
    if (!check.is_object()) continue;
    const json& passed = at(check, {"passed"});
    if (passed.is_boolean() && !passed.get<bool>())
      report.failed("daily check", say("{}: {}", text(at(check, {"id"})), quote(text(at(check, {"note"})))),
                    say("find the cause, then slabctl calibrate check"));
    else if (yes(at(check, {"overdue"})))
      report.warning("daily check", say("{} is overdue", text(at(check, {"id"}))), "slabctl calibrate check");
    else
      report.ok("daily check", text(at(check, {"id"})));
  }
}

/// The tie of two robots as stored.
static void examine_stored_tie(const config::Config& config, const CellCalibration& calibration, Examination& report) {
  const std::int64_t now = hal::make_system_clock()->utime_us();
  const TieFault fault = fault_of_tie(calibration, config.arm(1).by.robot, now);
  if (fault == TieFault::none)
    report.ok("tie", std::string(calibration.tie.id.view()));
  else
    report.failed("tie", quote(describe(fault, calibration).view()), "slabctl calibrate tie; docs/TWO_ROBOTS.md");
}

/// The tie of two robots as the daemon states it.
static void examine_tie(const json& status, Examination& report) {
  const json& tie = at(status, {"tie"});
  const std::string cure = "slabctl calibrate tie; docs/TWO_ROBOTS.md";
  if (!tie.is_object())
    return report.failed("tie", say("there is none: scans of the second robot cannot be used"), cure);
  const std::string id = text(at(tie, {"id"}));
  const json& expires = at(tie, {"expires_utime_us"});
  const std::int64_t left_us =
      expires.is_number() ? expires.get<std::int64_t>() - hal::make_system_clock()->utime_us() : 0;
  const bool expires_soon = expires.is_number() && expires.get<std::int64_t>() != 0 && left_us < kExpiresSoon_us;
  if (const std::string trouble = text(at(tie, {"trouble"})); !trouble.empty() && trouble != "-")
    report.failed("tie", say("{}: {}", id, quote(trouble)), cure);
  else if (expires_soon)
    report.warning("tie", say("{} expires in {} days", id, left_us / 86'400'000'000), say("plan a new one"));
  else
    report.ok("tie", id);
}

void examine_calibrations(const config::Config& config, const std::string& status_text, Examination& report) {
  const json status = status_of(status_text);
  const bool by_daemon = !(status.is_null() || in_config_fault(status) || is_opening(status));
  std::unique_ptr<CellCalibration> stored;
  if (!by_daemon) {
    const auto reader = storage::open_reader(config.storage.db_path);
    if (!reader) return report.unknown("calibration", quote(reader.error().text.view()));
    auto read = reader.value()->cell_calibration(config.arms);
    if (!read) return report.unknown("calibration", quote(read.error().text.view()));
    stored = std::move(read.value());
  }
  for (std::size_t arm = 0; arm < config.arms.list.size(); ++arm) {
    name_part(config, say("scanner"), config.arm(arm).by.scanner, report);
    if (stored != nullptr)
      examine_stored(config.arm(arm), stored->arm[arm], report);
    else if (const std::optional<ArmStatus<json>> state = arm_in(status, arm, "calibration", report))
      examine_in_force(config.arm(arm), state->calibration, config.arms.several(), report);
  }
  report.set_subject({});
  if (!config.arms.several()) return;
  if (const std::string why = one_acceptance_for_two(config); !why.empty())
    report.failed("acceptance", why, say("docs/SCANNER.md, \"Is it good enough?\""));
  if (stored != nullptr)
    examine_stored_tie(config, *stored, report);
  else
    examine_tie(status, report);
}

}  // namespace slabd::cli
