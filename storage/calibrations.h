// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "storage/files/sqlite.h"
#include "storage/storage.h"

/// Database rows of calibrations: store, apply, roll back, check. Every call must be inside the caller's transaction
/// and throws SqlFailure. A call that cannot be carried out throws Refusal (storage/jobs.h) before it has changed
/// anything.
namespace slabd::storage {

class Calibrations {
 public:
  explicit Calibrations(Connection& db) : db_(db) {}

  /// Carries out a change and returns the id of the record it affects.
  std::string carry_out(const CalibrationChange& change);

  [[nodiscard]] std::vector<CalibrationRecord> all();
  /// Finds a record by its id, or by a prefix of the id that is unique.
  [[nodiscard]] std::optional<CalibrationRecord> find(std::string_view id);
  [[nodiscard]] std::optional<CalibrationRecord> current(CalibrationKind kind, std::uint16_t slab_type,
                                                         std::string_view scanner);
  [[nodiscard]] std::vector<AppliedChange> applied(std::size_t limit);
  [[nodiscard]] std::vector<CalibrationCheck> checks(std::size_t limit);

  /// Reads the calibrations in force. A record whose numbers do not match its id is not used: the source is `missing`,
  /// or the table or the scanner's acceptance is omitted. `trouble` contains the reason.
  void in_force(std::string_view scanner, LineCalibration& out);
  /// The same for all scanners of a line, with the tie.
  void in_force(const LineArms& arms, CellCalibration& out);
  /// Reads the calibrations with which this slab was begun.
  void of_slab(const SlabHeader& slab, CellCalibration& out);

 private:
  [[nodiscard]] std::optional<CalibrationRecord> find_exactly(std::string_view id);
  [[nodiscard]] std::string kept_already(CalibrationRecord& record);
  std::string keep(const CalibrationRecord& record);
  std::string apply(const ApplyCalibration& change);
  std::string roll_back(const RollBackCalibration& change);
  std::string keep(const CalibrationCheck& check);

  struct Row {
    std::int64_t seq = 0;  ///< 0 if none was ever in force
    std::int64_t before_seq = 0;
    std::string calibration_id;
  };
  [[nodiscard]] Row newest(CalibrationKind kind, std::uint16_t slab_type, std::string_view scanner);
  [[nodiscard]] bool is_hand_eye_in_force(std::string_view id);
  void check_tie_of_tables(std::string_view tie_id, bool is_first, LineCalibration& out);
  void check_may_apply(const CalibrationRecord& record, const ChangeNote& note);
  void insert_applied(const CalibrationRecord& record, const Row& replaced, bool is_rollback, std::int64_t before_seq,
                      const ChangeNote& note);
  [[nodiscard]] CalibrationRecord read(Statement& row);
  void use_hand_eye(const std::optional<CalibrationRecord>& record, LineCalibration& out);
  void use_table(const std::optional<CalibrationRecord>& record, LineCalibration& out);
  void use_scanner(const std::optional<CalibrationRecord>& record, ScannerInForce& out);
  void use_tie(const std::optional<CalibrationRecord>& record, TieInForce& out);
  void use_slab(const CalibrationId& hand_eye, const CalibrationId& stations, const CalibrationId& scanner,
                LineCalibration& out);
  [[nodiscard]] LineCalibration::Watch watch(CalibrationKind kind, std::string_view scanner);
  [[nodiscard]] std::int64_t newest_utime_us();
  /// True if the record was made within a day before `utime_us` and was never in force.
  [[nodiscard]] bool is_new(const CalibrationRecord& record, std::int64_t utime_us);
  /// Resets the newest time of all records if it is past the expiry of a newly applied record: it came from a wrong
  /// clock.
  void follow_clock(const CalibrationRecord& record, std::int64_t utime_us);

  Connection& db_;
};

// Checks of a calibration's numbers.

/// Prefix of the ids of this kind: "he", "st", "rb", "mb", "sc", "ti".
[[nodiscard]] std::string_view id_prefix(CalibrationKind kind);

/// Reason why these numbers cannot be used, as the rest of a sentence; empty if they can.
[[nodiscard]] std::string implausible_value_in(const CalibrationRecord& record);

/// True if `record.id` is the id of its numbers.
[[nodiscard]] bool numbers_give_id(const CalibrationRecord& record);

}  // namespace slabd::storage
