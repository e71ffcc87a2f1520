// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

#include "base/arm.h"
#include "base/fixed.h"
#include "base/items.h"
#include "base/limits.h"
#include "base/pose.h"
#include "base/units.h"

/// Calibration results: the scanner on the flange, the robot at every station, and the artefacts that monitor both.
/// These numbers pass between calib, storage, the station and reports. Lengths in mm, angles in rad, standard
/// uncertainties (k = 1) unless named U (k = 2). An unknown number is NaN.
namespace slabd {

/// Identifier such as "he-3f2a91c07b5e": two letters for the kind and the first 12 hex digits of the SHA-256 of its
/// numbers. Equal ids therefore mean equal numbers. Values from the configuration have "commissioning-<12 digits>".
using CalibrationId = FixedString<64>;

enum class CalibrationKind : std::uint8_t { hand_eye, stations, reference_block, monitor_ball, scanner, tie };
inline constexpr std::size_t kCalibrationKinds = 6;
/// Word used in JSON, the database and on command lines: "hand_eye", "stations", "reference_block", "monitor_ball",
/// "scanner" or "tie".
[[nodiscard]] std::string_view name(CalibrationKind kind);
[[nodiscard]] std::optional<CalibrationKind> calibration_kind_named(std::string_view word);

// ---- the numbers of each kind --------------------------------------------------------------------------------------

/// Pose of the scanner on the flange.
struct HandEyeNumbers {
  Pose T_flange_scanner;
  /// Position of a point in the field of view, per axis: predicted by the solver, times max(1, s0)
  double sigma_mm = kNoValue;
  double sigma_rad = kNoValue;  ///< rotation of the scanner, per axis
};

/// Correction of the robot's error at one mastered station. In production T_base_scanner = T_base_reported *
/// T_base_flange (reported now) * T_flange_scanner. It is applied only while the reported pose is within the gate
/// around the pose at mastering.
struct StationCorrection {
  std::uint8_t visits = 0;  ///< M; 0 if this station was not mastered
  Pose T_base_reported;     ///< C_s: maps a point computed from the reported pose to its true place in the base frame
  Pose T_base_flange;       ///< mean reported pose of the visits
  /// One visit about the mean of many, per axis, at the block; includes the certificate's uncertainty.
  double sigma_mm = kNoValue;
  double sigma_rad = kNoValue;  ///< rotation of one visit; the rest as sigma_mm
  double spread_mm = kNoValue;  ///< standard deviation of this station's own visits, per axis
};
/// Corrections of all stations of one slab type, valid only with the hand-eye calibration they were solved with.
struct StationTable {
  std::uint16_t slab_type = 0;
  std::array<StationCorrection, limits::kStationsMax> station{};  ///< [station - 1]
};

/// Certified values of the block for the daily check.
struct ReferenceBlock {
  double slope_rad = kNoValue;    ///< slope of the seat against the local slab top
  double slope_U_rad = kNoValue;  ///< uncertainty from the certificate, k = 2
  double jaw_distance_mm = kNoValue;
  double jaw_distance_U_mm = kNoValue;
};

/// A ball fixed in the cell, as measured when it was taken into use.
struct MonitorBall {
  Vec3 p_base = Vec3::Constant(kNoValue);
  double radius_mm = kNoValue;
  double limit_mm = kNoValue;  ///< largest allowed distance from p_base; beyond it the robot, the scanner's mount or
                               ///< the cell has moved
};

/// Acceptance of the scanner with a plate and a ball (VDI/VDE 2634 part 2): the worst of all places. NaN if not
/// measured.
struct ScannerNumbers {
  FixedString<64> scanner;           ///< name or serial number; empty if not given
  double PF_mm = kNoValue;           ///< probing error form
  double PS_mm = kNoValue;           ///< probing error size, magnitude; half width of the error of any length
  double RF_mm = kNoValue;           ///< flatness measurement error
  double form_half_mm = kNoValue;    ///< half width of the form error that does not average out, over form_length_mm
  double form_length_mm = kNoValue;  ///< shortest length over which a plate was measured
  double noise_sigma_mm = kNoValue;  ///< noise of a single point
  /// Distance at which the noise correlation of neighbours falls to 1/e; 0 if uncorrelated.
  double noise_correlation_mm = kNoValue;
  double pitch_mm = kNoValue;  ///< distance between neighbours in a row
  std::uint16_t plates = 0;    ///< number of places where the plate was measured
  std::uint16_t balls = 0;
  bool within_limits = false;       ///< true if every figure with a limit is within it
  double temperature_c = kNoValue;  ///< of the scanner during its acceptance; NaN: not known, then U does not grow
};
/// Minimum numbers from the guideline: the plate in six places of the volume and the ball in ten.
inline constexpr std::uint16_t kPlatePlacesMin = 6;
inline constexpr std::uint16_t kBallPlacesMin = 10;
/// Reason why these figures cannot be accepted, without a final period; empty if they can.
[[nodiscard]] FixedString<limits::kErrorTextBytes> refusal_of(const ScannerNumbers& numbers);

/// Change of a scanner's frame with its temperature, from the configuration.
struct ScannerDriftSettings {
  /// Largest relative change of a length per kelvin. The default is a frame of aluminium without compensation
  /// (23e-6 per K), rounded up; one of invar or carbon fibre is below 3e-6.
  double per_K = 25e-6;
  double range_K = 15.0;  ///< further than this from the acceptance's temperature is a warning
};
/// Half width of the relative error of a length in a scan at `temperature_c`, since the acceptance: per_K |T - T0|. NaN
/// if one of the two temperatures is not known; U then contains no such part.
[[nodiscard]] double scanner_drift(const ScannerDriftSettings& settings, const ScannerNumbers& accepted,
                                   double temperature_c);
/// True if the temperature is known to be further from the acceptance's than the settings allow.
[[nodiscard]] bool is_outside_temperature(const ScannerDriftSettings& settings, const ScannerNumbers& accepted,
                                          double temperature_c);

/// Place of the second robot's base in the line's base frame, which is the base of the first robot.
struct TieNumbers {
  PartId robot;       ///< id of the second robot
  Pose T_base_robot;  ///< maps coordinates in the second robot's base to the line's base frame
  /// Point of the base frame about which the covariance is given: the middle of the targets.
  Vec3 centre_mm = Vec3::Constant(kNoValue);
  /// Covariance of the small motion from the stated base of the second robot to the true one. Order: x, y, z in mm,
  /// rotation about X, Y, Z in rad; axes of the base frame, about centre_mm.
  Mat6 covariance = Mat6::Constant(kNoValue);
  std::uint16_t targets = 0;  ///< number of targets that both robots measured
  double rms_mm = kNoValue;   ///< distance between the two measurements of a target, after the tie
};

// ---- checks --------------------------------------------------------------------------------------------------------

/// One daily check of the reference block, or one measurement of the monitor ball.
struct CalibrationCheck {
  CalibrationKind kind = CalibrationKind::reference_block;  ///< or monitor_ball
  CalibrationId reference_id;                               ///< the record the measurement was compared with
  CalibrationId hand_eye_id;  ///< hand-eye calibration in force at that time; empty if none
  bool passed = false;
  double slope_rad = kNoValue;  ///< measured slope
  double slope_U_rad = kNoValue;
  double jaw_distance_mm = kNoValue;
  double jaw_distance_U_mm = kNoValue;
  Vec3 off_mm = Vec3::Constant(kNoValue);  ///< monitor ball: measured position minus its stored position, base axes
  std::int64_t utime_us = 0;               ///< time of the verdict
  FixedString<64> who;
  FixedString<limits::kPathBytes> source;  ///< scan file, or "slab 12 station 3"
  FixedString<160> note;                   ///< reason of the failure
};

// ---- calibration in force ---------------------------------------------------------------------------------------

/// A table of station corrections in force.
struct StationsInForce {
  CalibrationId id;
  /// Hand-eye calibration the table was solved with; if another one is in force, the table is stale. Empty if the
  /// table is of the second robot, and was put in force with another tie.
  CalibrationId hand_eye_id;
  std::int64_t expires_utime_us = 0;  ///< 0 if it never expires
  StationTable table;
};

/// The scanner's acceptance in force. Its figures count in U even after it has expired, so that U does not decrease
/// when the expiry date passes.
struct ScannerInForce {
  CalibrationId id;        ///< empty: the scanner was never accepted, and only the recipe's specification counts
  ScannerNumbers numbers;  ///< meaningless without an id
  std::int64_t expires_utime_us = 0;  ///< 0 if it never expires
  bool failed = false;                ///< true if a later verification was out of its limits
  FixedString<160> trouble;           ///< reason why the applied acceptance is not used
};

/// All calibrations in force, loaded by the daemon at its start and between two slabs.
struct LineCalibration {
  /// commissioning: a calibration was never applied, and the values of the configuration are used. missing: the
  /// configuration has no values either, or the applied calibration cannot be used (`trouble` contains the reason).
  enum class Source : std::uint8_t { missing, commissioning, applied } source = Source::missing;
  FixedString<160> trouble;
  CalibrationId id;
  PartId of_scanner;  ///< the applied hand-eye calibration's; empty: there is none
  HandEyeNumbers hand_eye;
  std::int64_t expires_utime_us = 0;                         ///< hand-eye calibration; 0 if it never expires
  FixedVector<StationsInForce, limits::kRecipesMax> tables;  ///< at most one for each slab type

