// SPDX-License-Identifier: Apache-2.0
#include "report/slab_json.h"

#include "base/record_fields.h"
#include "report/figures.h"
#include "report/json.h"
#include "report/slab_view.h"

namespace slabd::report {
namespace {

using storage::SlabBlock;
using storage::SlabRecord;

void write_attempt(Json& json, const SlabRecord& record, const SlabBlock& block) {
  const Attempt& attempt = block.attempt;
  json.field("station", attempt.station).field("attempt", attempt.number);
  json.field("robot", attempt.by.robot).field("scanner", attempt.by.scanner);
  json.field("valid", latest(record, attempt.station) == &block).field("final_verdict", block.final_verdict);
  json.field("final_reason", block.final_reason).field("code", block.code).field("scan_path", attempt.scan_path);
  json.field("points", attempt.shape.points).field("scanner_temperature_c", attempt.shape.scanner_temperature_c);
  json.field("scanner_drift", attempt.scanner_drift);
  write_crc32c(json, "points_crc32c", attempt.points_crc32c);
  write_time(json, "scanned", attempt.scan_utime_us);
  json.field("settle_ms", attempt.settle_ms).field("acquire_ms", attempt.acquire_ms);
  json.field("T_base_flange", attempt.T_base_flange).field("pose_samples", attempt.pose_samples);
  json.field("pose_spread_mm", attempt.pose_spread_mm).key("splice").begin_object();
  write_fields(json, attempt.splice, [&](std::string_view field) {
    if (field == "tied" || field == "T_base_robot") return attempt.splice.tied;
    return field != "T_base_reported" || attempt.splice.source == SpliceSource::corrected;
  });
  json.end_object();
  write_emulation(json, attempt.emulated);
  if (block.phase != StationPhase::measured) return;
  json.key("result").begin_object();
  write_block(json, block.block, record.summary.header.cell_mm);
  json.end_object();
}

}  // namespace

void write_design(Json& json, const SlabHeader& header) {
  const SlabDesign design = facts_of(header).design;
  json.key("design");
  if (!design.given) {
    json.null();
    return;
  }
  json.begin_object().field("sha256", header.design_sha256).key("seats").begin_array();
  for (int station = 1; station <= header.stations; ++station) {
    const SeatDesign& seat = design.at(station);
    json.begin_object().field("station", station).field("dx_mm", seat.offset_mm.x());
    json.field("dy_mm", seat.offset_mm.y()).field("dz_mm", seat.offset_mm.z());
    json.field("dslope_deg", deg_from_rad(seat.slope_rad)).end_object();
  }
  json.end_array().end_object();
}

std::string slab_json(const SlabRecord& record, int only_block) {
  const SlabHeader& header = record.summary.header;
  const std::string_view datum = slope_datum(record);
  Json json("slabd.slab/1");
  json.field("key", header.key).field("slab_id", header.slab_id).field("slab_no", header.slab_no);
  json.field("slab_type", header.slab_type).field("verdict", record.summary.verdict);
  json.field("reason", record.summary.reason);
  write_emulation(json, header.emulated);
  write_time(json, "began", header.began_utime_us);
  write_time(json, "ended", record.summary.ended_utime_us);
  json.field("acknowledged", record.summary.acknowledged).field("recipe", header.recipe);
  json.field("recipe_sha256", header.recipe_sha256).field("calibration_id", header.calibration_id);
  json.field("stations_id", header.stations_id).field("scanner_id", header.scanner_id);
  json.list("more_arms", header.more_arms, [&](const SlabArm& arm) {
    json.field("robot", arm.by.robot).field("scanner", arm.by.scanner).field("calibration_id", arm.calibration_id);
    json.field("stations_id", arm.stations_id).field("scanner_id", arm.scanner_id);
    json.field("T_flange_scanner", arm.T_flange_scanner);
  });
  json.field("tie_id", only_if(!header.tie_id.empty(), header.tie_id));
  json.field("unconfirmed", header.unconfirmed).field("guard", header.guard).field("cell_mm", header.cell_mm);
  json.field("software", header.software).field("stations", header.stations);
  json.field("stations_measured", record.summary.stations_measured);
  json.field("slab_temperature_k", header.temperature_dk == 0 ? kNoValue : header.temperature_dk / 10.0);
  json.field("slab_age_h", only_if(header.age_h != 0, header.age_h));
  json.field("mould", only_if(header.mould != 0, header.mould));
  write_design(json, header);
  json.list("dispositions", record.dispositions, [&](const storage::DispositionRecord& d) {
    json.field("n", d.n);
    write_time(json, "utime", d.utime_us);
    json.field("who", d.who).field("decision", name(d.decision)).field("reason", d.reason);
    json.field("authority", d.authority).field("second", d.second);
  });
  json.field("slope_datum", only_if(!datum.empty(), datum));
  json.field("T_flange_scanner", header.T_flange_scanner).field("slab_fit", record.slab.fit);
  json.key("station_verdicts").begin_array();
  for (int station = 1; station <= header.stations; ++station) {
    const auto [verdict, reason] = shown(record, station);
    json.begin_object().field("station", station).field("verdict", verdict).field("reason", reason).end_object();
  }
  json.end_array().key("items").begin_array();
  for (const Item& item : record.slab.items) write_item(json, item, true);
  json.end_array().key("blocks").begin_array();
  for (const SlabBlock& block : record.blocks) {
    if (only_block != 0 && block.attempt.station != only_block) continue;
    json.begin_object();
    write_attempt(json, record, block);
    json.end_object();
  }
  json.end_array().list("gauges", record.slab.gauges, [&](const GaugeReading& reading) {
    json.field("name", reading.gauge).field("source", reading.source).field("unit", name(reading.unit));
    json.field("state", name(reading.state)).field("value", reading.value).field("u", reading.u);
    json.field("u_master", reading.u_master).field("seq", reading.seq).field("slab_no", reading.slab_no);
    write_time(json, "arrived", reading.utime_us);
    json.field("age_s", reading.age_s);
    write_time(json, "checked", reading.check_utime_us);
    json.field("check_deviation", reading.check_deviation);
  });
  return json.field("not_visible", not_visible(record.slab)).text();
}

}  // namespace slabd::report
