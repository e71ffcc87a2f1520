// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

#include "base/fixed.h"
#include "base/items.h"
#include "base/limits.h"
#include "base/pose.h"
#include "base/units.h"

/// What is known of the scanner on the flange, of the robot at every station, and of the artefacts that watch over
/// both: the numbers that pass between calib, storage, the station and reports. Lengths in mm, angles in rad, standard
/// uncertainties (k = 1) unless named U (k = 2). Where a number is not known it is NaN.
namespace slabd {

/// "he-3f2a91c07b5e": two letters of the kind and the first 12 hex digits of the SHA-256 of its numbers, so that equal
/// ids mean equal numbers. Commissioning values of the configuration: "commissioning-<12 digits>".
using CalibrationId = FixedString<64>;

enum class CalibrationKind : std::uint8_t { hand_eye, stations, reference_block, monitor_ball, scanner };
inline constexpr std::size_t kCalibrationKinds = 5;
/// "hand_eye", "stations", "reference_block", "monitor_ball", "scanner": the word in JSON, the database and on command
/// lines.
[[nodiscard]] std::string_view name(CalibrationKind kind);
[[nodiscard]] std::optional<CalibrationKind> calibration_kind_named(std::string_view word);

// ---- the numbers of each kind --------------------------------------------------------------------------------------

/// Scanner on flange.
struct HandEyeNumbers {
  Pose T_flange_scanner;
  double sigma_mm = kNoValue;  ///< of a point in the field of view, per axis: predicted by the solver, times max(1, s0)
  double sigma_rad = kNoValue;  ///< of the scanner's rotation, per axis
};

/// What the robot's error at one taught station is made up for by. In production
/// T_base_scanner = T_base_reported * T_base_flange (reported now) * T_flange_scanner, as long as the robot reports
/// about the pose it reported when the station was mastered.
struct StationCorrection {
  std::uint8_t visits = 0;      ///< M; 0: this station was not mastered
  Pose T_base_reported;         ///< C_s: from where the reported pose puts a point to where it is
  Pose T_base_flange;           ///< mean reported pose of the visits
  double sigma_mm = kNoValue;   ///< of one visit about the mean of many, per axis, at the block; with the certificate's
  double sigma_rad = kNoValue;  ///< ... of its rotation
  double spread_mm = kNoValue;  ///< standard deviation of this station's own visits, per axis
};
/// All stations of one slab type. They hold for the hand-eye calibration they were solved with, and for no other.
struct StationTable {
  std::uint16_t slab_type = 0;
  std::array<StationCorrection, limits::kStationsMax> station{};  ///< [station - 1]
};

/// The certified block of the daily check.
struct ReferenceBlock {
  double slope_rad = kNoValue;    ///< of the seat against the local slab top
  double slope_U_rad = kNoValue;  ///< of the certificate, k = 2
  double jaw_distance_mm = kNoValue;
  double jaw_distance_U_mm = kNoValue;
};

/// A ball fixed in the cell, as it was found when it was taken into use.
struct MonitorBall {
  Vec3 p_base = Vec3::Constant(kNoValue);
  double radius_mm = kNoValue;
  double limit_mm = kNoValue;  ///< further from its place than this: the robot, the scanner's seat or the cell moved
};

/// The scanner against a plate and a ball (VDI/VDE 2634 part 2): the worst of all places. NaN: not looked at.
struct ScannerNumbers {
  FixedString<64> scanner;                 ///< its name or serial number; empty: not said
  double PF_mm = kNoValue;                 ///< probing error form
  double PS_mm = kNoValue;                 ///< probing error size, magnitude: half width of the error of any length
  double RF_mm = kNoValue;                 ///< flatness measurement error
  double form_half_mm = kNoValue;          ///< half width of the form error that does not average away, seen over ...
  double form_length_mm = kNoValue;        ///< ... this length: the shortest a plate was seen over
  double noise_sigma_mm = kNoValue;        ///< of a single point
  double noise_correlation_mm = kNoValue;  ///< where the noise of neighbours has only 1/e in common; 0: none is seen
  double pitch_mm = kNoValue;              ///< between neighbours of a row
  std::uint16_t plates = 0;                ///< places that were looked at
  std::uint16_t balls = 0;
  bool within_limits = false;  ///< every figure that was given a limit kept it
};
/// The guideline asks for the plate in at least six places of the volume and the ball in ten.
inline constexpr std::uint16_t kPlatePlacesMin = 6;
inline constexpr std::uint16_t kBallPlacesMin = 10;
/// Why these figures cannot vouch for a scanner, as a sentence without its end; empty: they can.
[[nodiscard]] FixedString<limits::kErrorTextBytes> refusal_of(const ScannerNumbers& numbers);

// ---- checks --------------------------------------------------------------------------------------------------------

/// One daily check of the reference block, or one look at the monitor ball.
struct CalibrationCheck {
  CalibrationKind kind = CalibrationKind::reference_block;  ///< or monitor_ball
  CalibrationId reference_id;                               ///< the record it was compared with
  CalibrationId hand_eye_id;                                ///< in force at the time; empty: none
  bool passed = false;
  double slope_rad = kNoValue;  ///< measured
  double slope_U_rad = kNoValue;
  double jaw_distance_mm = kNoValue;
  double jaw_distance_U_mm = kNoValue;
  Vec3 off_mm = Vec3::Constant(kNoValue);  ///< monitor ball: measured minus its place, base axes
  std::int64_t utime_us = 0;               ///< when the check was judged
  FixedString<64> who;
  FixedString<limits::kPathBytes> source;  ///< scan file, or "slab 12 station 3"
  FixedString<160> note;                   ///< why it failed
};

// ---- what the line works with
// ----------------------------------------------------------------------------------------

/// A table of station corrections in force.
struct StationsInForce {
  CalibrationId id;
  CalibrationId hand_eye_id;          ///< they were solved with; differs from the one in force: stale
  std::int64_t expires_utime_us = 0;  ///< 0 = never
  StationTable table;
};

/// The scanner's acceptance in force. Its figures count in U for as long as it stands, expired or not: U does not fall
/// because a day has passed.
struct ScannerInForce {
  CalibrationId id;        ///< empty: the scanner was never accepted, the recipe's specification counts alone
  ScannerNumbers numbers;  ///< without an id nothing is known
  std::int64_t expires_utime_us = 0;  ///< 0 = never
  bool failed = false;                ///< a later verification was out of its limits
  FixedString<160> trouble;           ///< why what was applied is not used
};

/// Everything that is applied, as the daemon takes it up at its start and between two slabs.
struct LineCalibration {
  /// commissioning: nothing was ever applied, the configuration's values count. missing: there are not even those, or
  /// what was applied cannot be used (`trouble` says why).
  enum class Source : std::uint8_t { missing, commissioning, applied } source = Source::missing;
  FixedString<160> trouble;
  CalibrationId id;
  HandEyeNumbers hand_eye;
  std::int64_t expires_utime_us = 0;                         ///< of the hand-eye calibration; 0 = never
  FixedVector<StationsInForce, limits::kRecipesMax> tables;  ///< at most one of a slab type

