// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <string>

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
  bool ok = false;
  std::string id;
  bool applied = false;
  bool after_slab = false;
};
/// Keeps the record and, when asked to, puts it in force. On failure the sentence is printed and `exit_status` set.
[[nodiscard]] Kept keep_record(const daemon::Config& config, const RecordOptions& options,
                               const storage::CalibrationRecord& record, int& exit_status);
/// "kept as st-...; apply it with ...", for people.
[[nodiscard]] std::string kept_text(const Kept& kept, bool dry_run);

/// The database, read-only; a fresh installation has none yet, or one whose creation was stopped, which
/// is no error here. False: printed.
[[nodiscard]] bool open_records(const daemon::Config& config, std::unique_ptr<storage::Reader>& reader,
                                int& exit_status);

/// The hand-eye calibration that counts: the one applied, else the configuration's commissioning value.
struct InForce {
  CalibrationId id;  ///< empty: neither
  Pose T_flange_scanner;
  bool applied = false;
};
/// False: printed.
[[nodiscard]] bool hand_eye_in_force(const daemon::Config& config, InForce& out, int& exit_status);
[[nodiscard]] bool hand_eye_in_force(storage::Reader* reader, const daemon::Config& config, InForce& out,
                                     int& exit_status);

}  // namespace slabd::cli
