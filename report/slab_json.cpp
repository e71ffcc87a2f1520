// SPDX-License-Identifier: Apache-2.0
#include "report/slab_json.h"

#include "report/figures.h"
#include "report/json.h"
#include "report/slab_view.h"

namespace slabd::cli {
namespace {

using storage::SlabBlock;
using storage::SlabRecord;

/// What the scan was spliced with, and what that is worth at the block (k = 1).
void write_splice(Json& json, const Splice& splice) {
  json.key("splice").begin_object();
  json.field("source", name(splice.source)).field("visits", unsigned{splice.visits});
  if (splice.source == SpliceSource::corrected) write_pose(json, "T_base_reported", splice.T_base_reported);
  json.field("off_mm", splice.off_mm).field("off_deg", deg_from_rad(splice.off_rad));
  json.field("calibration_mm", splice.calibration_mm).field("calibration_deg", deg_from_rad(splice.calibration_rad));
  json.field("robot_mm", splice.robot_mm).field("robot_deg", deg_from_rad(splice.robot_rad));
  json.end_object();
}

void write_attempt(Json& json, const SlabRecord& record, const SlabBlock& block) {
  json.begin_object();
  json.field("station", unsigned{block.attempt.station}).field("attempt", unsigned{block.attempt.number});
  json.field("valid", latest(record, block.attempt.station) == &block);
  json.field("final_verdict", name(block.final_verdict)).field("final_reason", block.final_reason);
  json.field("code", block.code);
  json.field("scan_path", block.attempt.scan_path.view()).field("points", block.attempt.shape.points);
  write_crc32c(json, "points_crc32c", block.attempt.points_crc32c);
  write_time(json, "scanned", block.attempt.scan_utime_us);
  json.field("settle_ms", block.attempt.settle_ms).field("acquire_ms", block.attempt.acquire_ms);
  write_pose(json, "T_base_flange", block.attempt.T_base_flange);
  json.field("pose_samples", block.attempt.pose_samples).field("pose_spread_mm", block.attempt.pose_spread_mm);
  write_splice(json, block.attempt.splice);
  write_emulation(json, block.attempt.emulated);
  if (block.phase == StationPhase::measured) {
    json.key("result").begin_object();
    write_block(json, block.block, record.summary.header.cell_mm);
    json.end_object();
  }
  json.end_object();
}

}  // namespace

std::string slab_json(const SlabRecord& record, int only_block) {
  const SlabHeader& header = record.summary.header;
  Json json;
  json.begin_object();
  json.field("schema", "slabd.slab/1").field("key", header.key).field("slab_id", header.slab_id.view());
  json.field("slab_no", header.slab_no).field("slab_type", header.slab_type);
  json.field("verdict", name(record.summary.verdict)).field("reason", record.summary.reason);
  write_emulation(json, header.emulated);
  write_time(json, "began", header.began_utime_us);
  write_time(json, "ended", record.summary.ended_utime_us);
  json.field("acknowledged", record.summary.acknowledged).field("recipe", header.recipe.view());
  json.field("recipe_sha256", header.recipe_sha256.view()).field("calibration_id", header.calibration_id.view());
  json.field("stations_id", header.stations_id.view()).field("scanner_id", header.scanner_id.view());
  json.field("unconfirmed", header.unconfirmed).field("guard", header.guard).field("cell_mm", header.cell_mm);
  json.field("software", header.software.view()).field("stations", unsigned{header.stations});
  json.field("stations_measured", record.summary.stations_measured);
  json.field("slab_temperature_k", header.temperature_dk == 0 ? kNoValue : header.temperature_dk / 10.0);
  json.key("slab_age_h");
  header.age_h == 0 ? json.null() : json.value(header.age_h);
  json.key("slope_datum");
  const std::string_view datum = slope_datum(record);
  datum.empty() ? json.null() : json.value(datum);
  write_pose(json, "T_flange_scanner", header.T_flange_scanner);

  const SlabFitReport& fit = record.slab.fit;
  json.key("slab_fit").begin_object();
  json.field("ok", fit.ok).field("seats", unsigned{fit.seats}).field("iterations", fit.iterations);
  json.field("rms_mm", fit.rms_mm).field("plain_rms_mm", fit.plain_rms_mm).field("note", fit.note.view());
  write_pose(json, "T_base_slab", fit.T_base_slab);
  json.end_object();

  json.key("station_verdicts").begin_array();
  for (int station = 1; station <= header.stations; ++station) {
    const auto [verdict, reason] = shown(record, station);
    json.begin_object();
    json.field("station", station).field("verdict", name(verdict)).field("reason", reason).end_object();
  }
  json.end_array();
  json.key("items").begin_array();
  for (const Item& item : record.slab.items) write_item(json, item, true);
  json.end_array();
  json.key("blocks").begin_array();
  for (const SlabBlock& block : record.blocks)
    if (only_block == 0 || block.attempt.station == only_block) write_attempt(json, record, block);
  json.end_array();
  json.field("not_visible", kNotVisible);
  json.end_object();
  return json.text();
}

}  // namespace slabd::cli
