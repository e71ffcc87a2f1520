// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "cli/client/scanner_choice.h"
#include "cli/exit.h"
#include "config/config.h"
#include "storage/storage.h"

namespace slabd::cli::args {
class Command;
}  // namespace slabd::cli::args

/// Origin data of calibration records, and functions that store and apply records.
namespace slabd::cli {

struct RecordOptions {
  std::string config;
  std::string operator_name;
  std::string robot_serial;
  std::string scanner_serial;
  double temperature_c = kNoValue;
  int valid_days = -1;  ///< -1: the configuration's value
  std::string why;      ///< reason for applying it
  bool apply = false;
  bool dry_run = false;
  ScannerChoice scanner;  ///< added by add_to()

  void add_to(args::Command& command);
  /// Adds the options for operator, equipment and validity: --operator, --robot-serial, --scanner-serial,
  /// --temperature, --valid-days.
  void add_origin_to(args::Command& command);
  /// Sets operator, serials, temperature, software, times, and the scanner by `config_in.by`. The validity begins at
  /// `measured_utime_us`, the time of the oldest input, because computing a calibration again is not a measurement.
  void describe(const config::Config& config_in, storage::CalibrationRecord& record,
                std::int64_t measured_utime_us = std::numeric_limits<std::int64_t>::max()) const;
};

struct Kept {
  Exit status = kDone;  ///< otherwise the message is printed
  std::string id;       ///< empty if it is not stored
  bool applied = false;
  bool after_slab = false;
};
/// Stores the record and puts it in force if requested. A failure is a return value, because the command must still
/// print its measurement.
[[nodiscard]] Kept keep_record(const config::Config& config, const RecordOptions& options,
                               const storage::CalibrationRecord& record);
/// Message "kept as st-...; apply it with ...".
[[nodiscard]] std::string kept_text(const Kept& kept, bool dry_run);

/// Opens the database read-only; nullptr in a new installation without a database, or if its creation was interrupted.
[[nodiscard]] std::unique_ptr<storage::Reader> open_records(const config::Config& config);
/// The same for a command that works without it.
[[nodiscard]] Result<std::unique_ptr<storage::Reader>> records_if_readable(const config::Config& config);

/// Sentence if the acceptances in force of two scanners are those of one device: they have its name, or the figures of
/// the same scans. Empty if not, or if the records cannot be read.
[[nodiscard]] std::string one_acceptance_for_two(const config::Config& config);

/// "stale" or "expired" if the corrections do not apply to slabs that begin at `utime_us` with this hand-eye
/// calibration in force; otherwise empty.
[[nodiscard]] std::string_view why_unused(const StationsInForce& table, const CalibrationId& hand_eye_id,
                                          std::int64_t utime_us);

/// The effective hand-eye calibration of the scanner `config.by`: the applied one, otherwise the configuration's
/// commissioning value.
struct InForce {
  CalibrationId id;  ///< empty if there is neither
  Pose T_flange_scanner;
  bool applied = false;
};
/// Pose of the slab in the base of the robot that carries the scanner `config.by`: for the first robot as configured,
/// for the second one by the tie in force. nullopt: the robots are not tied.
[[nodiscard]] std::optional<Pose> find_T_robot_slab(storage::Reader* reader, const config::Config& config);

[[nodiscard]] InForce hand_eye_in_force(const config::Config& config);
[[nodiscard]] InForce hand_eye_in_force(storage::Reader* reader, const config::Config& config);

}  // namespace slabd::cli