  struct Watch {
    CalibrationId reference_id;         ///< the artefact in force; empty if there is none, then no check is due
    std::int64_t since_utime_us = 0;    ///< time it was first taken into use
    std::int64_t checked_utime_us = 0;  ///< last check of this kind with any artefact; 0 if there was none
    bool failed = false;    ///< true if that check failed; only a passed check clears it, another artefact does not
    FixedString<160> note;  ///< reason of the failure
  };
  Watch block;  ///< reference block
  Watch ball;   ///< monitor ball

  ScannerInForce scanner;

  [[nodiscard]] const StationsInForce* table_for(std::uint16_t slab_type) const {
    for (const StationsInForce& table : tables)
      if (table.table.slab_type == slab_type) return &table;
    return nullptr;
  }
};

/// The tie of the two robots' bases in force.
struct TieInForce {
  CalibrationId id;  ///< empty: no tie was ever applied
  TieNumbers numbers;
  /// Hand-eye calibrations of both arms that it was solved with; if another one is in force, the tie is stale.
  std::array<CalibrationId, limits::kArmsMax> hand_eye_id;
  std::int64_t expires_utime_us = 0;  ///< 0 if it never expires
  FixedString<160> trouble;           ///< reason why the applied tie cannot be used
};

/// Parent of a tie, as stored: the ids of the two hand-eye calibrations with a '+' between them.
[[nodiscard]] CalibrationId tie_parent(const CalibrationId& first, const CalibrationId& second);
/// The two ids of a tie's parent; nullopt if it is not two ids with a '+' between them.
[[nodiscard]] std::optional<std::array<CalibrationId, limits::kArmsMax>> hand_eyes_of_tie(std::string_view parent);

/// All calibrations of a line: those of each arm's scanner, and the tie between the robots.
struct CellCalibration {
  std::array<LineCalibration, limits::kArmsMax> arm;
  TieInForce tie;  ///< unused on a line with one arm
};

/// Reason why a slab must not begin: the calibration is missing, has expired or failed its last check.
enum class CalibrationFault : std::uint8_t { none, missing, expired, check_failed };
[[nodiscard]] CalibrationFault fault_of(const LineCalibration& calibration, std::int64_t utime_us);
/// One sentence with the fault and its remedy; empty for `none`.
[[nodiscard]] FixedString<limits::kErrorTextBytes> describe(CalibrationFault fault, const LineCalibration& calibration);

/// Reason why the tie cannot be used.
enum class TieFault : std::uint8_t { none, missing, unusable, stale, expired };
/// Fault of the tie between arm 0 and `robot`, the robot of arm 1.
[[nodiscard]] TieFault fault_of_tie(const CellCalibration& calibration, const PartId& robot, std::int64_t utime_us);
/// One sentence with the fault and its remedy; empty for `none`.
[[nodiscard]] FixedString<limits::kErrorTextBytes> describe(TieFault fault, const CellCalibration& calibration);

/// Bits of WARN (IR 8), in addition to those of PlcWarn (base/plc.h).
enum CalibrationWarn : std::uint16_t {
  kWarnCheckOverdue = 1U << 8U,
  kWarnStationsNotCorrected = 1U << 9U,
  kWarnScannerNotVerified = 1U << 10U,
};

/// State of the scanner's acceptance. It never stops the line: a line without an acceptance continues.
/// other_temperature: valid, but the newest scan's temperature is too far from the acceptance's.
enum class AcceptanceState : std::uint8_t { verified, never, expired, failed, other_temperature };
/// "verified", "never", "expired", "failed", "other_temperature".
[[nodiscard]] std::string_view name(AcceptanceState standing);
/// `outside`: is_outside_temperature() of the newest scan.
[[nodiscard]] AcceptanceState acceptance_state(const ScannerInForce& scanner, std::int64_t utime_us,
                                               bool outside = false);

/// Time from which the next check is counted: the last check, or the artefact's first day if there was none. Taking an
/// artefact into use is not a check and does not postpone the next one.
[[nodiscard]] std::int64_t checked_from_utime_us(const LineCalibration::Watch& watch);
/// True if a check is due: the artefact in force has had no check for longer than `interval_us` (0: never due). Also
/// true if the last check is more than an hour in the future, because the clock was wrong then.
[[nodiscard]] bool overdue(const LineCalibration::Watch& watch, std::int64_t interval_us, std::int64_t utime_us);

// ---- splicing one scan ---------------------------------------------------------------------------------------------

/// Assumptions about the robot, from the configuration.
struct SpliceSettings {
  double gate_mm = 1.0;                  ///< largest distance between reported and mastered position ...
  double gate_rad = rad_from_deg(0.05);  ///< ... and rotation; beyond either the correction is not applied
  double absolute_mm = kNoValue;         ///< absolute accuracy of the robot without a correction, per axis
  double absolute_rad = kNoValue;
  double repeatability_mm = 0.0;  ///< repeatability of the robot, used with commissioning values
  double repeatability_rad = 0.0;
  double commissioning_mm = kNoValue;  ///< uncertainty of a station's splice given in the configuration
  double commissioning_rad = kNoValue;
};

/// Source of a scan's splice. All but `corrected` use only the hand-eye calibration; the last four name the reason.
enum class SpliceSource : std::uint8_t {
  none,           ///< no calibration; also the value of zeroed memory
  commissioning,  ///< the configuration's values and uncertainty
  corrected,      ///< hand-eye calibration and station correction
  not_mastered,   ///< this station of this slab type has no correction
  stale,          ///< the corrections were solved with another hand-eye calibration
  expired,        ///< the corrections are too old
  outside_gate,   ///< the robot is outside the gate around the mastered pose
};
inline constexpr std::size_t kSpliceSources = 7;
[[nodiscard]] std::string_view name(SpliceSource source);

/// Transformation of one station's scan into the base frame, and its uncertainty at the block.
struct Splice {
  SpliceSource source = SpliceSource::none;
  std::uint8_t visits = 0;   ///< M if corrected
  Pose T_base_reported;      ///< the correction used; identity if none
  double off_mm = kNoValue;  ///< distance of the reported position from the mastered one; NaN if not mastered
  double off_rad = kNoValue;
  double calibration_mm = kNoValue;  ///< sigma / sqrt(M) if corrected; else from the hand-eye calibration
  double calibration_rad = kNoValue;
  double robot_mm = kNoValue;  ///< sigma of one visit if corrected; else absolute accuracy, or repeatability
  double robot_rad = kNoValue;
  bool tied = false;  ///< true if the scan is of an arm after the first, and T_base_robot counts
  Pose T_base_robot;  ///< base of the scan's robot in the line's base frame; identity for arm 0
};
/// Computes the splice of one scan. `lever_mm` is the distance from flange to block; the flange's absolute rotation
/// error shifts the block by that error times the lever.
[[nodiscard]] Splice splice_for(const LineCalibration& calibration, const SpliceSettings& settings,
                                std::uint16_t slab_type, int station, const Pose& T_base_flange, double lever_mm,
                                std::int64_t utime_us);
/// The same for a scan of one arm; `T_base_flange` is in the base of that arm's robot. An arm after the first is tied
/// to the line's base frame. Without an applied tie its source is `none`.
[[nodiscard]] Splice splice_for(const CellCalibration& calibration, std::size_t arm, const SpliceSettings& settings,
                                std::uint16_t slab_type, int station, const Pose& T_base_flange, double lever_mm,
                                std::int64_t utime_us);

/// Newest time of day that the records confirm (us since 1970), used for expiry when the clock is behind. A clock that
/// is a year ahead for a minute must not expire all calibrations permanently. Therefore a time more than a day ahead
/// counts only after another one follows an hour later with none from before the jump. The first time counts at once.
class NewestTime {
 public:
  NewestTime() = default;
  explicit NewestTime(std::int64_t utime_us) : newest_(utime_us) {}

  void note(std::int64_t utime_us) {
    if (newest_ == 0 || utime_us <= newest_ + kStep_us) {
      if (utime_us > newest_) newest_ = utime_us;
      jumped_ = 0;
    } else if (jumped_ == 0 || utime_us < jumped_) {
      jumped_ = utime_us;
    } else if (utime_us - jumped_ >= kHolds_us) {
      newest_ = utime_us;
      jumped_ = 0;
    }
  }
  [[nodiscard]] std::int64_t utime_us() const { return newest_; }

 private:
  static constexpr std::int64_t kHolds_us = 3'600'000'000;
  static constexpr std::int64_t kStep_us = 24 * kHolds_us;
  std::int64_t newest_ = 0;
  std::int64_t jumped_ = 0;  ///< first of the times far ahead; 0 if none
};

}  // namespace slabd
