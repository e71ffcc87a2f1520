// SPDX-License-Identifier: Apache-2.0
#include "storage/load.h"

namespace slabd::storage {
namespace {

template <typename... Parts>
std::string select(const char* table, const char* rest) {
  return "SELECT " + joined(names_of<Parts...>(), ", ") + " FROM " + table + " WHERE " + rest;
}

constexpr const char* kOfBlock = "slab_key = ?1 AND station = ?2 AND attempt = ?3";

PlaneFit* plane_named(BlockResult& block, std::string_view feature) {
  if (feature == "seat") return &block.seat.plane;
  if (feature == "seat_full") return &block.seat.full_plane;
  if (feature == "jaw_inner") return &block.jaw_inner;
  if (feature == "jaw_outer") return &block.jaw_outer;
  if (feature == "slab_top") return &block.slab_top;
  return nullptr;
}

CasingFeature* casing_named(BlockResult& block, std::string_view feature) {
  if (feature == "inner") return &block.casing_inner;
  if (feature == "outer") return &block.casing_outer;
  return nullptr;
}

Statement& bind_key(Statement& statement, const BlockKey& key) {
  return statement.bind(1, key.slab_key)
      .bind(2, static_cast<std::int64_t>(key.station))
      .bind(3, static_cast<std::int64_t>(key.attempt));
}

}  // namespace

Loader::Loader(Connection& db)
    : slab_(db, select<SlabHeader>("slab", "slab_key = ?1")),
      slab_result_(db, select<SlabEnd, SlabResult>("slab_result", "slab_key = ?1")),
      station_results_(db, select<StationResult>("station_result", "slab_key = ?1 ORDER BY station")),
      attempts_(db, select<Attempt, AttemptState>("attempt", "slab_key = ?1 ORDER BY station, attempt")),
      block_(db, select<BlockResult>("block", kOfBlock)),
      planes_(db, select<FeatureName, PlaneFit>("plane", kOfBlock)),
      casings_(db, select<FeatureName, CasingFeature>("casing", kOfBlock)),
      findings_(db, select<SurfaceFinding>("finding", (std::string(kOfBlock) + " ORDER BY position").c_str())),
      edges_(db, select<EdgeFeature>("edge", (std::string(kOfBlock) + " ORDER BY position").c_str())),
      items_(db, select<Item>("item", (std::string(kOfBlock) + " ORDER BY position").c_str())),
      maps_(db, select<FeatureName, PackedMap>("map", kOfBlock)) {}

std::optional<SlabHeader> Loader::slab(std::int64_t slab_key) {
  if (!slab_.bind(1, slab_key).step()) return std::nullopt;
  SlabHeader header;
  read_row(slab_, 0, header);
  slab_.reset();
  return header;
}

bool Loader::slab_result(std::int64_t slab_key, SlabResult& out, std::int64_t& ended_utime_us) {
  if (!slab_result_.bind(1, slab_key).step()) return false;
  SlabEnd end;
  out = {};
  read_row(slab_result_, 0, end, out);
  slab_result_.reset();
  ended_utime_us = end.ended_utime_us;
  station_results_.bind(1, slab_key);
  while (station_results_.step()) {
    StationResult row;
    read_row(station_results_, 0, row);
    if (row.station < 1 || row.station > limits::kStationsMax) station_results_.refuse(0, "is no station");
    out.station_verdict[row.station - 1U] = row.verdict;
    out.station_reason[row.station - 1U] = row.reason;
    // Versions before kept the pass of a block whose slab was aborted; it was provisional.
    if (out.verdict == Verdict::aborted && row.verdict == Verdict::pass)
      out.station_verdict[row.station - 1U] = Verdict::none;
  }
  items({slab_key, 0, 0}, out.items);
  return true;
}

std::vector<StoredAttempt> Loader::attempts(std::int64_t slab_key) {
  std::vector<StoredAttempt> list;
  attempts_.bind(1, slab_key);
  while (attempts_.step()) {
    StoredAttempt& row = list.emplace_back();
    read_row(attempts_, 0, row.attempt, row.state);
    // The schema says so too; a station beyond the table must not be used as an index.
    if (row.attempt.station < 1 || row.attempt.station > limits::kStationsMax) attempts_.refuse(1, "is no station");
  }
  return list;
}

bool Loader::block(const BlockKey& key, BlockResult& out) {
  if (!bind_key(block_, key).step()) return false;
  out = {};
  read_row(block_, 0, out);
  block_.reset();
  out.station = key.station;

  bind_key(planes_, key);
  while (planes_.step()) {
    FeatureName feature;
    PlaneFit plane;
    read_row(planes_, 0, feature, plane);
    PlaneFit* place = plane_named(out, feature.feature.view());
    if (place == nullptr) planes_.refuse(0, "names no plane of a block");
    *place = plane;
  }
  bind_key(casings_, key);
  while (casings_.step()) {
    FeatureName feature;
    CasingFeature casing;
    read_row(casings_, 0, feature, casing);
    CasingFeature* place = casing_named(out, feature.feature.view());
    if (place == nullptr) casings_.refuse(0, "names no casing of a block");
    *place = casing;
  }
  bind_key(findings_, key);
  while (findings_.step()) {
    SurfaceFinding finding;
    read_row(findings_, 0, finding);
    if (!out.findings.push(finding)) findings_.refuse(0, "has more rows than a list of findings can hold");
  }
  bind_key(edges_, key);
  while (edges_.step()) {
    EdgeFeature edge;
    read_row(edges_, 0, edge);
    if (!out.edges.push(edge)) edges_.refuse(0, "has more rows than a list of edges can hold");
  }
  items(key, out.items);
  return true;
}

void Loader::maps(const BlockKey& key, BlockMaps& out) {
  out = {};
  bind_key(maps_, key);
  while (maps_.step()) {
    FeatureName feature;
    PackedMap map;
    read_row(maps_, 0, feature, map);
    if (feature.feature.view() == "registration") {
      out.registration = map;
    } else if (feature.feature.view() == "seat") {
      out.seat = map;
    } else {
      maps_.refuse(0, "names no map of a block");
    }
  }
}

template <std::size_t N>
void Loader::items(const BlockKey& key, FixedVector<Item, N>& out) {
  out.clear();
  bind_key(items_, key);
  while (items_.step()) {
    Item item;
    read_row(items_, 0, item);
    if (!out.push(item)) items_.refuse(0, "has more rows than a list of items can hold");
  }
}

}  // namespace slabd::storage
