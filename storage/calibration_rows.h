// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "storage/rows.h"
#include "storage/storage.h"

/// Columns of the calibration tables; see storage/rows.h.
namespace slabd::storage {

template <typename V, RowOf<HandEyeNumbers> R>
void columns(V& v, R& r) {
  v("T_flange_scanner", r.T_flange_scanner);
  v("sigma_mm", r.sigma_mm);
  v("sigma_rad", r.sigma_rad);
}

template <typename V, RowOf<StationCorrection> R>
void columns(V& v, R& r) {
  v("visits", r.visits);
  v("T_base_reported", r.T_base_reported);
  v("T_base_flange", r.T_base_flange);
  v("sigma_mm", r.sigma_mm);
  v("sigma_rad", r.sigma_rad);
  v("spread_mm", r.spread_mm);
}

template <typename V, RowOf<ReferenceBlock> R>
void columns(V& v, R& r) {
  v("slope_rad", r.slope_rad);
  v("slope_U_rad", r.slope_U_rad);
  v("jaw_distance_mm", r.jaw_distance_mm);
  v("jaw_distance_U_mm", r.jaw_distance_U_mm);
}

template <typename V, RowOf<MonitorBall> R>
void columns(V& v, R& r) {
  v("p_base", r.p_base);
  v("radius_mm", r.radius_mm);
  v("limit_mm", r.limit_mm);
}

template <typename V, RowOf<ScannerNumbers> R>
void columns(V& v, R& r) {
  v("scanner", r.scanner);
  v("PF_mm", r.PF_mm);
  v("PS_mm", r.PS_mm);
  v("RF_mm", r.RF_mm);
  v("form_half_mm", r.form_half_mm);
  v("form_length_mm", r.form_length_mm);
  v("noise_sigma_mm", r.noise_sigma_mm);
  v("noise_correlation_mm", r.noise_correlation_mm);
  v("pitch_mm", r.pitch_mm);
  v("plates", r.plates);
  v("balls", r.balls);
  v("within_limits", r.within_limits);
}

template <typename V, RowOf<CalibrationCheck> R>
void columns(V& v, R& r) {
  v("kind", r.kind);
  v("reference_id", r.reference_id);
  v("hand_eye_id", r.hand_eye_id);
  v("passed", r.passed);
  v("slope_rad", r.slope_rad);
  v("slope_U_rad", r.slope_U_rad);
  v("jaw_distance_mm", r.jaw_distance_mm);
  v("jaw_distance_U_mm", r.jaw_distance_U_mm);
  v("off", r.off_mm);
  v("utime_us", r.utime_us);
  v("who", r.who);
  v("source", r.source);
  v("note", r.note);
}

/// What a record has beside its numbers.
template <typename V, RowOf<CalibrationRecord> R>
void columns(V& v, R& r) {
  v("id", r.id);
  v("parent_id", r.parent_id);
  v("figures", r.figures);
  v("observations", r.observations);
  v("certificate", r.certificate);
  v("operator_name", r.operator_name);
  v("robot_serial", r.robot_serial);
  v("scanner_serial", r.scanner_serial);
  v("temperature_c", r.temperature_c);
  v("software", r.software);
  v("created_utime_us", r.created_utime_us);
  v("expires_utime_us", r.expires_utime_us);
}

/// Which calibration a row of numbers belongs to.
struct NumbersOf {
  std::string calibration_id;
};
template <typename V, RowOf<NumbersOf> R>
void columns(V& v, R& r) {
  v("calibration_id", r.calibration_id);
}
struct NumbersOfStation {
  std::string calibration_id;
  std::uint8_t station = 0;
};
template <typename V, RowOf<NumbersOfStation> R>
void columns(V& v, R& r) {
  v("calibration_id", r.calibration_id);
  v("station", r.station);
}

}  // namespace slabd::storage
