// SPDX-License-Identifier: Apache-2.0
#include "plant/documents.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

namespace slabd::plant {
namespace {

using Json = nlohmann::ordered_json;
using storage::OutboxRow;

std::string text_of(const Json& document) {
  return document.dump(-1, ' ', true, Json::error_handler_t::replace);
}

/// PostgreSQL has no NUL in texts.
std::string without_nul(std::string_view stored) {
  std::string text(stored);
  std::erase(text, '\0');
  return text;
}

Json number(double value) {
  return has_value(value) ? Json(value) : Json(nullptr);
}

Json decisions(const std::vector<storage::DispositionRecord>& list) {
  Json json = Json::array();
  for (const storage::DispositionRecord& d : list)
    json.push_back({{"n", d.n},
                    {"utime_us", d.utime_us},
                    {"who", without_nul(d.who)},
                    {"decision", name(d.decision)},
                    {"reason", without_nul(d.reason)},
                    {"authority", without_nul(d.authority)},
                    {"second", without_nul(d.second)}});
  return json;
}

Json row_of(const Item& item, int station) {
  return Json::array({info(item.id).name, station, item.station_to, name(item.verdict), number(item.value),
                      number(item.nominal), number(item.lower), number(item.upper), number(item.U)});
}

bool is_judged(const Item& item) {
  return has_value(item.lower) || has_value(item.upper);
}

/// Valid items: those of the latest attempt of each station, unless the slab's end has judged them again in the slab's
/// frame, and those of the slab. One of the slab without limits, which is information, gives way to that of the block.
Json valid_items(const storage::SlabRecord& slab) {
  Json items = Json::array();
  // An aborted slab was never judged, and its line counts no values of it either.
  if (slab.summary.verdict == Verdict::aborted) return items;
  std::set<std::pair<ItemId, int>> of_blocks;
  const auto in_slab_frame = [&](const Item& item, int station) {
    return std::any_of(slab.slab.items.begin(), slab.slab.items.end(), [&](const Item& other) {
      return other.id == item.id && other.station == station && other.station_to == 0 && is_judged(other);
    });
  };
  for (const storage::SlabBlock& block : slab.blocks) {
    const bool latest = std::none_of(slab.blocks.begin(), slab.blocks.end(), [&](const storage::SlabBlock& other) {
      return other.attempt.station == block.attempt.station && other.attempt.number > block.attempt.number;
    });
    if (!latest || block.phase != StationPhase::measured) continue;
    for (const Item& item : block.block.items) {
      if (in_slab_frame(item, block.attempt.station)) continue;
      items.push_back(row_of(item, block.attempt.station));
      of_blocks.emplace(item.id, block.attempt.station);
    }
  }
  for (const Item& item : slab.slab.items)
    if (item.station_to != 0 || is_judged(item) || !of_blocks.contains({item.id, item.station}))
      items.push_back(row_of(item, item.station));
  return items;
}

/// In the order of the line's configuration.
Json gauges(const GaugeReadings& list) {
  Json json = Json::array();
  for (const GaugeReading& reading : list)
    json.push_back({{"name", without_nul(reading.gauge.view())},
                    {"source", without_nul(reading.source.view())},
                    {"unit", name(reading.unit)},
                    {"state", name(reading.state)},
                    {"value", number(reading.value)},
                    {"u", number(reading.u)},
                    {"u_master", number(reading.u_master)},
                    {"utime_us", reading.utime_us != 0 ? Json(reading.utime_us) : Json(nullptr)},
                    {"check_utime_us", reading.check_utime_us != 0 ? Json(reading.check_utime_us) : Json(nullptr)},
                    {"check_deviation", number(reading.check_deviation)}});
  return json;
}

Json empty_record(const OutboxRow& row) {
  return Json{{"schema", "slabd.plant_record/1"},
              {"utime_us", row.utime_us},
              {"slab_key", row.slab_key != 0 ? Json(row.slab_key) : Json(nullptr)},
              {"slab_epoch", nullptr},
              {"station", nullptr},
              {"attempt", nullptr},
              {"record", nullptr}};
}

Json json_of(const storage::StoredRow& stored) {
  Json record = Json::object();
  for (const storage::StoredField& field : stored) {
    Json& value = record[field.name];
    if (const auto* integer = std::get_if<std::int64_t>(&field.value)) value = *integer;
    if (const auto* real = std::get_if<double>(&field.value)) value = number(*real);
    if (const auto* text = std::get_if<std::string>(&field.value)) value = without_nul(*text);
  }
  return record;
}

}  // namespace

std::string slab_document(const storage::SlabRecord& slab, const std::string& slab_epoch) {
  const SlabHeader& h = slab.summary.header;
  const auto scans = std::count_if(slab.blocks.begin(), slab.blocks.end(),
                                   [](const storage::SlabBlock& block) { return block.attempt.asked; });
  return text_of(Json{{"schema", "slabd.plant_slab/1"},
                      {"slab_key", h.key},
                      {"slab_epoch", slab_epoch},
                      {"slab_id", without_nul(h.slab_id.view())},
                      {"slab_no", h.slab_no},
                      {"slab_type", h.slab_type},
                      {"mould", h.mould != 0 ? Json(h.mould) : Json(nullptr)},
                      {"began_utime_us", h.began_utime_us},
                      {"ended_utime_us", slab.summary.ended_utime_us},
                      {"verdict", name(slab.summary.verdict)},
                      {"reason", slab.summary.reason},
                      {"stations", h.stations},
                      {"stations_measured", slab.summary.stations_measured},
                      {"scans", scans},
                      {"recipe", without_nul(h.recipe.view())},
                      {"recipe_sha256", h.recipe_sha256.view()},
                      {"design_sha256", h.design_sha256.view()},
                      {"calibration_id", h.calibration_id.view()},
                      {"software", without_nul(h.software.view())},
                      {"emulated", h.emulated != 0},
                      {"items", valid_items(slab)},
                      {"gauges", gauges(slab.slab.gauges)},
                      {"dispositions", decisions(slab.dispositions)}});
}

Result<std::string> document_of(const OutboxRow& row, storage::Reader& reader, storage::Outbox& outbox) {
  Json record = empty_record(row);
  if (row.slab_key == 0) {
    const Result<std::optional<storage::StoredRow>> stored = outbox.subject(row);
    if (!stored.ok()) return stored.error();
    if (stored.value()) record["record"] = json_of(*stored.value());
    return text_of(record);
  }
  const Result<std::string> epoch = outbox.epoch_of_slab(row.slab_key);
  if (!epoch.ok()) return epoch.error();
  // A slab that has no document of its own yet will have one in the epoch of this row.
  const std::string& slab_epoch = epoch.value().empty() ? row.epoch : epoch.value();
  record["slab_epoch"] = slab_epoch;
  if (row.kind == "remeasured") {
    record["station"] = row.about / 1000;
    record["attempt"] = row.about % 1000;
  }
  if (row.kind != "slab" && row.kind != "decided") return text_of(record);
  const Result<std::optional<storage::SlabRecord>> slab = reader.slab(row.slab_key);
  if (!slab.ok()) return slab.error();
  if (!slab.value() || slab.value()->summary.ended_utime_us == 0) return text_of(record);
  if (row.kind == "slab") return slab_document(*slab.value(), slab_epoch);
  return text_of(Json{{"schema", "slabd.plant_decisions/1"},
                      {"slab_key", row.slab_key},
                      {"slab_epoch", slab_epoch},
                      {"utime_us", row.utime_us},
                      {"dispositions", decisions(slab.value()->dispositions)}});
}

}  // namespace slabd::plant
