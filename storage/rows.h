// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <concepts>
#include <cstdint>
#include <string_view>
#include <type_traits>

#include "base/base.h"
#include "base/jobs.h"
#include "storage/row_visitors.h"

/// How the project's structs become rows. Each struct is described once, by `columns(visitor, struct)`: a list of
/// column names and members. The same list makes the INSERT, the SELECT, the binding and the reading, so the four
/// cannot drift apart; a list that does not match schema.sql fails when the statements are prepared.
namespace slabd::storage {

template <typename R, typename T>
concept RowOf = std::same_as<std::remove_const_t<R>, T>;

// ---- parts of rows that exist only here --------------------------------------------------------------------------

struct BlockKey {
  std::int64_t slab_key = 0;
  std::uint8_t station = 0;  ///< 0: of the slab itself
  std::uint8_t attempt = 0;
};
struct SlabKey {
  std::int64_t slab_key = 0;
};
struct FeatureName {
  FixedString<16> feature;
};
struct FindingPosition {
  std::uint8_t position = 0;
};
struct EdgePosition {
  std::uint8_t position = 0;
};
struct ItemPosition {
  std::uint8_t position = 0;
};
enum class ScanState : std::uint8_t { none, kept, deleting, deleted };
struct AttemptState {
  StationPhase phase = StationPhase::acquired;
  std::uint16_t code = 0;
  std::int64_t scan_bytes = 0;
  ScanState scan_state = ScanState::none;
  std::int64_t measuring_since_ns = 0;
};
struct SlabEnd {
  std::int64_t ended_utime_us = 0;
};
struct StationResult {
  std::uint8_t station = 0;
  Verdict verdict = Verdict::none;
  std::uint16_t reason = 0;
};
struct ResultState {
  bool is_repeat = false;
  bool acknowledged = false;
};
struct CommandState {
  std::uint16_t status = 0;
  bool acquired = false;
};

// ---- column lists ------------------------------------------------------------------------------------------------

template <typename V, RowOf<BlockKey> R>
void columns(V& v, R& r) {
  v("slab_key", r.slab_key);
  v("station", r.station);
  v("attempt", r.attempt);
}

template <typename V, RowOf<SlabKey> R>
void columns(V& v, R& r) {
  v("slab_key", r.slab_key);
}

template <typename V, RowOf<FeatureName> R>
void columns(V& v, R& r) {
  v("feature", r.feature);
}

template <typename V, RowOf<FindingPosition> R>
void columns(V& v, R& r) {
  v("position", r.position);
}

template <typename V, RowOf<EdgePosition> R>
void columns(V& v, R& r) {
  v("position", r.position);
}

template <typename V, RowOf<EdgeFeature> R>
void columns(V& v, R& r) {
  v("face", r.face);
  v("face_to", r.face_to);
  v("radius_mm", r.radius_mm);
  v("chamfer_mm", r.chamfer_mm);
  v("nominal_mm", r.nominal_mm);
  v("n", r.n);
}

template <typename V, RowOf<SurfaceFinding> R>
void columns(V& v, R& r) {
  v("kind", r.kind);
  v("face", r.face);
  v("x_mm", r.x_mm);
  v("s_mm", r.s_mm);
  v("z_mm", r.z_mm);
  v("length_mm", r.length_mm);
  v("width_mm", r.width_mm);
  v("depth_mm", r.depth_mm);
  v("area_mm2", r.area_mm2);
  v("volume_mm3", r.volume_mm3);
}

template <typename V, RowOf<ItemPosition> R>
void columns(V& v, R& r) {
  v("position", r.position);
}

template <typename V, RowOf<SlabHeader> R>
void columns(V& v, R& r) {
  v("slab_key", r.key);
  v("slab_id", r.slab_id);
  v("slab_no", r.slab_no);
  v("slab_type", r.slab_type);
  v("stations", r.stations);
  v("temperature_dk", r.temperature_dk);
  v("age_h", r.age_h);
  v("recipe", r.recipe);
  v("recipe_sha256", r.recipe_sha256);
  v("unconfirmed", r.unconfirmed);
  v("guard", r.guard);
  v("cell_mm", r.cell_mm);
  v("calibration_id", r.calibration_id);
  v("stations_id", r.stations_id);
  v("scanner_id", r.scanner_id);
  v("software", r.software);
  v("T_base_slab", r.T_base_slab);
  v("T_flange_scanner", r.T_flange_scanner);
  v("began_utime_us", r.began_utime_us);
  v("emulated", r.emulated);
}

template <typename V, RowOf<SlabEnd> R>
void columns(V& v, R& r) {
  v("ended_utime_us", r.ended_utime_us);
}

template <typename V, RowOf<SlabResult> R>
void columns(V& v, R& r) {
  v("verdict", r.verdict);
  v("reason", r.reason);
  v("fit_ok", r.fit.ok);
  v("fit_seats", r.fit.seats);
  v("fit_iterations", r.fit.iterations);
  v("fit_rms_mm", r.fit.rms_mm);
  v("fit_plain_rms_mm", r.fit.plain_rms_mm);
  v("fit_T_base_slab", r.fit.T_base_slab);
  v("fit_note", r.fit.note);
}

template <typename V, RowOf<StationResult> R>
void columns(V& v, R& r) {
  v("station", r.station);
  v("verdict", r.verdict);
  v("reason", r.reason);
}

template <typename V, RowOf<CommandJob> R>
void columns(V& v, R& r) {
  v("session", r.session);
  v("cmd_seq", r.cmd_seq);
  v("command", r.command);
  v("station", r.station);
  v("utime_us", r.utime_us);
}

template <typename V, RowOf<CommandState> R>
void columns(V& v, R& r) {
  v("status", r.status);
  v("acquired", r.acquired);
}

template <typename V, RowOf<Splice> R>
void columns(V& v, R& r) {
  v("splice", r.source);
  v("splice_visits", r.visits);
  v("T_base_reported", r.T_base_reported);
  v("splice_off_mm", r.off_mm);
  v("splice_off_rad", r.off_rad);
  v("splice_calibration_mm", r.calibration_mm);
  v("splice_calibration_rad", r.calibration_rad);
  v("splice_robot_mm", r.robot_mm);
  v("splice_robot_rad", r.robot_rad);
}

template <typename V, RowOf<Attempt> R>
void columns(V& v, R& r) {
  v("slab_key", r.slab_key);
  v("station", r.station);
  v("attempt", r.number);
  v("session", r.session);
  v("cmd_seq", r.cmd_seq);
  v("T_base_flange", r.T_base_flange);
  v("pose_spread_mm", r.pose_spread_mm);
  v("pose_samples", r.pose_samples);
  v("scan_path", r.scan_path);
  v("scan_points", r.shape.points);
  v("scan_finite", r.shape.finite);
  v("scan_width", r.shape.width);
  v("scan_height", r.shape.height);
  v("scan_utime_us", r.scan_utime_us);
  v("settle_ms", r.settle_ms);
  v("acquire_ms", r.acquire_ms);
  columns(v, r.splice);
  v("points_crc32c", r.points_crc32c);
  v("asked", r.asked);
  v("emulated", r.emulated);
  v("fingerprint", r.fingerprint);
}

template <typename V, RowOf<AttemptState> R>
void columns(V& v, R& r) {
  v("phase", r.phase);
  v("code", r.code);
  v("scan_bytes", r.scan_bytes);
  v("scan_state", r.scan_state);
  v("measuring_since_ns", r.measuring_since_ns);
}

/// What a block has beside its planes, casings, findings, edges and items.
template <typename V, RowOf<BlockResult> R>
void columns(V& v, R& r) {
  v("verdict", r.verdict);
  v("reason", r.reason);
  v("points_read", r.scan.points_read);
  v("points_finite", r.scan.points_finite);
  v("isolated_removed", r.scan.isolated_removed);
  v("points_kept", r.scan.points_kept);
  v("registration_status", r.registration.status);
  v("registration_iterations", r.registration.iterations);
  v("share_associated", r.registration.share_associated);
  v("condition", r.registration.condition);
  v("registration_note", r.registration.note);
  v("T_scanner_block", r.registration.T_scanner_block);
  v("deviation_count", r.registration.deviation.count);
  v("deviation_mean_mm", r.registration.deviation.mean_mm);
  v("deviation_std_mm", r.registration.deviation.std_mm);
  v("within_sigma", r.registration.deviation.within_sigma);
  v("seat_normal", r.seat.normal_datum);
  v("seat_grid_points", r.seat.grid_points);
  v("seat_std_cells_mm", r.seat.std_cells_mm);
  v("seat_flatness_mm", r.seat.flatness_mm);
  v("seat_flatness_min_zone_mm", r.seat.flatness_min_zone_mm);
  v("seat_raw_low_mm", r.seat.raw_low_mm);
  v("seat_raw_high_mm", r.seat.raw_high_mm);
  v("observation_ok", r.observation.ok);
  v("observation_jaw_ok", r.observation.jaw_ok);
  v("observation_top_ok", r.observation.top_ok);
  v("p_base", r.observation.p_base);
  v("n_base", r.observation.n_base);
  v("jaw_outer_base", r.observation.jaw_outer_base);
  v("top_n_base", r.observation.top_n_base);
  v("read_ms", r.times.read_ms);
  v("denoise_ms", r.times.denoise_ms);
  v("register_ms", r.times.register_ms);
  v("extract_ms", r.times.extract_ms);
  v("total_ms", r.times.total_ms);
  v("registration_noise_mm", r.registration.noise_mm);
  v("registration_cov", r.registration.covariance);
  v("seat_noise_factor", r.seat.noise_factor);
  v("seat_flatness_noise_mm", r.seat.flatness_noise_mm);
  v("defect_limit_mm", r.seat.defect.limit_mm);
  v("defect_cells", r.seat.defect.cells);
  v("defect_area_mm2", r.seat.defect.area_mm2);
  v("defect_height_mm", r.seat.defect.height_mm);
  v("defect_x_mm", r.seat.defect.x_mm);
  v("defect_s_mm", r.seat.defect.s_mm);
  v("seat_flatness_closed_mm", r.seat.flatness_closed_mm);
  v("seat_flatness_raw_mm", r.seat.flatness_raw_mm);
  v("seat_flatness_trimmed_mm", r.seat.flatness_trimmed_mm);
  v("pores", r.pores.count);
  v("pores_largest_mm", r.pores.largest_mm);
  v("pores_deepest_mm", r.pores.deepest_mm);
  v("pores_share", r.pores.share);
  v("pores_depth_max_mm", r.pores.limits.depth_max_mm);
  v("pores_share_max", r.pores.limits.share_max);
  v("sigma_p", r.observation.sigma_p_mm);
  v("sigma_jaw", r.observation.sigma_jaw_mm);
  v("sigma_n", r.observation.sigma_n_rad);
  v("sigma_top_n", r.observation.sigma_top_n_rad);
  v("step", r.scan.step_mm);
}

template <typename V, RowOf<PlaneFit> R>
void columns(V& v, R& r) {
  v("ok", r.ok);
  v("doubt", r.doubt);
  v("normal", r.normal);
  v("offset_mm", r.offset_mm);
  v("points", r.points);
  v("inliers", r.inliers);
  v("inlier_fraction", r.inlier_fraction);
  v("std_mm", r.std_mm);
  v("iterations", r.iterations);
  v("centroid", r.centroid);
  v("sigma_offset_mm", r.sigma_offset_mm);
  v("cov_normal", r.cov_normal);
}

template <typename V, RowOf<CasingFeature> R>
void columns(V& v, R& r) {
  v("ok", r.ok);
  v("doubt", r.doubt);
  v("centre", r.centre);
  v("radius_mm", r.radius_mm);
  v("height_mm", r.height_mm);
  v("edge_points", r.edge_points);
  v("rim_points", r.rim_points);
  v("edge_rms_mm", r.edge_rms_mm);
  v("inlier_fraction", r.inlier_fraction);
  v("rim_std_mm", r.rim_std_mm);
  v("sigma_height_mm", r.sigma_height_mm);
  v("cov_circle", r.cov_circle);
}

/// By BudgetPart.
inline constexpr std::array<std::string_view, kBudgetParts> kBudgetColumns = {
    "budget_fit",         "budget_noise", "budget_scanner",  "budget_registration",
    "budget_calibration", "budget_robot", "budget_reference"};

template <typename V, RowOf<Item> R>
void columns(V& v, R& r) {
  v("id", r.id);
  v("verdict", r.verdict);
  v("required", r.required);
  v("from_station", r.station);
  v("to_station", r.station_to);
  v("value", r.value);
  v("nominal", r.nominal);
  v("lower", r.lower);
  v("upper", r.upper);
  v("U", r.U);
  v("beside", r.beside);
  for (std::size_t part = 0; part < kBudgetParts; ++part) v(kBudgetColumns[part], r.budget[part]);
}

template <typename V, RowOf<PackedMap> R>
void columns(V& v, R& r) {
  v("columns", r.columns);
  v("rows", r.rows);
  v("cell_mm", r.cell_mm);
  v("step_mm", r.step_mm);
  v("bytes", r.bytes);
}

template <typename V, RowOf<ResultState> R>
void columns(V& v, R& r) {
  v("is_repeat", r.is_repeat);
  v("acknowledged", r.acknowledged);
}

template <typename V, RowOf<PlcResult> R>
void columns(V& v, R& r) {
  v("res_seq", r.res_seq);
  v("kind", r.kind);
  v("cmd_seq", r.cmd_seq);
  v("station", r.station);
  v("slab_no", r.slab_no);
  v("verdict", r.verdict);
  v("reason", r.reason);
  v("fail_mask", r.fail_mask);
  v("open_mask", r.open_mask);
  v("flatness_mm", r.flatness_mm);
  v("std_mm", r.std_mm);
  v("deviation", r.deviation);
  v("points", r.points);
  v("scan_utime_us", r.scan_utime_us);
  v("emulated", r.emulated);
}

}  // namespace slabd::storage
