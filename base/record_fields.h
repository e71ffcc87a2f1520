// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "base/base.h"
#include "base/fields.h"
#include "base/jobs.h"

/// Field lists of the records that pass between the rooms, with the order and names of the JSON documents. Meaning and
/// unit of a field are documented at the member. Nested records are omitted; they have lists of their own.
namespace slabd {

// ---- one block ---------------------------------------------------------------------------------------------------

SLABD_FIELDS(ScanCounts, points_read, points_finite, isolated_removed, points_kept, step_mm, lag_ratio);
SLABD_FIELDS(DeviationStats, count, mean_mm, std_mm, within_sigma);
SLABD_FIELDS(RegistrationReport, status, iterations, share_associated, condition, note, T_scanner_block, noise_mm,
             covariance);
SLABD_FIELDS(SurfaceDefect, limit_mm, cells, area_mm2, height_mm, x_mm, s_mm);
SLABD_FIELDS(EdgeFeature, face, face_to, radius_mm, chamfer_mm, nominal_mm, n);
SLABD_FIELDS(SurfaceFinding, kind, face, x_mm, s_mm, z_mm, length_mm, width_mm, depth_mm, area_mm2, volume_mm3);
SLABD_FIELDS(PoreLimits, depth_max_mm, share_max);
SLABD_FIELDS(SeatObservation, ok, jaw_ok, top_ok, p_base, n_base, jaw_outer_base, top_n_base, sigma_p_mm, sigma_jaw_mm,
             sigma_n_rad, sigma_top_n_rad);
SLABD_FIELDS(StageTimes, read_ms, denoise_ms, register_ms, extract_ms, total_ms);
SLABD_FIELDS(PackedMap, columns, rows, cell_mm, step_mm, bytes);

template <typename V, RecordOf<PlaneFit> R>
void fields(V& v, R& r) {
  SLABD_EACH(r, ok, doubt, normal, offset_mm, points, inliers, inlier_fraction, std_mm, iterations)
  v("centroid_mm", r.centroid);
  SLABD_EACH(r, sigma_offset_mm, cov_normal)
}

template <typename V, RecordOf<CasingFeature> R>
void fields(V& v, R& r) {
  SLABD_EACH(r, ok, doubt)
  v("centre_mm", r.centre);
  SLABD_EACH(r, radius_mm, height_mm, edge_points, rim_points, inlier_fraction, edge_rms_mm, rim_std_mm,
             sigma_height_mm, cov_circle)
}

template <typename V, RecordOf<SeatFeature> R>
void fields(V& v, R& r) {
  v("normal", r.normal_datum);
  SLABD_EACH(r, grid_points, std_cells_mm, flatness_mm, flatness_closed_mm, flatness_raw_mm, flatness_trimmed_mm,
             flatness_min_zone_mm, raw_low_mm, raw_high_mm, flatness_noise_mm, noise_factor)
}

template <typename V, RecordOf<PoreSummary> R>
void fields(V& v, R& r) {
  SLABD_EACH(r, count, largest_mm, deepest_mm, share)
  fields(v, r.limits);
}

// ---- gauges ------------------------------------------------------------------------------------------------------

SLABD_FIELDS(GaugeReading, gauge, source, unit, state, value, u, u_master, seq, slab_no, utime_us, age_s,
             check_utime_us, check_deviation);
SLABD_FIELDS(GaugeCheck, gauge, unit, value, master_value, master_u, within, passed, utime_us, source);

// ---- one slab ----------------------------------------------------------------------------------------------------

SLABD_FIELDS(SlabHeader, key, slab_id, slab_no, slab_type, stations, temperature_dk, age_h, mould, recipe,
             recipe_sha256, design_sha256, design_text, unconfirmed, guard, cell_mm, calibration_id, stations_id,
             scanner_id, software, T_base_slab, T_flange_scanner, began_utime_us, emulated, tie_id);
SLABD_FIELDS(SlabFitReport, ok, seats, iterations, rms_mm, plain_rms_mm, note, T_base_slab);
SLABD_FIELDS(Splice, source, visits, T_base_reported, off_mm, off_rad, calibration_mm, calibration_rad, robot_mm,
             robot_rad, tied, T_base_robot);
SLABD_FIELDS(CommandJob, session, cmd_seq, command, station, utime_us);
SLABD_FIELDS(PlcResult, res_seq, kind, cmd_seq, station, slab_no, verdict, reason, fail_mask, open_mask, flatness_mm,
             std_mm, deviation, points, scan_utime_us, emulated);

// ---- calibration -------------------------------------------------------------------------------------------------

SLABD_FIELDS(HandEyeNumbers, T_flange_scanner, sigma_mm, sigma_rad);
SLABD_FIELDS(StationCorrection, visits, T_base_reported, T_base_flange, sigma_mm, sigma_rad, spread_mm);
SLABD_FIELDS(ReferenceBlock, slope_rad, slope_U_rad, jaw_distance_mm, jaw_distance_U_mm);
SLABD_FIELDS(MonitorBall, p_base, radius_mm, limit_mm);
SLABD_FIELDS(ScannerNumbers, scanner, PF_mm, PS_mm, RF_mm, form_half_mm, form_length_mm, noise_sigma_mm,
             noise_correlation_mm, pitch_mm, plates, balls, within_limits, temperature_c);
SLABD_FIELDS(TieNumbers, robot, T_base_robot, centre_mm, covariance, targets, rms_mm);
SLABD_FIELDS(CalibrationCheck, kind, reference_id, hand_eye_id, passed, slope_rad, slope_U_rad, jaw_distance_mm,
             jaw_distance_U_mm, off_mm, utime_us, who, source, note);

}  // namespace slabd
