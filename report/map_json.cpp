// SPDX-License-Identifier: Apache-2.0
#include "report/map_json.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "report/findings.h"
#include "report/json.h"
#include "report/slab_view.h"

namespace slabd::report {
namespace {

using storage::SlabBlock;
using storage::SlabRecord;

/// Findings of a slab that did not pass; a partial slab has a few sentences (report/findings.h).
constexpr std::size_t kFindingsMax = 60;
/// Decimals of a height. Stored heights are multiples of a step that is larger.
constexpr double kHeightScale = 1e6;

bool is_kept(const Attempt& attempt) {
  const std::string path(attempt.scan_path.view());
  return !path.empty() && ::access(path.c_str(), F_OK) == 0;
}

void write_verdict(Json& json, const Shown& shown, Language language) {
  json.field("verdict", shown.verdict).field("reason", shown.reason);
  json.field("reason_text", reason_sentence(shown.reason, language));
}

void write_station(Json& json, const SlabRecord& record, int station, Language language) {
  const SlabBlock* const block = latest(record, station);
  json.field("station", station);
  write_verdict(json, shown(record, station), language);
  json.field("attempts", block == nullptr ? 0 : int{block->attempt.number});
  json.field("damage", damage_of(record, station).size());
  json.field("scan_kept", block != nullptr && is_kept(block->attempt));
}

/// null if the map was not stored, or if its bytes are not a valid map.
void write_map(Json& json, std::string_view name, std::string_view along_rows, const PackedMap& map) {
  json.key(name);
  const std::optional<std::vector<float>> heights = map.empty() ? std::nullopt : unpack_map(map);
  if (!heights) {
    json.null();
    return;
  }
  const auto first_mm = [&](std::size_t cells) { return 0.5 * map.cell_mm * (1.0 - static_cast<double>(cells)); };
  json.begin_object().field("columns", map.columns).field("rows", map.rows).field("cell_mm", map.cell_mm);
  json.field("step_mm", map.step_mm).key("axes").begin_array().value("x").value(along_rows).end_array();
  json.field("origin_mm", std::array{first_mm(map.columns), first_mm(map.rows)});
  std::vector<double> values(heights->size());
  std::transform(heights->begin(), heights->end(), values.begin(),
                 [](float height) { return std::round(static_cast<double>(height) * kHeightScale) / kHeightScale; });
  json.field("values_mm", std::span<const double>(values)).end_object();
}

}  // namespace

const SlabBlock* newest_measured(const SlabRecord& record, int station) {
  const SlabBlock* found = nullptr;
  for (const SlabBlock& block : record.blocks)
    if (block.attempt.station == station && block.phase == StationPhase::measured) found = &block;
  return found;
}

std::string slab_map_json(const SlabRecord& record, Language language) {
  const SlabHeader& header = record.summary.header;
  Json json("slabd.slab_map/1");
  json.field("language", code(language)).field("key", header.key).field("slab_id", header.slab_id);
  json.field("slab_no", header.slab_no).field("slab_type", header.slab_type).field("recipe", header.recipe);
  write_emulation(json, header.emulated);
  write_verdict(json, {record.summary.verdict, record.summary.reason}, language);
  json.field("began_utime_us", header.began_utime_us);
  json.field("ended_utime_us", only_if(!is_open(record), record.summary.ended_utime_us));
  json.key("blocks").begin_array();
  for (int station = 1; station <= header.stations; ++station) {
    json.begin_object();
    write_station(json, record, station, language);
    json.end_object();
  }
  const std::vector<Finding> findings = findings_of(record, language);
  json.end_array().field("findings_count", findings.size()).key("findings").begin_array();
  for (std::size_t i = 0; i < std::min(findings.size(), kFindingsMax); ++i) {
    const Finding& finding = findings[i];
    json.begin_object().field("verdict", finding.verdict).field("stations", finding.stations);
    json.key("item");
    if (finding.item)
      json.value(info(finding.item->id).name);
    else
      json.null();
    json.field("text", sentence_of(finding, language)).end_object();
  }
  return json.end_array().text();
}

std::string block_map_json(const SlabRecord& record, int station, const BlockMaps& maps, Language language) {
  const SlabBlock* const block = newest_measured(record, station);
  Json json("slabd.block_map/1");
  json.field("language", code(language)).field("key", record.summary.header.key).field("station", station);
  write_verdict(json, shown(record, station), language);
  json.field("attempt", block == nullptr ? std::nullopt : std::optional<int>(block->attempt.number));
  json.field("scan_kept", block != nullptr && is_kept(block->attempt));
  write_map(json, "deviation", "y", maps.registration);
  write_map(json, "seat", "s", maps.seat);
  json.key("findings").begin_array();
  if (block != nullptr && block == latest(record, station))
    for (const SurfaceFinding& finding : damage_of(record, station)) json.value(finding);
  return json.end_array().text();
}

}  // namespace slabd::report
