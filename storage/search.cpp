// SPDX-License-Identifier: Apache-2.0
//
// Searches among 100 000 slabs. A slab that passed is common: slabs are visited by their key, newest first, until there
// are enough. Anything else is rare: its keys come from the indexes of what did not pass, newest first, and each is
// compared with the conditions. Either way the limit bounds the cost, not the size of the database.
#include "storage/search.h"

#include <algorithm>
#include <memory>
#include <optional>
#include <utility>

#include "storage/dispositions.h"
#include "storage/rows.h"

namespace slabd::storage {
namespace {

/// Condition: the item belongs to the valid attempt of its station.
constexpr const char* kValidAttempt =
    "item.attempt = (SELECT max(a.attempt) FROM attempt AS a WHERE a.slab_key = item.slab_key AND a.station = "
    "item.station)";

/// Condition: the item was not replaced by SLAB_END. A block's item is valid until SLAB_END judges it again in the
/// slab's frame. An item without limits is only information.
constexpr const char* kNotSuperseded =
    "NOT EXISTS (SELECT 1 FROM item AS f WHERE f.slab_key = item.slab_key AND f.station = 0 AND f.id = item.id AND "
    "f.from_station = item.station AND f.to_station = 0 AND (f.lower IS NOT NULL OR f.upper IS NOT NULL))";

/// Condition: the station ?8 of an ended slab has no items, because it was never scanned or its valid attempt failed.
/// None of its items was measured.
constexpr const char* kIsUnseen =
    "(slab_result.verdict IS NOT NULL AND ?8 <= slab.stations AND NOT EXISTS (SELECT 1 FROM attempt AS a JOIN item "
    "USING (slab_key, station, attempt) WHERE a.slab_key = slab.slab_key AND a.station = ?8 AND a.attempt = "
    "(SELECT max(b.attempt) FROM attempt AS b WHERE b.slab_key = a.slab_key AND b.station = a.station)))";
/// Condition: at least one station of an ended slab has no items.
constexpr const char* kHasUnseen =
    "(slab_result.verdict IS NOT NULL AND slab.stations > (SELECT count(*) FROM attempt AS a WHERE a.slab_key = "
    "slab.slab_key AND a.attempt = (SELECT max(b.attempt) FROM attempt AS b WHERE b.slab_key = a.slab_key AND "
    "b.station = a.station) AND EXISTS (SELECT 1 FROM item WHERE item.slab_key = a.slab_key AND item.station = "
    "a.station AND item.attempt = a.attempt)))";

constexpr std::int64_t kForEver = 9'000'000'000'000'000'000;

std::int64_t count_of(std::size_t limit) {
  return static_cast<std::int64_t>(std::min<std::size_t>(limit, 1'000'000'000));
}

/// Columns with the table's name as prefix, because other tables of the statement have columns of the same name.
std::string of_table(const char* table, const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + (table + ("." + name));
  return text;
}

std::string item_condition(const SlabFilter& filter, bool any) {
  const bool is_of_block = info(*filter.item).scope == ItemScope::block;
  const bool also_unseen = is_of_block && (any || filter.verdict == Verdict::not_measured);
  std::string where = " AND (";
  if (also_unseen) where += (filter.block != 0 ? kIsUnseen : kHasUnseen) + std::string(" OR ");
  where += "EXISTS (SELECT 1 FROM item WHERE item.slab_key = slab.slab_key AND item.id = ?6 AND ";
  where += any ? "item.verdict NOT IN ('pass', 'none')" : "item.verdict = ?7";
  if (filter.block != 0)
    where += " AND (item.station = ?8 OR (item.station = 0 AND ?8 IN (item.from_station, item.to_station)))";
  // A block's item in the slab's frame may be only information; then the block's own item is the judged one.
  where += " AND ((item.station = 0";
  if (is_of_block) where += " AND (item.lower IS NOT NULL OR item.upper IS NOT NULL)";
  return where + ") OR (" + kValidAttempt + " AND " + kNotSuperseded + "))))";
}

std::string block_condition(const SlabFilter& filter, bool any) {
  // An aborted slab has no pass, whatever is stored.
  const bool passed = filter.verdict == Verdict::pass;
  std::string where =
      " AND ?8 <= slab.stations AND EXISTS (SELECT 1 FROM station_result AS s WHERE s.slab_key = slab.slab_key AND "
      "s.station = ?8 AND ";
  where += any      ? "(s.verdict <> 'pass' OR slab_result.verdict = 'aborted'))"
           : passed ? "s.verdict = ?7 AND slab_result.verdict <> 'aborted')"
                    : "s.verdict = ?7)";
  return where;
}

std::string condition(const SlabFilter& filter) {
  std::string where = "true";
  if (filter.since_utime_us || filter.until_utime_us)
    where += " AND slab.slab_key IN (SELECT slab_key FROM slab WHERE began_utime_us >= ?2 AND began_utime_us < ?3)";
  if (filter.slab_type != 0) where += " AND slab.slab_type = ?4";
  if (!filter.id_part.empty()) where += " AND instr(slab.slab_id, ?5) > 0";
  if (filter.mould != 0) where += " AND slab.mould = ?9";
  if (filter.disposition != Disposition::none)
    where +=
        " AND (SELECT decision FROM disposition WHERE disposition.slab_key = slab.slab_key ORDER BY n DESC LIMIT 1) = "
        "?10";
  const bool any = filter.verdict == Verdict::none;
  if (filter.item) {
    where += item_condition(filter, any);
  } else if (filter.block != 0) {
    where += block_condition(filter, any);
  } else if (!any) {
    where += " AND slab_result.verdict = ?7";
  }
  return where;
}

/// Keys of slabs in falling order, each once, from several statements that each give them in this order.
class FallingKeys {
 public:
  explicit FallingKeys(Connection& db) : db_(db) {}

  /// `sql`: one column, keys in falling order.
  Statement& add(const std::string& sql) {
    streams_.push_back({std::make_unique<Statement>(db_, sql), std::nullopt, true});
    return *streams_.back().rows;
  }
  [[nodiscard]] bool is_used() const { return !streams_.empty(); }

  std::optional<std::int64_t> next() {
    std::optional<std::int64_t> largest;
    for (Stream& stream : streams_) {
      while (stream.more && (!stream.key || *stream.key >= last_)) {
        stream.more = stream.rows->step();
        stream.key = stream.more ? std::optional(stream.rows->integer(0)) : std::nullopt;
      }
      if (stream.key && (!largest || *stream.key > *largest)) largest = stream.key;
    }
    if (largest) last_ = *largest;
    return largest;
  }

 private:
  struct Stream {
    std::unique_ptr<Statement> rows;
    std::optional<std::int64_t> key;
    bool more = true;
  };
  Connection& db_;
  std::vector<Stream> streams_;
  std::int64_t last_ = kForEver;
};

/// Adds the keys of the slabs that can match; none is added if all slabs can. A slab that has passed was measured, and
/// has passed, at every station (rule all_stations_pass).
void choose(const SlabFilter& filter, FallingKeys& keys) {
  const bool any = filter.verdict == Verdict::none;
  if (filter.verdict == Verdict::pass || (any && !filter.item && filter.block == 0)) return;
  bool not_passed = !filter.item;
  if (filter.item) {
    for (const Verdict verdict : {Verdict::fail, Verdict::indeterminate, Verdict::not_measured, Verdict::aborted}) {
      if (!any && filter.verdict != verdict) continue;
      keys.add(
              "SELECT slab_key FROM item INDEXED BY item_not_passed WHERE id = ?1 AND verdict = ?2 AND verdict NOT IN "
              "('pass', 'none') ORDER BY slab_key DESC")
          .bind(1, word(*filter.item))
          .bind(2, word(verdict));
    }
    not_passed = info(*filter.item).scope == ItemScope::block && (any || filter.verdict == Verdict::not_measured);
  }
  // With an item: the slabs with a station that was not measured, which are never undecided.
  if (not_passed)
    keys.add(std::string("SELECT slab_key FROM slab_result WHERE verdict <> 'pass'") +
             (filter.item ? " AND verdict <> 'indeterminate'" : "") + " ORDER BY slab_key DESC");
}

SlabSummary read_summary(Statement& rows) {
  SlabSummary summary;
  const int next = read_row(rows, 0, summary.header);
  if (!rows.is_null(next)) {
    summary.ended_utime_us = rows.integer(next);
    if (!from_word(rows.text(next + 1), summary.verdict)) rows.refuse(next + 1, "holds an unknown value");
    summary.reason = static_cast<std::uint16_t>(rows.integer(next + 2));
  }
  if (!rows.is_null(next + 3)) summary.disposition = disposition_named(rows.text(next + 3)).value_or(Disposition::none);
  summary.acknowledged = !rows.is_null(next + 4) && rows.integer(next + 4) == 1;
  summary.stations_measured = static_cast<int>(rows.integer(next + 5));
  return summary;
}

}  // namespace

std::string count_measured(std::string_view slab_key) {
  return "(SELECT count(*) FROM attempt AS a JOIN block USING (slab_key, station, attempt) WHERE a.slab_key = " +
         std::string(slab_key) +
         " AND phase = 'measured' AND block.verdict <> 'not_measured' AND a.attempt = "
         "(SELECT max(attempt) FROM attempt AS b WHERE b.slab_key = a.slab_key AND b.station = a.station))";
}

std::vector<SlabSummary> find_slabs(Connection& db, const SlabFilter& filter) {
  FallingKeys keys(db);
  choose(filter, keys);
  Statement rows(db,
                 "SELECT " + of_table("slab", names_of<SlabHeader>()) +
                     ", slab_result.ended_utime_us, slab_result.verdict, slab_result.reason, (SELECT decision FROM "
                     "disposition WHERE disposition.slab_key = slab.slab_key ORDER BY n DESC LIMIT 1), (SELECT "
                     "acknowledged FROM result WHERE result.slab_key = slab.slab_key AND kind = 2 AND is_repeat = 0 "
                     "ORDER BY id DESC LIMIT 1), " +
                     count_measured("slab.slab_key") + " FROM slab LEFT JOIN slab_result USING (slab_key) WHERE " +
                     (keys.is_used() ? "slab.slab_key = ?11 AND " : "") + condition(filter) +
                     " ORDER BY slab.slab_key DESC LIMIT ?1");
  rows.bind(1, count_of(filter.limit));
  if (filter.since_utime_us || filter.until_utime_us)
    rows.bind(2, filter.since_utime_us.value_or(-kForEver)).bind(3, filter.until_utime_us.value_or(kForEver));
  if (filter.slab_type != 0) rows.bind(4, std::int64_t{filter.slab_type});
  if (!filter.id_part.empty()) rows.bind(5, std::string_view(filter.id_part));
  if (filter.item) rows.bind(6, word(*filter.item));
  if (filter.verdict != Verdict::none) rows.bind(7, word(filter.verdict));
  if (filter.block != 0) rows.bind(8, std::int64_t{filter.block});
  if (filter.mould != 0) rows.bind(9, std::int64_t{filter.mould});
  if (filter.disposition != Disposition::none) rows.bind(10, name(filter.disposition));
  std::vector<SlabSummary> list;
  if (!keys.is_used()) {
    while (rows.step()) list.push_back(read_summary(rows));
    return list;
  }
  while (list.size() < filter.limit) {
    const std::optional<std::int64_t> key = keys.next();
    if (!key) break;
    if (rows.bind(11, *key).step()) list.push_back(read_summary(rows));
    rows.reset();
  }
  return list;
}

Inspections find_inspections(Connection& db, const InspectionFilter& filter) {
  Inspections found;
  Statement newest(db, "SELECT emulated FROM slab ORDER BY slab_key DESC LIMIT 1");
  if (newest.step()) found.emulated = static_cast<std::uint8_t>(newest.integer(0));
  newest.reset();
  std::string sql =
      "SELECT slab.slab_key, began_utime_us, slab_type, mould, verdict, reason, emulated, slab_id <> '' AND EXISTS "
      "(SELECT 1 FROM slab AS e CROSS JOIN slab_result AS r USING (slab_key) WHERE e.slab_id = slab.slab_id AND "
      "e.slab_key < slab.slab_key AND r.verdict <> 'aborted' AND (e.emulated <> 0) = ?3) FROM slab CROSS JOIN "
      "slab_result USING (slab_key) WHERE slab.slab_key IN (SELECT slab_key FROM slab WHERE began_utime_us >= ?1 AND "
      "began_utime_us < ?2)";
  if (filter.slab_type != 0) sql += " AND slab_type = ?4";
  Statement rows(db, sql + " ORDER BY slab.slab_key");
  rows.bind(1, filter.since_utime_us.value_or(-kForEver))
      .bind(2, filter.until_utime_us.value_or(kForEver))
      .bind(3, std::int64_t{found.emulated != 0});
  if (filter.slab_type != 0) rows.bind(4, std::int64_t{filter.slab_type});
  while (rows.step()) {
    const auto emulated = static_cast<std::uint8_t>(rows.integer(6));
    if ((emulated != 0) != (found.emulated != 0) && !filter.of_both_kinds) {
      ++found.others;
      continue;
    }
    Inspection& one = found.list.emplace_back();
    one.slab_key = rows.integer(0);
    one.began_utime_us = rows.integer(1);
    one.slab_type = static_cast<std::uint16_t>(rows.integer(2));
    one.mould = static_cast<std::uint16_t>(rows.integer(3));
    if (!from_word(rows.text(4), one.verdict)) rows.refuse(4, "holds an unknown value");
    one.reason = static_cast<std::uint16_t>(rows.integer(5));
    one.emulated = emulated;
    one.again = rows.integer(7) == 1;
  }
  return found;
}

}  // namespace slabd::storage
