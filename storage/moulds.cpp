// SPDX-License-Identifier: Apache-2.0
//
// Reading is one ordered pass: the newest slabs of each mould by the index of moulds, and for each slab its items in
// the order of the primary key. Only the needed columns are decoded. The limit per mould bounds the cost, not the size
// of the database.
#include "storage/moulds.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <tuple>
#include <utility>

#include "base/limits.h"
#include "storage/jobs.h"

namespace slabd::storage {
namespace {

constexpr std::int64_t kForEver = 9'000'000'000'000'000'000;
constexpr float kNoLimit = std::numeric_limits<float>::quiet_NaN();
constexpr std::int64_t kHour_us = 3'600'000'000;

[[noreturn]] void refuse(const std::string& sentence) {
  Error why;
  why.code = Code::config;
  why.text.assign(sentence);
  throw Refusal{why};
}

/// Item of a row before it is known whether a later row replaces it.
struct Candidate {
  MouldValue value;
  std::uint8_t attempt = 0;  ///< 0: an item of the slab
  bool judged = false;       ///< has a limit
};

/// Keeps the valid rows: of a block's item the valid attempt, and not that if SLAB_END has judged it in the slab's
/// frame. An item of the slab without limits, which is information, gives way to that of the block.
void keep_valid(std::vector<Candidate>& rows, const std::array<std::uint8_t, limits::kStationsMax + 1>& attempts,
                std::vector<MouldValue>& out) {
  const auto place = [](const Candidate& row) {
    return std::tuple(row.value.item, row.value.station, row.value.station_to);
  };
  const auto is_replaced = [&](const Candidate& row) {
    return row.attempt != 0 && row.attempt != attempts.at(row.value.station);
  };
  std::erase_if(rows, is_replaced);
  // Judged items of the slab, items of the block, items for information.
  const auto rank = [](const Candidate& row) { return row.attempt != 0 ? 1 : row.judged ? 0 : 2; };
  std::stable_sort(rows.begin(), rows.end(), [&](const Candidate& a, const Candidate& b) {
    return std::pair(place(a), rank(a)) < std::pair(place(b), rank(b));
  });
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (i > 0 && place(rows[i]) == place(rows[i - 1])) continue;
    if (!std::isnan(rows[i].value.deviation)) out.push_back(rows[i].value);
  }
}

}  // namespace

std::string Moulds::reset(const ResetMould& change) {
  const std::string mould = "mould " + std::to_string(change.mould);
  if (change.mould == 0) refuse("mould 0 is the unknown one and has no epochs; a mould is a number from 1 to 65535");
  if (change.note.who.empty() || change.note.why.empty())
    refuse(mould + " is not reset: give an operator and a reason");
  if (change.from_utime_us > change.note.utime_us) refuse(mould + " is not reset: its time is in the future");
  Statement slab(db_, "SELECT 1 FROM slab WHERE mould = ?1 LIMIT 1");
  const bool known = slab.bind(1, std::int64_t{change.mould}).step();
  slab.reset();
  if (!known) refuse("no stored slab is from " + mould + "; slabctl mould list shows the moulds");
  Statement before(db_, "SELECT count(*), coalesce(max(from_utime_us), 0) FROM mould_reset WHERE mould = ?1");
  std::ignore = before.bind(1, std::int64_t{change.mould}).step();
  const std::int64_t count = before.integer(0);
  const std::int64_t last = before.integer(1);
  before.reset();
  if (count > 0 && change.from_utime_us < last)
    refuse(mould + " is not reset: it was reset after that time; slabctl mould show " + std::to_string(change.mould) +
           " lists its resets");
  const bool repeated = count > 0 && change.from_utime_us == last;
  if (!repeated)
    Statement(db_, "INSERT INTO mould_reset (mould, from_utime_us, who, why, utime_us) VALUES (?1, ?2, ?3, ?4, ?5)")
        .bind(1, std::int64_t{change.mould})
        .bind(2, change.from_utime_us)
        .bind(3, std::string_view(change.note.who))
        .bind(4, std::string_view(change.note.why))
        .bind(5, change.note.utime_us)
        .run();
  return "mould-" + std::to_string(change.mould) + "-epoch-" + std::to_string(count + (repeated ? 1 : 2));
}

MouldRecords Moulds::records(const MouldFilter& filter) {
  MouldRecords records;
  records.slabs = newest_slabs(filter);
  read_values(records);
  records.unknown = db_.integer("SELECT count(*) FROM slab WHERE mould = 0");
  Statement resets(db_,
                   "SELECT mould, from_utime_us, who, why, utime_us FROM mould_reset ORDER BY mould, from_utime_us");
  while (resets.step()) {
    MouldReset& reset = records.resets.emplace_back();
    reset.mould = static_cast<std::uint16_t>(resets.integer(0));
    reset.from_utime_us = resets.integer(1);
    reset.note = {std::string(resets.text(2)), std::string(resets.text(3)), resets.integer(4)};
  }
  return records;
}

