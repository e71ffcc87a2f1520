// SPDX-License-Identifier: Apache-2.0
#include "storage/load.h"

#include <algorithm>

#include "base/jobs.h"
#include "storage/dispositions.h"
#include "storage/gauges.h"

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
      arms_(db, select<ArmKey, SlabArm>("slab_arm", "slab_key = ?1 ORDER BY arm")),
      slab_result_(db, select<SlabEnd, SlabResult>("slab_result", "slab_key = ?1")),
      station_results_(db, select<StationResult>("station_result", "slab_key = ?1 ORDER BY station")),
      attempts_(db, select<Attempt, AttemptState>("attempt", "slab_key = ?1 ORDER BY station, attempt")),
      block_(db, select<BlockResult>("block", kOfBlock)),
      planes_(db, select<FeatureName, PlaneFit>("plane", kOfBlock)),
      casings_(db, select<FeatureName, CasingFeature>("casing", kOfBlock)),
      findings_(db, select<SurfaceFinding>("finding", (std::string(kOfBlock) + " ORDER BY position").c_str())),
      edges_(db, select<EdgeFeature>("edge", (std::string(kOfBlock) + " ORDER BY position").c_str())),
      items_(db, select<Item>("item", (std::string(kOfBlock) + " ORDER BY position").c_str())),
      maps_(db, select<FeatureName, PackedMap>("map", kOfBlock)),
      gauges_(db, select<GaugeReading>("gauge_value", "slab_key = ?1 ORDER BY position")) {}

std::optional<SlabHeader> Loader::slab(std::int64_t slab_key) {
  if (!slab_.bind(1, slab_key).step()) return std::nullopt;
  SlabHeader header;
  read_row(slab_, 0, header);
  slab_.reset();
  arms_.bind(1, slab_key);
  while (arms_.step()) {
    ArmKey key;
    SlabArm arm;
    read_row(arms_, 0, key, arm);
    // An attempt names its arm by this number.
    if (key.arm != header.more_arms.size() + 1 || !header.more_arms.push(arm))
      arms_.refuse(1, "is not the next arm, or one too many");
  }
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
    if (row.station < 1 || row.station > limits::kStationsMax) station_results_.refuse(0, "is not a station");
    out.station_verdict[row.station - 1U] = row.verdict;
    out.station_reason[row.station - 1U] = row.reason;
    // An aborted slab has no pass, whatever is stored.
    if (out.verdict == Verdict::aborted && row.verdict == Verdict::pass)
      out.station_verdict[row.station - 1U] = Verdict::none;
  }
  items({slab_key, 0, 0}, out.items);
  gauges_.bind(1, slab_key);
  while (gauges_.step()) {
    GaugeReading reading;
    read_row(gauges_, 0, reading);
    if (!out.gauges.push(reading)) gauges_.refuse(0, "has more rows than a line has gauges");
  }
  return true;
}