  struct Watch {
    CalibrationId reference_id;         ///< the artefact in force; empty: there is none, and no check is due
    std::int64_t since_utime_us = 0;    ///< when it was first taken into use
    std::int64_t checked_utime_us = 0;  ///< last check of this kind, whatever artefact was in force then; 0: none yet
    bool failed = false;                ///< that check failed; another artefact does not undo it, a passed check does
    FixedString<160> note;              ///< ... because
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

/// May a slab begin? Not when the calibration is missing, has expired or failed its last check.
enum class CalibrationFault : std::uint8_t { none, missing, expired, check_failed };
[[nodiscard]] CalibrationFault fault_of(const LineCalibration& calibration, std::int64_t utime_us);
/// One sentence: what is wrong and what to do; empty for none.
[[nodiscard]] FixedString<limits::kErrorTextBytes> describe(CalibrationFault fault, const LineCalibration& calibration);

/// WARN (IR 8), beside the bits of PlcWarn (base/plc.h).
enum CalibrationWarn : std::uint16_t {
  kWarnCheckOverdue = 1U << 8U,
  kWarnStationsNotCorrected = 1U << 9U,
  kWarnScannerNotVerified = 1U << 10U,
};

/// Does anything vouch for the scanner? Never a reason to stop: a line that never used an acceptance goes on.
enum class ScannerStanding : std::uint8_t { verified, never, expired, failed };
/// "verified", "never", "expired", "failed".
[[nodiscard]] std::string_view name(ScannerStanding standing);
[[nodiscard]] ScannerStanding standing_of(const ScannerInForce& scanner, std::int64_t utime_us);

/// What the next check is counted from: the last one, or the artefact's first day. Taking an artefact into use is no
/// check: once there was one, only the next one moves what is due.
[[nodiscard]] std::int64_t checked_from_utime_us(const LineCalibration::Watch& watch);
/// Is a check due? `interval_us` 0: never. True from the moment an artefact is in force for longer than the interval
/// without a check; and after a check that bears a time more than an hour ahead, made while the clock was wrong.
[[nodiscard]] bool overdue(const LineCalibration::Watch& watch, std::int64_t interval_us, std::int64_t utime_us);

// ---- splicing one scan
// -----------------------------------------------------------------------------------------------

/// What is assumed of the robot, from the configuration.
struct SpliceSettings {
  double gate_mm = 1.0;                  ///< of the reported pose from the mastered one, position and ...
  double gate_rad = rad_from_deg(0.05);  ///< ... rotation; beyond it the correction does not hold
  double absolute_mm = kNoValue;         ///< the robot's absolute accuracy, per axis, where nothing corrects it
  double absolute_rad = kNoValue;
  double repeatability_mm = 0.0;  ///< its repeatability, with commissioning values
  double repeatability_rad = 0.0;
  double commissioning_mm = kNoValue;  ///< the configuration's word for a station's splice
  double commissioning_rad = kNoValue;
};

/// What a scan was spliced with. All but `corrected` use the hand-eye alone: the last four say why.
enum class SpliceSource : std::uint8_t {
  none,           ///< nothing is known: zeroed memory
  commissioning,  ///< the configuration's values and its word for their uncertainty
  corrected,      ///< hand-eye and the station's correction
  not_mastered,   ///< this station of this slab type has no correction
  stale,          ///< the corrections were solved with another hand-eye calibration
  expired,        ///< the corrections are too old
  outside_gate,   ///< the robot stands elsewhere than when the station was mastered
};
inline constexpr std::size_t kSpliceSources = 7;
[[nodiscard]] std::string_view name(SpliceSource source);

/// How one station's scan was brought into the base frame, and how well that is known at the block.
struct Splice {
  SpliceSource source = SpliceSource::none;
  std::uint8_t visits = 0;   ///< corrected: M
  Pose T_base_reported;      ///< the correction used; identity without one
  double off_mm = kNoValue;  ///< reported pose from the mastered one, where there is one
  double off_rad = kNoValue;
  double calibration_mm = kNoValue;  ///< corrected: sigma / sqrt(M); else of the hand-eye
  double calibration_rad = kNoValue;
  double robot_mm = kNoValue;  ///< corrected: sigma of one visit; else absolute accuracy, or repeatability
  double robot_rad = kNoValue;
};
/// `lever_mm`: from the flange to the block; a flange turned by its absolute error shifts the block by so much more.
[[nodiscard]] Splice splice_for(const LineCalibration& calibration, const SpliceSettings& settings,
                                std::uint16_t slab_type, int station, const Pose& T_base_flange, double lever_mm,
                                std::int64_t utime_us);

/// The newest time of day that records vouch for (us since 1970). Calibrations expire by it where the clock is behind,
/// so it may not follow every clock: one that was ahead by a year for a minute would let them all expire for good. A
/// time more than a day ahead counts only when another one an hour later follows and none comes from before the jump;
/// the first of all counts at once.
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
  std::int64_t jumped_ = 0;  ///< first of the times far ahead, 0: none
};

}  // namespace slabd
