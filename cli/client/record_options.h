// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <string>

#include "cli/exit.h"
#include "config/config.h"
#include "storage/storage.h"

namespace slabd::args {
class Command;
}  // namespace slabd::args

/// What every calibration record says about where it comes from, and how a command keeps and applies one.
namespace slabd::cli {

struct RecordOptions {
  std::string config;
  std::string operator_name;
  std::string robot_serial;
  std::string scanner_serial;
  double temperature_c = kNoValue;
  int valid_days = -1;  ///< -1: the configuration's
  std::string why;      ///< of applying it
  bool apply = false;
  bool dry_run = false;

  void add_to(args::Command& command);
  /// Only who, with what and for how long: --operator, --robot-serial, --scanner-serial, --temperature, --valid-days.
  void add_origin_to(args::Command& command);
  /// Fills operator, serials, temperature, software, times. The record may be used for the given time from
  /// `measured_utime_us` on, the oldest of what it is computed from: who computes it again has measured nothing.
  void describe(const daemon::Config& config_in, storage::CalibrationRecord& record,
                std::int64_t measured_utime_us = std::numeric_limits<std::int64_t>::max()) const;
};

struct Kept {
  Exit status = kDone;  ///< else the sentence is printed
  std::string id;       ///< empty if it is not kept
  bool applied = false;
  bool after_slab = false;
};
/// Keeps the record and, if asked to, puts it in force. A failure is a value: the command still has to print what it
/// measured.
[[nodiscard]] Kept keep_record(const daemon::Config& config, const RecordOptions& options,
                               const storage::CalibrationRecord& record);
/// "kept as st-...; apply it with ...", for people.
[[nodiscard]] std::string kept_text(const Kept& kept, bool dry_run);

/// The database, read-only; nullptr in a fresh installation, which has none yet, or one whose creation was stopped.
[[nodiscard]] std::unique_ptr<storage::Reader> open_records(const daemon::Config& config);
/// The same for a command that goes on without it.
[[nodiscard]] Result<std::unique_ptr<storage::Reader>> records_if_readable(const daemon::Config& config);

/// The hand-eye calibration that counts: the one applied, else the configuration's commissioning value.
struct InForce {
  CalibrationId id;  ///< empty: neither
  Pose T_flange_scanner;
  bool applied = false;
};
[[nodiscard]] InForce hand_eye_in_force(const daemon::Config& config);
[[nodiscard]] InForce hand_eye_in_force(storage::Reader* reader, const daemon::Config& config);

}  // namespace slabd::cli