std::vector<MouldSlab> Moulds::newest_slabs(const MouldFilter& filter) {
  std::vector<std::int64_t> moulds;
  // From mould to mould by the index, without reading all slabs.
  Statement next(db_, "SELECT min(mould) FROM slab WHERE mould > ?1");
  for (std::int64_t mould = 0; next.bind(1, mould).step() && !next.is_null(0);) {
    mould = next.integer(0);
    moulds.push_back(mould);
    next.reset();
  }
  next.reset();
  std::string sql =
      "SELECT slab_key, slab_type, began_utime_us, age_h, emulated FROM slab CROSS JOIN slab_result USING (slab_key) "
      "WHERE mould = ?1 AND slab_result.verdict <> 'aborted' AND +began_utime_us >= ?3 AND +began_utime_us < ?4";
  if (filter.slab_type != 0) sql += " AND slab_type = ?5";
  Statement rows(db_, sql + " ORDER BY slab_key DESC LIMIT ?2");
  std::vector<MouldSlab> slabs;
  for (const std::int64_t mould : moulds) {
    rows.bind(1, mould)
        .bind(2, static_cast<std::int64_t>(std::min<std::size_t>(filter.castings, 1'000'000'000)))
        .bind(3, filter.since_utime_us.value_or(-kForEver))
        .bind(4, filter.until_utime_us.value_or(kForEver));
    if (filter.slab_type != 0) rows.bind(5, std::int64_t{filter.slab_type});
    while (rows.step()) {
      MouldSlab& slab = slabs.emplace_back();
      slab.key = rows.integer(0);
      slab.mould = static_cast<std::uint16_t>(mould);
      slab.slab_type = static_cast<std::uint16_t>(rows.integer(1));
      slab.cast_utime_us = rows.integer(2) - rows.integer(3) * kHour_us;
      slab.emulated = static_cast<std::uint8_t>(rows.integer(4));
    }
  }
  std::sort(slabs.begin(), slabs.end(), [](const MouldSlab& a, const MouldSlab& b) { return a.key < b.key; });
  return slabs;
}

void Moulds::read_values(MouldRecords& records) {
  // The limits are needed of the newest slab of each type only.
  std::map<std::uint16_t, std::size_t> newest;
  for (std::size_t i = 0; i < records.slabs.size(); ++i) newest[records.slabs[i].slab_type] = i;
  Statement attempts(db_, "SELECT station, max(attempt) FROM attempt WHERE slab_key = ?1 GROUP BY station");
  // A million rows: each column that is fetched costs as much as the arithmetic of a row.
  const std::string columns =
      "SELECT (station << 24) + (attempt << 16) + (from_station << 8) + to_station, id, value - coalesce(nominal, 0), "
      "lower IS NOT NULL OR upper IS NOT NULL";
  // An item of the slab without a value still replaces that of the block.
  const std::string rows_of_slab = " FROM item WHERE slab_key = ?1 AND (value IS NOT NULL OR station = 0)";
  Statement plain(db_, columns + rows_of_slab);
  Statement with_limits(db_, columns + ", lower - coalesce(nominal, 0), upper - coalesce(nominal, 0)" + rows_of_slab);
  std::vector<Candidate> rows;
  for (std::size_t i = 0; i < records.slabs.size(); ++i) {
    std::array<std::uint8_t, limits::kStationsMax + 1> valid{};
    attempts.bind(1, records.slabs[i].key);
    while (attempts.step())
      valid.at(static_cast<std::size_t>(attempts.integer(0))) = static_cast<std::uint8_t>(attempts.integer(1));
    rows.clear();
    const bool is_newest = newest.at(records.slabs[i].slab_type) == i;
    Statement& items = is_newest ? with_limits : plain;
    items.bind(1, records.slabs[i].key);
    while (items.step()) {
      const std::optional<ItemId> id = item_from_name(items.stored_text(1));
      if (!id) items.refuse(1, "holds an unknown value");
      Candidate& row = rows.emplace_back();
      const std::int64_t place = items.integer(0);
      const auto byte = [place](unsigned shift) { return static_cast<std::uint8_t>(place >> shift & 0xFF); };
      row.attempt = byte(16);
      row.value.slab = static_cast<std::uint32_t>(i);
      row.value.item = *id;
      row.value.station = byte(24) > 0 ? byte(24) : byte(8);
      row.value.station_to = byte(0);
      if (row.value.station > limits::kStationsMax || row.value.station_to > limits::kStationsMax)
        items.refuse(0, "is not a station");
      row.value.deviation = static_cast<float>(items.real(2));
      row.judged = items.integer(3) == 1;
      row.value.lower = is_newest ? static_cast<float>(items.real(4)) : kNoLimit;
      row.value.upper = is_newest ? static_cast<float>(items.real(5)) : kNoLimit;
    }
    keep_valid(rows, valid, records.values);
  }
}

}  // namespace slabd::storage
