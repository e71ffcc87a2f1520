// SPDX-License-Identifier: Apache-2.0
#include "cli/client/record_options.h"

#include <fmt/core.h>
#include <algorithm>

#include "cli/client/calibration_change.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/say.h"
#include "daemon/measure.h"
#include "report/json.h"

namespace slabd::cli {

void RecordOptions::add_to(args::Command& command) {
  command.add_option("--config", config, "The daemon's configuration")->default_val(default_config());
  scanner.add_to(command);
  add_origin_to(command);
  args::Option apply_flag = command.add_flag("--apply", apply, "Put it in force at once");
  command.add_option("--reason", why, "Why it is put in force, for the history")
      ->check(some_words())
      ->needs(apply_flag);
  command.add_flag("--dry-run", dry_run, "Only compute and show: nothing is kept")->excludes(apply_flag);
}

void RecordOptions::add_origin_to(args::Command& command) {
  command.add_option("--operator", operator_name, "Name of the operator (default: your login)");
  command.add_option("--robot-serial", robot_serial, "Serial number of the robot");
  command.add_option("--scanner-serial", scanner_serial, "Serial number of the scanner");
  command.add_option("--temperature", temperature_c, "Temperature of the hall, deg C")->check(within(-20.0, 60.0));
  command
      .add_option("--valid-days", valid_days,
                  "How long it may be used from when it was measured, 0 = without limit (default: [calibration] "
                  "valid_days)")
      ->check(args::range(0, 36'500));
}

void RecordOptions::describe(const config::Config& config_in, storage::CalibrationRecord& record,
                             std::int64_t measured_utime_us) const {
  record.operator_name = operator_name.empty() ? default_operator() : operator_name;
  record.robot_serial = robot_serial;
  record.scanner_serial = scanner_serial;
  record.temperature_c = temperature_c;
  record.scanner = config_in.by.scanner.view();
  record.software = daemon::software_version().view();
  record.created_utime_us = wall_clock_us();
  const int days = valid_days >= 0 ? valid_days : config_in.calibration_valid_days;
  const std::int64_t from_utime_us = std::min(measured_utime_us, record.created_utime_us);
  record.expires_utime_us = days == 0 ? 0 : from_utime_us + std::int64_t{days} * 86'400 * 1'000'000;
}

namespace {

/// Warns that an existing record keeps its data, even if other data is given with the same numbers.
void say_what_is_not_changed(const config::Config& config, const storage::CalibrationRecord& given,
                             const std::string& id) {
  const auto reader = records_if_readable(config);
  if (!reader.ok()) return complain(retold(reader.error().text.view()));
  if (reader.value() == nullptr) return;
  const auto there = reader.value()->calibration(id);
  if (!there.ok() || !there.value()) return;
  const auto differs = [](const std::string& now, const std::string& kept) { return !now.empty() && now != kept; };
  if (differs(given.robot_serial, there.value()->robot_serial) ||
      differs(given.scanner_serial, there.value()->scanner_serial) ||
      (has_value(given.temperature_c) && given.temperature_c != there.value()->temperature_c))
    complain(say("warning: {} is kept already; its serial numbers and temperature are not changed", id));
}

}  // namespace

Kept keep_record(const config::Config& config, const RecordOptions& options, const storage::CalibrationRecord& record) {
  Kept kept;
  if (record.expires_utime_us != 0 && record.expires_utime_us <= wall_clock_us()) {
    complain(
        say("{} may be used until {}, counted from the oldest {}: expired; calibrate again, or, if the clock "
            "was wrong when "
            "that one was taken, leave it out and solve again",
            record.kind() == CalibrationKind::stations ? say("what these visits give") : say("this calibration"),
            report::iso_time(record.expires_utime_us),
            record.kind() == CalibrationKind::stations ? say("scan") : say("view")));
    kept.status = kRefused;
    return kept;
  }
  const Result<ChangeAnswer> done = change_calibration(config, storage::KeepCalibration{record});
  if (!done.ok()) {
    complain(retold(done.error().text.view()));
    kept.status = exit_for(done.error().code);
    return kept;
  }
  kept.id = done.value().id;
  say_what_is_not_changed(config, record, kept.id);
  if (!options.apply) return kept;
  const std::string why = options.why.empty() ? "newly measured" : options.why;
  const Result<ChangeAnswer> applied =
      change_calibration(config, storage::ApplyCalibration{kept.id, {record.operator_name, why, wall_clock_us()}});
  if (!applied.ok()) {
    complain(say("{} is kept but not in force: {}", kept.id, quote(applied.error().text.view())));
    kept.status = applied.error().code == Code::config ? kRefused : exit_for(applied.error().code);
    return kept;
  }
  kept.applied = true;
  kept.after_slab = applied.value().after_slab;
  return kept;
}

std::string kept_text(const Kept& kept, bool dry_run) {
  if (dry_run) return say("nothing was kept (--dry-run)\n");
  if (kept.applied)
    return say("{} is in force{}\n", kept.id, kept.after_slab ? say(" from the next slab on; one is open now") : "");
  return say("kept as {}; put it in force with: slabctl calibrate apply {} --reason \"...\"\n", kept.id, kept.id);
}

Result<std::unique_ptr<storage::Reader>> records_if_readable(const config::Config& config) {
  if (storage::is_unused(config.storage.db_path)) return std::unique_ptr<storage::Reader>();
  return storage::open_reader(config.storage.db_path);
}

std::unique_ptr<storage::Reader> open_records(const config::Config& config) {
  return need(records_if_readable(config), kNotReachable);
}

std::string one_acceptance_for_two(const config::Config& config) {
  if (!config.arms.several()) return {};
  const auto reader = records_if_readable(config);
  if (!reader.ok() || reader.value() == nullptr) return {};
  const auto cell = reader.value()->cell_calibration(config.arms);
  if (!cell) return {};
  const ScannerInForce& first = cell.value()->arm[0].scanner;
  const ScannerInForce& second = cell.value()->arm[1].scanner;
  if (first.id.empty() || second.id.empty()) return {};
  const ScannerNumbers& a = first.numbers;
  const ScannerNumbers& b = second.numbers;
  // Two devices do not have the same noise to the last bit.
  const bool same_scans = (has_value(a.noise_sigma_mm) && a.noise_sigma_mm == b.noise_sigma_mm) ||
                          (has_value(a.PF_mm) && a.PF_mm == b.PF_mm);
  const bool same_name = !a.scanner.empty() && a.scanner == b.scanner;
  if (!same_scans && !same_name) return {};
  return say(
      "{} and {} are acceptances of one device{}: each scanner needs its own (slabctl scanner verify "
      "--scanner-id)",
      first.id.view(), second.id.view(), same_name ? fmt::format(" ({})", a.scanner.view()) : std::string());
}

std::optional<Pose> find_T_robot_slab(storage::Reader* reader, const config::Config& config) {
  if (config.by.scanner == config.arms.list[0].scanner) return config.T_base_slab;
  const auto cell = reader == nullptr ? nullptr : need(reader->cell_calibration(config.arms));
  if (cell == nullptr || cell->tie.id.empty()) return std::nullopt;
  return cell->tie.numbers.T_base_robot.inverse() * config.T_base_slab;
}

std::string_view why_unused(const StationsInForce& table, const CalibrationId& hand_eye_id, std::int64_t utime_us) {
  if (!(table.hand_eye_id == hand_eye_id)) return "stale";
  return table.expires_utime_us != 0 && utime_us >= table.expires_utime_us ? "expired" : "";
}

InForce hand_eye_in_force(storage::Reader* reader, const config::Config& config) {
  InForce now{config.calibration.id, config.calibration.T_flange_scanner, false};
  if (reader == nullptr) return now;
  const auto current = need(reader->current(CalibrationKind::hand_eye, 0, config.by.scanner.view()));
  if (!current) return now;
  now.id.assign(current->id);
  now.T_flange_scanner = std::get<HandEyeNumbers>(current->numbers).T_flange_scanner;
  now.applied = true;
  return now;
}

InForce hand_eye_in_force(const config::Config& config) {
  return hand_eye_in_force(open_records(config).get(), config);
}

}  // namespace slabd::cli
