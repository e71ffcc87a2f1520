// SPDX-License-Identifier: Apache-2.0
#include "base/calibration.h"

#include <cmath>

namespace slabd {
namespace {

constexpr std::array<std::string_view, kCalibrationKinds> kKinds = {"hand_eye",     "stations", "reference_block",
                                                                    "monitor_ball", "scanner",  "tie"};
constexpr std::array<std::string_view, 5> kStandings = {"verified", "never", "expired", "failed", "other_temperature"};
constexpr std::array<std::string_view, kSpliceSources> kSources = {
    "none", "commissioning", "corrected", "not_mastered", "stale", "expired", "outside_gate"};

bool is_over(std::int64_t expires_utime_us, std::int64_t utime_us) {
  return expires_utime_us != 0 && utime_us >= expires_utime_us;
}

/// Reason why the station's correction does not apply, or `corrected`. Sets the distance to the mastered pose if the
/// station was mastered.
SpliceSource judge_correction(const LineCalibration& calibration, const StationsInForce* table, int station,
                              const SpliceSettings& settings, const Pose& T_base_flange, std::int64_t utime_us,
                              Splice& splice) {
  if (table == nullptr) return SpliceSource::not_mastered;
  const StationCorrection& correction = table->table.station[static_cast<std::size_t>(station - 1)];
  if (correction.visits == 0) return SpliceSource::not_mastered;
  splice.off_mm = (T_base_flange.translation_mm - correction.T_base_flange.translation_mm).norm();
  splice.off_rad = angle_between_rad(correction.T_base_flange.rotation, T_base_flange.rotation);
  if (!(table->hand_eye_id == calibration.id)) return SpliceSource::stale;
  if (is_over(table->expires_utime_us, utime_us)) return SpliceSource::expired;
  const bool near = splice.off_mm <= settings.gate_mm && splice.off_rad <= settings.gate_rad;
  return near ? SpliceSource::corrected : SpliceSource::outside_gate;
}

}  // namespace

std::string_view name(CalibrationKind kind) {
  return kKinds.at(static_cast<std::size_t>(kind));
}

std::optional<CalibrationKind> calibration_kind_named(std::string_view word) {
  for (std::size_t i = 0; i < kKinds.size(); ++i)
    if (kKinds[i] == word) return static_cast<CalibrationKind>(i);
  return std::nullopt;
}

std::string_view name(SpliceSource source) {
  return kSources.at(static_cast<std::size_t>(source));
}

std::string_view name(AcceptanceState standing) {
  return kStandings.at(static_cast<std::size_t>(standing));
}

double scanner_drift(const ScannerDriftSettings& settings, const ScannerNumbers& accepted, double temperature_c) {
  return settings.per_K * std::abs(temperature_c - accepted.temperature_c);
}

bool is_outside_temperature(const ScannerDriftSettings& settings, const ScannerNumbers& accepted,
                            double temperature_c) {
  return std::abs(temperature_c - accepted.temperature_c) > settings.range_K;
}

AcceptanceState acceptance_state(const ScannerInForce& scanner, std::int64_t utime_us, bool outside) {
  if (scanner.id.empty()) return AcceptanceState::never;
  if (scanner.failed || !scanner.numbers.within_limits) return AcceptanceState::failed;
  if (is_over(scanner.expires_utime_us, utime_us)) return AcceptanceState::expired;
  return outside ? AcceptanceState::other_temperature : AcceptanceState::verified;
}

FixedString<limits::kErrorTextBytes> refusal_of(const ScannerNumbers& n) {
  FixedString<limits::kErrorTextBytes> text;
  if (n.plates == 0 || n.balls == 0) {
    text.printf("no scan of a %s was measured, an acceptance needs plate and ball", n.plates == 0 ? "plate" : "ball");
  } else if (n.plates < kPlatePlacesMin || n.balls < kBallPlacesMin) {
    text.printf("the plate was measured in %u places and the ball in %u, VDI/VDE 2634-2 requires %u and %u", n.plates,
                n.balls, kPlatePlacesMin, kBallPlacesMin);
  } else if (!std::isfinite(n.form_half_mm) || !std::isfinite(n.form_length_mm) || !(n.form_length_mm > 0.0) ||
             !std::isfinite(n.PS_mm) || !std::isfinite(n.PF_mm) || !std::isfinite(n.RF_mm)) {
    text.printf("its figures are not all known");
  } else if (!n.within_limits) {
    text.printf("its figures are out of the limits they were given");
  }
  return text;
}

CalibrationFault fault_of(const LineCalibration& calibration, std::int64_t utime_us) {
  if (calibration.source == LineCalibration::Source::missing) return CalibrationFault::missing;
  if (calibration.source == LineCalibration::Source::applied && is_over(calibration.expires_utime_us, utime_us))
    return CalibrationFault::expired;
  return calibration.block.failed || calibration.ball.failed ? CalibrationFault::check_failed : CalibrationFault::none;
}

FixedString<limits::kErrorTextBytes> describe(CalibrationFault fault, const LineCalibration& calibration) {
  FixedString<limits::kErrorTextBytes> text;
  switch (fault) {
    case CalibrationFault::none: break;
    case CalibrationFault::missing:
      text.printf("no usable calibration: %s; calibrate and apply one (slabctl calibrate)",
                  calibration.trouble.empty() ? "none is applied and the configuration has no commissioning values"
                                              : calibration.trouble.c_str());
      break;
    case CalibrationFault::expired:
      text.printf("calibration %s has expired; calibrate again and apply the result (slabctl calibrate)",
                  calibration.id.c_str());
      break;
    case CalibrationFault::check_failed: {
      const bool block = calibration.block.failed;
      text.printf("the last check of the %s failed: %s; find the cause, then check again (slabctl calibrate check)",
                  block ? "reference block" : "monitor ball",
                  block ? calibration.block.note.c_str() : calibration.ball.note.c_str());
      break;
    }
  }
  return text;
}

CalibrationId tie_parent(const CalibrationId& first, const CalibrationId& second) {
  CalibrationId parent = first;
  parent.append("+");
  parent.append(second.view());
  return parent;
}

std::optional<std::array<CalibrationId, limits::kArmsMax>> hand_eyes_of_tie(std::string_view parent) {
  const std::size_t plus = parent.find('+');
  if (plus == std::string_view::npos || plus == 0 || plus + 1 == parent.size()) return std::nullopt;
  if (parent.find('+', plus + 1) != std::string_view::npos) return std::nullopt;
  return std::array<CalibrationId, limits::kArmsMax>{parent.substr(0, plus), parent.substr(plus + 1)};
}

TieFault fault_of_tie(const CellCalibration& calibration, const PartId& robot, std::int64_t utime_us) {
  const TieInForce& tie = calibration.tie;
  if (!tie.trouble.empty()) return TieFault::unusable;
  if (tie.id.empty()) return TieFault::missing;
  for (std::size_t arm = 0; arm < limits::kArmsMax; ++arm)
    if (!(tie.hand_eye_id[arm] == calibration.arm[arm].id)) return TieFault::stale;
  if (!(tie.numbers.robot == robot)) return TieFault::stale;
  return is_over(tie.expires_utime_us, utime_us) ? TieFault::expired : TieFault::none;
}

FixedString<limits::kErrorTextBytes> describe(TieFault fault, const CellCalibration& calibration) {
  FixedString<limits::kErrorTextBytes> text;
  const TieInForce& tie = calibration.tie;
  switch (fault) {
    case TieFault::none: break;
    case TieFault::missing:
      text.printf("the base frames of the two robots are not tied; measure and apply a tie (slabctl calibrate tie)");
      break;
    case TieFault::unusable:
      text.printf("the tie of the two robots cannot be used: %s; tie again (slabctl calibrate tie)",
                  tie.trouble.c_str());
      break;
    case TieFault::stale:
      text.printf(
          "tie %s of the two robots belongs to robot %s and the hand-eye calibrations %s and %s, and others are "
          "in force; tie again (slabctl calibrate tie)",
          tie.id.c_str(), tie.numbers.robot.c_str(), tie.hand_eye_id[0].c_str(), tie.hand_eye_id[1].c_str());
      break;
    case TieFault::expired:
      text.printf("tie %s of the two robots has expired; tie again and apply the result (slabctl calibrate tie)",
                  tie.id.c_str());
      break;
  }
  return text;
}

std::int64_t checked_from_utime_us(const LineCalibration::Watch& watch) {
  return watch.checked_utime_us != 0 ? watch.checked_utime_us : watch.since_utime_us;
}

bool overdue(const LineCalibration::Watch& watch, std::int64_t interval_us, std::int64_t utime_us) {
  if (interval_us == 0 || watch.reference_id.empty()) return false;
  // A check in the future was made while the clock was wrong, so its true time is unknown. The hour tolerates clocks
  // that are set back a little.
  constexpr std::int64_t kAhead_us = 3'600'000'000;
  const std::int64_t since_us = utime_us - checked_from_utime_us(watch);
  return since_us > interval_us || since_us < -kAhead_us;
}

Splice splice_for(const LineCalibration& calibration, const SpliceSettings& settings, std::uint16_t slab_type,
                  int station, const Pose& T_base_flange, double lever_mm, std::int64_t utime_us) {
  Splice splice;
  if (calibration.source == LineCalibration::Source::missing) return splice;
  if (calibration.source == LineCalibration::Source::commissioning) {
    splice.source = SpliceSource::commissioning;
    splice.calibration_mm = settings.commissioning_mm;
    splice.calibration_rad = settings.commissioning_rad;
    splice.robot_mm = settings.repeatability_mm;
    splice.robot_rad = settings.repeatability_rad;
    return splice;
  }
  const StationsInForce* table = calibration.table_for(slab_type);
  splice.source = judge_correction(calibration, table, station, settings, T_base_flange, utime_us, splice);
  if (splice.source == SpliceSource::corrected) {
    const StationCorrection& correction = table->table.station[static_cast<std::size_t>(station - 1)];
    splice.visits = correction.visits;
    splice.T_base_reported = correction.T_base_reported;
    const double of_mean = 1.0 / std::sqrt(static_cast<double>(correction.visits));
    splice.calibration_mm = of_mean * correction.sigma_mm;
    splice.calibration_rad = of_mean * correction.sigma_rad;
    splice.robot_mm = correction.sigma_mm;
    splice.robot_rad = correction.sigma_rad;
    return splice;
  }
  // All stations share one hand-eye pose. Across the track its error counts twice because the two rows are scanned with
  // the flange turned by 180 degrees. The budget treats stations as independent; sqrt(2) corrects that.
  const double rows = std::sqrt(2.0);
  splice.calibration_mm = rows * calibration.hand_eye.sigma_mm;
  splice.calibration_rad = rows * calibration.hand_eye.sigma_rad;
  splice.robot_mm = std::hypot(settings.absolute_mm, settings.absolute_rad * lever_mm);
  splice.robot_rad = settings.absolute_rad;
  return splice;
}

Splice splice_for(const CellCalibration& calibration, std::size_t arm, const SpliceSettings& settings,
                  std::uint16_t slab_type, int station, const Pose& T_base_flange, double lever_mm,
                  std::int64_t utime_us) {
  if (arm > 0 && calibration.tie.id.empty()) return {};
  Splice splice = splice_for(calibration.arm.at(arm), settings, slab_type, station, T_base_flange, lever_mm, utime_us);
  if (arm > 0) {
    splice.tied = true;
    splice.T_base_robot = calibration.tie.numbers.T_base_robot;
  }
  return splice;
}

}  // namespace slabd
