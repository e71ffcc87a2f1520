// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "base/record_fields.h"
#include "storage/row_visitors.h"

/// How the project's structs become rows. `columns(visitor, struct)` lists column names and members. It walks the field
/// list of the struct (base/record_fields.h); only structs whose columns have other names have a list of their own
/// here. The same list makes the INSERT, the SELECT, the binding and the reading, so the four cannot drift apart; a
/// list that does not match schema.sql fails when the statements are prepared.
namespace slabd::storage {

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
/// Of a finding, an edge or an item among those of its block.
struct Position {
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
SLABD_FIELDS(BlockKey, slab_key, station, attempt);
SLABD_FIELDS(SlabKey, slab_key);
SLABD_FIELDS(FeatureName, feature);
SLABD_FIELDS(Position, position);
SLABD_FIELDS(AttemptState, phase, code, scan_bytes, scan_state, measuring_since_ns);
SLABD_FIELDS(SlabEnd, ended_utime_us);
SLABD_FIELDS(StationResult, station, verdict, reason);
SLABD_FIELDS(ResultState, is_repeat, acknowledged);
SLABD_FIELDS(CommandState, status, acquired);

// ---- column lists ------------------------------------------------------------------------------------------------

template <typename V, typename R>
void columns(V& v, R& r) {
  fields(v, r);
}

template <typename V, RecordOf<SlabHeader> R>
void columns(V& v, R& r) {
  part(v, r, "", {{"key", "slab_key"}});
}

template <typename V, RecordOf<SlabResult> R>
void columns(V& v, R& r) {
  SLABD_EACH(r, verdict, reason)
  part(v, r.fit, "fit_");
}

template <typename V, RecordOf<Attempt> R>
void columns(V& v, R& r) {
  SLABD_EACH(r, slab_key, station)
  v("attempt", r.number);
  SLABD_EACH(r, session, cmd_seq, T_base_flange, pose_spread_mm, pose_samples, scan_path)
  v("scan_points", r.shape.points);
  v("scan_finite", r.shape.finite);
  v("scan_width", r.shape.width);
  v("scan_height", r.shape.height);
  SLABD_EACH(r, scan_utime_us, settle_ms, acquire_ms)
  part(v, r.splice, "splice_", {{"source", "splice"}, {"T_base_reported", "T_base_reported"}});
  SLABD_EACH(r, points_crc32c, asked, emulated, fingerprint)
}

/// What a block has beside its planes, casings, findings, edges and items.
template <typename V, RecordOf<BlockResult> R>
void columns(V& v, R& r) {
  SLABD_EACH(r, verdict, reason)
  part(v, r.scan);
  part(v, r.registration, "registration_",
       {{"share_associated", "share_associated"},
        {"condition", "condition"},
        {"T_scanner_block", "T_scanner_block"},
        {"covariance", "registration_cov"}});
  part(v, r.registration.deviation, "deviation_", {{"within_sigma", "within_sigma"}});
  part(v, r.seat, "seat_");
  part(v, r.seat.defect, "defect_");
  part(v, r.pores, "pores_", {{"count", "pores"}});
  part(v, r.observation, "",
       {{"ok", "observation_ok"}, {"jaw_ok", "observation_jaw_ok"}, {"top_ok", "observation_top_ok"}});
  part(v, r.times);
}

/// By BudgetPart.
inline constexpr std::array<std::string_view, kBudgetParts> kBudgetColumns = {
    "budget_fit",         "budget_noise", "budget_scanner",  "budget_registration",
    "budget_calibration", "budget_robot", "budget_reference"};

template <typename V, RecordOf<Item> R>
void columns(V& v, R& r) {
  SLABD_EACH(r, id, verdict, required)
  v("from_station", r.station);
  v("to_station", r.station_to);
  SLABD_EACH(r, value, nominal, lower, upper, U, beside)
  for (std::size_t part = 0; part < kBudgetParts; ++part) v(kBudgetColumns[part], r.budget[part]);
}

}  // namespace slabd::storage