std::vector<StoredAttempt> Loader::attempts(std::int64_t slab_key) {
  std::vector<StoredAttempt> list;
  attempts_.bind(1, slab_key);
  while (attempts_.step()) {
    StoredAttempt& row = list.emplace_back();
    read_row(attempts_, 0, row.attempt, row.state);
    // Also checked by the schema, but the station is used as an index.
    if (row.attempt.station < 1 || row.attempt.station > limits::kStationsMax) attempts_.refuse(1, "is not a station");
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

// State of a restarted daemon, read from the rows of its predecessor. The open slab is restored with every station's
// latest attempt. A later attempt replaces an earlier one even if it failed: a station that was rescanned must not show
// its old pass.

namespace {

void read_counters(Connection& db, RecoveredLine& line) {
  Statement one_line(db, "SELECT session, newest_utime_us FROM line");
  if (one_line.step()) {
    line.session = static_cast<std::uint16_t>(one_line.integer(0));
    line.newest_utime_us = one_line.integer(1);
  }
  Statement command(db, "SELECT cmd_seq, status FROM command ORDER BY id DESC LIMIT 1");
  if (command.step()) {
    line.cmd_ack = static_cast<std::uint16_t>(command.integer(0));
    line.cmd_status = static_cast<std::uint16_t>(command.integer(1));
  }
  line.acq_seq =
      static_cast<std::uint16_t>(db.integer("SELECT cmd_seq FROM command WHERE acquired = 1 ORDER BY id DESC LIMIT 1"));
  // After a restore the record numbers continue from another value, because the PLC may have acknowledgements of lost
  // records.
  line.res_seq = static_cast<std::uint16_t>(db.integer(
      "SELECT coalesce((SELECT res_seq FROM care WHERE result_id = (SELECT coalesce(max(id), 0) FROM result) "
      "ORDER BY seq DESC LIMIT 1), (SELECT res_seq FROM result ORDER BY id DESC LIMIT 1), 0)"));
}

void read_fingerprints(Connection& db, RecoveredLine& line) {
  Statement rows(db, "SELECT fingerprint FROM (SELECT id, fingerprint FROM seen_scan ORDER BY id DESC LIMIT " +
                         std::to_string(kFingerprintsKept) + ") ORDER BY id");
  for (std::size_t i = 0; rows.step(); ++i) line.fingerprints.at(i) = static_cast<std::uint64_t>(rows.integer(0));
}

/// Reads the noise prints. A print with invalid bytes is omitted; one exposure less is then recognised.
void read_noise(Connection& db, RecoveredLine& line) {
  Statement rows(db,
                 "SELECT slab_key, station, attempt, bytes FROM (SELECT * FROM noise_print ORDER BY id DESC LIMIT " +
                     std::to_string(limits::kNoisePrintsKept) + ") ORDER BY id");
  while (rows.step()) {
    KeptNoise kept;
    kept.slab_key = rows.integer(0);
    kept.station = static_cast<std::uint8_t>(rows.integer(1));
    kept.attempt = static_cast<std::uint8_t>(rows.integer(2));
    if (from_bytes(rows.bytes(3), kept.print)) line.noise.push_back(kept);
  }
}

HeldBack read_unacknowledged(Connection& db, RecoveredLine& line) {
  Statement rows(
      db, "SELECT id, " + joined(names_of<PlcResult>(), ", ") + " FROM result WHERE acknowledged = 0 ORDER BY id");
  HeldBack held_back;
  while (rows.step()) {
    PlcResult record;
    read_row(rows, 1, record);
    // SCAN is rejected long before the queue is full; if it overflows, the oldest records are shown first as usual.
    if (line.unacknowledged.push(record)) continue;
    held_back = {rows.integer(0), db.integer("SELECT max(id) FROM result")};
    break;
  }
  return held_back;
}

/// Reads the stations of line.slab.
void read_stations(Loader& loader, RecoveredLine& line) {
  for (const StoredAttempt& stored : loader.attempts(line.slab.key)) {
    const Attempt& attempt = stored.attempt;
    StationRecord& station = line.stations[attempt.station - 1U];
    if (attempt.asked) station.attempts = std::max(station.attempts, attempt.number);
    station.phase = stored.state.phase;
    station.code = stored.state.code;
    station.measuring_since_ns = stored.state.measuring_since_ns;
    if (stored.state.phase != StationPhase::failed) station.attempt = attempt;
  }
  for (StationRecord& station : line.stations) {
    if (station.phase != StationPhase::measured) continue;
    const BlockKey key{line.slab.key, station.attempt.station, station.attempt.number};
    if (!loader.block(key, station.block))
      throw SqlFailure{0, "slab " + std::to_string(key.slab_key) + " station " + std::to_string(key.station) +
                              " attempt " + std::to_string(key.attempt) + " is measured but has no block"};
  }
}

/// Reads the block poses in the valid attempts of the last ended slab.
void read_last_blocks(Loader& loader, RecoveredLine& line) {
  for (const StoredAttempt& stored : loader.attempts(line.last_slab.key)) {
    SeenBlock& seen = line.last_blocks[stored.attempt.station - 1U];
    seen = {};
    BlockResult block;
    const BlockKey key{line.last_slab.key, stored.attempt.station, stored.attempt.number};
    if (stored.state.phase != StationPhase::measured || !loader.block(key, block)) continue;
    seen.seen = block.registration.status == RegistrationStatus::converged &&
                block.reason != static_cast<std::uint16_t>(Code::frame_incomplete);
    seen.T_base_scanner = stored_T_base_scanner(line.last_slab, stored.attempt);
    seen.T_scanner_block = block.registration.T_scanner_block;
  }
}

void read_last_ended(Connection& db, Loader& loader, RecoveredLine& line) {
  const std::int64_t key = db.integer("SELECT coalesce(max(slab_key), 0) FROM slab_result");
  if (key == 0) return;
  SlabResult result;
  std::int64_t ended_utime_us = 0;
  const std::optional<SlabHeader> header = loader.slab(key);
  if (!header || !loader.slab_result(key, result, ended_utime_us)) return;
  line.last_slab = *header;
  line.last_result = result;
  read_last_blocks(loader, line);
  if (!line.slab_open) {
    line.slab = *header;
    read_stations(loader, line);
  }
  line.table_slab_no = header->slab_no;
  line.slab_emulated = header->emulated;
  if (const std::vector<DispositionRecord> decisions = Dispositions(db).of_slab(key); !decisions.empty())
    line.disposition = decisions.back().decision;
  line.slab_verdict = result.verdict;
  line.slab_reason = result.reason;
  for (std::size_t i = 0; i < line.table.size(); ++i) {
    line.table[i].verdict = result.station_verdict[i];
    line.table[i].reason = result.station_reason[i];
  }
  for (const StoredAttempt& stored : loader.attempts(key)) {
    std::uint8_t& attempts = line.table[stored.attempt.station - 1U].attempts;
    if (stored.attempt.asked) attempts = std::max(attempts, stored.attempt.number);
  }
  Statement record(db, "SELECT " + joined(names_of<PlcResult>(), ", ") +
                           " FROM result WHERE slab_key = ?1 AND kind = 2 AND is_repeat = 0 ORDER BY id DESC LIMIT 1");
  if (record.bind(1, key).step()) read_row(record, 0, line.slab_record);
}

}  // namespace

std::int64_t newest_key_used(Connection& db) {
  // Keys of slabs that only a lost database contained are not reused, because their scans may still exist.
  return std::max(db.integer("SELECT coalesce(max(slab_key), 0) FROM slab"),
                  db.integer("SELECT max(keys_used, pruned_key) FROM line"));
}

HeldBack read_line(Connection& db, RecoveredLine& line) {
  Loader loader(db);
  read_counters(db, line);
  const std::int64_t newest = db.integer("SELECT coalesce(max(slab_key), 0) FROM slab");
  line.last_slab_key = newest_key_used(db);
  const HeldBack held_back = read_unacknowledged(db, line);
  if (newest != 0) {
    const std::int64_t ended =
        db.integer("SELECT count(*) FROM slab_result WHERE slab_key = " + std::to_string(newest));
    line.slab_open = ended == 0;
  }
  if (line.slab_open) {
    const std::optional<SlabHeader> header = loader.slab(newest);
    if (header) line.slab = *header;
    read_stations(loader, line);
    // Jobs::interrupt_unfinished() has left it accepted.
    line.abort_seq = static_cast<std::uint16_t>(
        db.integer("SELECT coalesce((SELECT cmd_seq FROM command WHERE status = 1 AND command = 4 AND slab_key = " +
                   std::to_string(newest) + " ORDER BY id DESC LIMIT 1), 0)"));
    // From the newest one back to this slab's SLAB_BEGIN: the table is long.
    line.end_was_given = db.integer(
                             "SELECT coalesce((SELECT command = 3 FROM command WHERE command IN (1, 3) AND "
                             "slab_key = " +
                             std::to_string(newest) + " ORDER BY id DESC LIMIT 1), 0)") != 0;
  }
  read_last_ended(db, loader, line);
  read_fingerprints(db, line);
  read_noise(db, line);
  Gauges(db).read_line(line);
  return held_back;
}

}  // namespace slabd::storage
