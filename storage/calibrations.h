// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "storage/files/sqlite.h"
#include "storage/storage.h"

/// Calibrations as rows: kept, put in force, rolled back, checked. Every call belongs into the caller's transaction and
/// throws SqlFailure; one that cannot be carried out throws Refusal (storage/jobs.h) before it has changed anything.
namespace slabd::storage {

class Calibrations {
 public:
  explicit Calibrations(Connection& db) : db_(db) {}

  /// Returns the id of the record the change was about.
  std::string carry_out(const CalibrationChange& change);

  [[nodiscard]] std::vector<CalibrationRecord> all();
  /// By id, or by how it begins when only one begins so.
  [[nodiscard]] std::optional<CalibrationRecord> find(std::string_view id);
  [[nodiscard]] std::optional<CalibrationRecord> current(CalibrationKind kind, std::uint16_t slab_type);
  [[nodiscard]] std::vector<AppliedChange> applied(std::size_t limit);
  [[nodiscard]] std::vector<CalibrationCheck> checks(std::size_t limit);

  /// What is in force. A record whose numbers do not give its id is not used: source `missing`, or the table or the
  /// scanner's acceptance left out, and `trouble` says so.
  void in_force(LineCalibration& out);
  /// What this slab was begun with.
  void of_slab(const SlabHeader& slab, LineCalibration& out);

 private:
  [[nodiscard]] std::optional<CalibrationRecord> find_exactly(std::string_view id);
  [[nodiscard]] std::string kept_already(CalibrationRecord& record);
  std::string keep(const CalibrationRecord& record);
  std::string apply(const ApplyCalibration& change);
  std::string roll_back(const RollBackCalibration& change);
  std::string keep(const CalibrationCheck& check);

  struct Row {
    std::int64_t seq = 0;  ///< 0: nothing was ever in force
    std::int64_t before_seq = 0;
    std::string calibration_id;
  };
  [[nodiscard]] Row newest(CalibrationKind kind, std::uint16_t slab_type);
  void check_may_apply(const CalibrationRecord& record, const ChangeNote& note);
  void insert_applied(const CalibrationRecord& record, const Row& replaced, bool is_rollback, std::int64_t before_seq,
                      const ChangeNote& note);
  [[nodiscard]] CalibrationRecord read(Statement& row);
  void use_hand_eye(const std::optional<CalibrationRecord>& record, LineCalibration& out);
  void use_table(const std::optional<CalibrationRecord>& record, LineCalibration& out);
  void use_scanner(const std::optional<CalibrationRecord>& record, ScannerInForce& out);
  [[nodiscard]] LineCalibration::Watch watch(CalibrationKind kind);
  [[nodiscard]] std::int64_t newest_utime_us();
  /// Made within a day before `utime_us`, and never in force.
  [[nodiscard]] bool is_new(const CalibrationRecord& record, std::int64_t utime_us);
  /// A new record is in force that the newest time of all records would let expire: that time was a wrong clock's.
  void follow_clock(const CalibrationRecord& record, std::int64_t utime_us);

  Connection& db_;
};

// What the numbers of a calibration say about themselves.

/// "he", "st", "rb", "mb", "sc": how ids of this kind begin.
[[nodiscard]] std::string_view id_prefix(CalibrationKind kind);

/// What keeps these numbers from being used, as the rest of a sentence; empty: nothing.
[[nodiscard]] std::string nonsense_in(const CalibrationRecord& record);

/// Is `record.id` the id of its numbers?
[[nodiscard]] bool numbers_give_id(const CalibrationRecord& record);

}  // namespace slabd::storage
