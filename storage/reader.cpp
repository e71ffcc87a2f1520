// SPDX-License-Identifier: Apache-2.0
//
// Reading while the daemon is running. Every call is one short read transaction with a consistent state. It must be
// short because the write-ahead log cannot be emptied beyond a reader's position.
#include <algorithm>
#include <array>
#include <exception>
#include <utility>

#include "storage/calibrations.h"
#include "storage/dispositions.h"
#include "storage/files/database.h"
#include "storage/files/log_copy.h"
#include "storage/gauges.h"
#include "storage/load.h"
#include "storage/moulds.h"
#include "storage/storage.h"

namespace slabd::storage {

// Searches among tens of thousands of slabs, one statement each. The newest slabs are visited by their key, and the
// searched rows are found by that key. The limit therefore bounds the cost, not the size of the database.

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

std::string condition(const SlabFilter& filter) {
  std::string where = "slab.began_utime_us >= ?2 AND slab.began_utime_us < ?3";
  if (filter.slab_type != 0) where += " AND slab.slab_type = ?4";
  if (!filter.id_part.empty()) where += " AND instr(slab.slab_id, ?5) > 0";
  if (filter.mould != 0) where += " AND slab.mould = ?9";
  if (filter.disposition != Disposition::none)
    where +=
        " AND (SELECT decision FROM disposition WHERE disposition.slab_key = slab.slab_key ORDER BY n DESC LIMIT 1) = "
        "?10";
  const bool any = filter.verdict == Verdict::none;
  if (filter.item) {
    const bool also_unseen =
        info(*filter.item).scope == ItemScope::block && (any || filter.verdict == Verdict::not_measured);
    where += " AND (";
    if (also_unseen) where += (filter.block != 0 ? kIsUnseen : kHasUnseen) + std::string(" OR ");
    where += "EXISTS (SELECT 1 FROM item WHERE item.slab_key = slab.slab_key AND item.id = ?6 AND ";
    where += any ? "item.verdict NOT IN ('pass', 'none')" : "item.verdict = ?7";
    if (filter.block != 0)
      where += " AND (item.station = ?8 OR (item.station = 0 AND ?8 IN (item.from_station, item.to_station)))";
    // A block's item in the slab's frame may be only information; then the block's own item is the judged one.
    const bool may_inform = info(*filter.item).scope == ItemScope::block;
    where += " AND ((item.station = 0";
    if (may_inform) where += " AND (item.lower IS NOT NULL OR item.upper IS NOT NULL)";
    where += std::string(") OR (") + kValidAttempt + " AND " + kNotSuperseded + "))))";
  } else if (filter.block != 0) {
    where +=
        " AND ?8 <= slab.stations AND EXISTS (SELECT 1 FROM station_result AS s WHERE s.slab_key = slab.slab_key AND "
        "s.station = ?8 AND ";
    // An aborted slab has no pass, whatever is stored.
    const bool passed = filter.verdict == Verdict::pass;
    where += any      ? "(s.verdict <> 'pass' OR slab_result.verdict = 'aborted'))"
             : passed ? "s.verdict = ?7 AND slab_result.verdict <> 'aborted')"
                      : "s.verdict = ?7)";
  } else if (!any) {
    where += " AND slab_result.verdict = ?7";
  }
  return where;
}

/// SQL in parentheses: number of stations whose valid attempt has a result other than `not_measured`. `slab_key` is an
/// expression of the surrounding statement.
std::string count_measured(std::string_view slab_key) {
  return "(SELECT count(*) FROM attempt AS a JOIN block USING (slab_key, station, attempt) WHERE a.slab_key = " +
         std::string(slab_key) +
         " AND phase = 'measured' AND block.verdict <> 'not_measured' AND a.attempt = "
         "(SELECT max(attempt) FROM attempt AS b WHERE b.slab_key = a.slab_key AND b.station = a.station))";
}

std::vector<SlabSummary> find_slabs(Connection& db, const SlabFilter& filter) {
  const std::vector<std::string> header = names_of<SlabHeader>();
  Statement rows(
      db,
      "SELECT " + of_table("slab", header) +
          ", slab_result.ended_utime_us, slab_result.verdict, slab_result.reason, (SELECT decision FROM disposition "
          "WHERE disposition.slab_key = slab.slab_key ORDER BY n DESC LIMIT 1), " +
          (filter.counts ? "(SELECT acknowledged FROM result WHERE result.slab_key = slab.slab_key AND kind = 2 "
                           "AND is_repeat = 0 ORDER BY id DESC LIMIT 1), " +
                               count_measured("slab.slab_key")
                         : "NULL, 0") +
          " FROM slab LEFT JOIN slab_result USING (slab_key) WHERE " + condition(filter) +
          " ORDER BY slab.slab_key DESC LIMIT ?1");
  rows.bind(1, count_of(filter.limit))
      .bind(2, filter.since_utime_us.value_or(-kForEver))
      .bind(3, filter.until_utime_us.value_or(kForEver));
  if (filter.slab_type != 0) rows.bind(4, std::int64_t{filter.slab_type});
  if (!filter.id_part.empty()) rows.bind(5, std::string_view(filter.id_part));
  if (filter.item) rows.bind(6, word(*filter.item));
  if (filter.verdict != Verdict::none) rows.bind(7, word(filter.verdict));
  if (filter.block != 0) rows.bind(8, std::int64_t{filter.block});
  if (filter.mould != 0) rows.bind(9, std::int64_t{filter.mould});
  if (filter.disposition != Disposition::none) rows.bind(10, name(filter.disposition));
  std::vector<SlabSummary> list;
  while (rows.step()) {
    SlabSummary& summary = list.emplace_back();
    const int next = read_row(rows, 0, summary.header);
    if (!rows.is_null(next)) {
      summary.ended_utime_us = rows.integer(next);
      if (!from_word(rows.text(next + 1), summary.verdict)) rows.refuse(next + 1, "holds an unknown value");
      summary.reason = static_cast<std::uint16_t>(rows.integer(next + 2));
    }
    if (!rows.is_null(next + 3))
      summary.disposition = disposition_named(rows.text(next + 3)).value_or(Disposition::none);
    summary.acknowledged = !rows.is_null(next + 4) && rows.integer(next + 4) == 1;
    summary.stations_measured = static_cast<int>(rows.integer(next + 5));
  }
  return list;
}

namespace {

/// SQL of the table `chosen`: the slabs that match the filter; ?1 .. ?4 and ?7 are the filter's values.
std::string chosen_slabs(const ItemFilter& filter) {
  std::string sql =
      "WITH chosen AS (SELECT slab_key, slab_id, began_utime_us, slab_type, stations, emulated FROM slab CROSS JOIN "
      "slab_result "
      "USING (slab_key) WHERE slab_result.verdict <> 'aborted' AND began_utime_us >= ?2 AND began_utime_us < ?3";
  if (filter.slab_type != 0) sql += " AND slab_type = ?4";
  if (filter.mould != 0) sql += " AND mould = ?7";
  return sql + " ORDER BY slab_key DESC LIMIT ?1) ";
}

void bind_slabs(Statement& rows, const ItemFilter& filter) {
  rows.bind(1, count_of(filter.slabs))
      .bind(2, filter.since_utime_us.value_or(-kForEver))
      .bind(3, filter.until_utime_us.value_or(kForEver));
  if (filter.slab_type != 0) rows.bind(4, std::int64_t{filter.slab_type});
  if (filter.mould != 0) rows.bind(7, std::int64_t{filter.mould});
}

/// Adds a not_measured value for every station whose valid attempt has no items.
void add_unseen(Connection& db, const ItemFilter& filter, std::vector<ItemValue>& list) {
  Statement slabs(db,
                  chosen_slabs(filter) +
                      "SELECT slab_key, slab_id, began_utime_us, slab_type, stations, emulated FROM chosen ORDER BY "
                      "slab_key");
  bind_slabs(slabs, filter);
  Statement any_item(
      db, std::string("SELECT 1 FROM item WHERE slab_key = ?1 AND station = ?2 AND ") + kValidAttempt + " LIMIT 1");
  std::vector<ItemValue> unseen;
  std::size_t at = 0;
  while (slabs.step()) {
    ItemValue value;
    value.slab_key = slabs.integer(0);
    value.slab_id.assign(slabs.text(1));
    value.began_utime_us = slabs.integer(2);
    value.slab_type = static_cast<std::uint16_t>(slabs.integer(3));
    value.emulated = static_cast<std::uint8_t>(slabs.integer(5));
    value.item.id = filter.item;
    value.item.verdict = Verdict::not_measured;
    std::array<bool, limits::kStationsMax + 1> seen{};
    for (; at < list.size() && list[at].slab_key == value.slab_key; ++at) seen.at(list[at].item.station) = true;
    const auto stations = static_cast<int>(slabs.integer(4));
    for (int station = 1; station <= stations; ++station) {
      if (seen.at(static_cast<std::size_t>(station)) || (filter.block != 0 && filter.block != station)) continue;
      if (!any_item.bind(1, value.slab_key).bind(2, std::int64_t{station}).step()) {
        value.item.station = static_cast<std::uint8_t>(station);
        unseen.push_back(value);
      }
      any_item.reset();
    }
  }
  if (unseen.empty()) return;
  list.insert(list.end(), unseen.begin(), unseen.end());
  std::stable_sort(list.begin(), list.end(), [](const ItemValue& a, const ItemValue& b) {
    return std::pair(a.slab_key, a.item.station) < std::pair(b.slab_key, b.item.station);
  });
}

}  // namespace

std::vector<ItemValue> find_values(Connection& db, const ItemFilter& filter) {
  // CROSS JOIN fixes the order of the tables: from the chosen slabs to their items, not from all items of that name.
  // For each place the slab's own judged rows (station 0) come first, so that the replaced value of a block is skipped.
  // Rows for information come last.
  std::string sql =
      chosen_slabs(filter) +
      "SELECT chosen.slab_key, chosen.slab_id, chosen.began_utime_us, "
      "CASE WHEN item.station > 0 THEN item.station ELSE item.from_station END AS place, item.to_station, "
      "item.verdict, item.required, item.value, item.nominal, item.lower, item.upper, item.U, chosen.slab_type, "
      "chosen.emulated "
      "FROM chosen CROSS JOIN item ON item.slab_key = chosen.slab_key AND item.id = ?5 WHERE (item.station = 0 OR ";
  sql += kValidAttempt;
  sql += ")";
  if (filter.block != 0) sql += " AND place = ?6";
  sql +=
      " ORDER BY chosen.slab_key, place, CASE WHEN item.station > 0 THEN 1 WHEN item.lower IS NULL AND item.upper IS "
      "NULL THEN 2 ELSE 0 END";
  Statement rows(db, sql);
  bind_slabs(rows, filter);
  rows.bind(5, word(filter.item));
  if (filter.block != 0) rows.bind(6, std::int64_t{filter.block});
  std::vector<ItemValue> list;
  while (rows.step()) {
    ItemValue value;
    value.slab_key = rows.integer(0);
    value.slab_id.assign(rows.text(1));
    value.began_utime_us = rows.integer(2);
    value.item.id = filter.item;
    value.item.station = static_cast<std::uint8_t>(rows.integer(3));
    value.item.station_to = static_cast<std::uint8_t>(rows.integer(4));
    if (!list.empty() && list.back().slab_key == value.slab_key && list.back().item.station == value.item.station &&
        list.back().item.station_to == value.item.station_to)
      continue;
    if (!from_word(rows.text(5), value.item.verdict)) rows.refuse(5, "holds an unknown value");
    value.item.required = rows.integer(6) == 1;
    value.item.value = rows.real(7);
    value.item.nominal = rows.real(8);
    value.item.lower = rows.real(9);
    value.item.upper = rows.real(10);
    value.item.U = rows.real(11);
    value.slab_type = static_cast<std::uint16_t>(rows.integer(12));
    value.emulated = static_cast<std::uint8_t>(rows.integer(13));
    list.push_back(value);
  }
  if (info(filter.item).scope == ItemScope::block) add_unseen(db, filter, list);
  return list;
}

class SqliteReader final : public Reader {
 public:
  SqliteReader(std::unique_ptr<Connection> db, std::string path)
      : db_(std::move(db)),
        path_(std::move(path)),
        loader_(*db_),
        find_id_(*db_, "SELECT slab_key FROM slab WHERE slab_id = ?1 OR trim(slab_id) = ?1 ORDER BY slab_key DESC"),
        find_no_(*db_, "SELECT slab_key FROM slab WHERE slab_no = ?1 ORDER BY slab_key DESC"),
        acknowledged_(*db_,
                      "SELECT acknowledged FROM result WHERE slab_key = ?1 AND kind = 2 AND is_repeat = 0 "
                      "ORDER BY id DESC LIMIT 1"),
        measured_(*db_, "SELECT " + count_measured("?1")) {}

  Result<std::vector<SlabSummary>> slabs(const SlabFilter& filter) override {
    return read_value<std::vector<SlabSummary>>([&] { return find_slabs(*db_, filter); });
  }
  Result<std::vector<ItemValue>> values(const ItemFilter& filter) override {
    return read_value<std::vector<ItemValue>>([&] { return find_values(*db_, filter); });
  }

  Result<MouldRecords> mould_records(const MouldFilter& filter) override {
    return read_value<MouldRecords>([&] { return Moulds(*db_).records(filter); });
  }

  Result<std::vector<GaugeCheckRecord>> gauge_checks(std::string_view gauge, std::size_t limit) override {
    return read_value<std::vector<GaugeCheckRecord>>([&] { return Gauges(*db_).checks(gauge, limit); });
  }
  Result<std::vector<GaugeSlabValue>> gauge_values(std::string_view gauge, std::size_t limit) override {
    return read_value<std::vector<GaugeSlabValue>>([&] { return Gauges(*db_).values(gauge, limit); });
  }

  Result<std::optional<SlabRecord>> slab(std::int64_t key) override {
    std::optional<SlabRecord> record;
    const Status status = read([&] {
      const std::optional<SlabHeader> header = loader_.slab(key);
      if (!header) return;
      record.emplace();
      record->summary = summary(*header, record->slab);
      record->dispositions = Dispositions(*db_).of_slab(key);
      if (!record->dispositions.empty()) record->summary.disposition = record->dispositions.back().decision;
      for (const StoredAttempt& stored : loader_.attempts(key)) record->blocks.push_back(block(stored, record->slab));
    });
    if (!status.ok()) return status.error();
    return record;
  }

  Result<std::vector<std::int64_t>> find_id(std::string_view slab_id) override {
    return read_value<std::vector<std::int64_t>>([&] { return keys_of(find_id_.bind(1, slab_id)); });
  }
  Result<std::vector<std::int64_t>> find_no(std::uint32_t slab_no) override {
    return read_value<std::vector<std::int64_t>>([&] { return keys_of(find_no_.bind(1, std::int64_t{slab_no})); });
  }

  Result<std::unique_ptr<BlockMaps>> maps(std::int64_t key, int station, int attempt) override {
    auto maps = std::make_unique<BlockMaps>();
    const Status status = read([&] {
      loader_.maps({key, static_cast<std::uint8_t>(station), static_cast<std::uint8_t>(attempt)}, *maps);
    });
    if (!status.ok()) return status.error();
    return maps;
  }

  Result<std::optional<RecipeText>> recipe_text(std::string_view sha256) override {
    return read_value<std::optional<RecipeText>>([&] { return find_recipe_text(sha256); });
  }

  Result<std::vector<HistoryGap>> gaps() override {
    return read_value<std::vector<HistoryGap>>([&] { return find_gaps(); });
  }

  Result<std::vector<CalibrationRecord>> calibrations() override {
    return read_value<std::vector<CalibrationRecord>>([&] { return Calibrations(*db_).all(); });
  }
  Result<std::optional<CalibrationRecord>> calibration(std::string_view id) override {
    return read_value<std::optional<CalibrationRecord>>([&] { return Calibrations(*db_).find(id); });
  }
  Result<std::optional<CalibrationRecord>> current(CalibrationKind kind, std::uint16_t slab_type) override {
    return read_value<std::optional<CalibrationRecord>>([&] { return Calibrations(*db_).current(kind, slab_type); });
  }
  Result<std::unique_ptr<LineCalibration>> line_calibration() override {
    auto calibration = std::make_unique<LineCalibration>();
    const Status status = read([&] { Calibrations(*db_).in_force(*calibration); });
    if (!status.ok()) return status.error();
    return calibration;
  }
  Result<std::vector<AppliedChange>> applied(std::size_t limit) override {
    return read_value<std::vector<AppliedChange>>([&] { return Calibrations(*db_).applied(limit); });
  }
  Result<std::vector<CalibrationCheck>> checks(std::size_t limit) override {
    return read_value<std::vector<CalibrationCheck>>([&] { return Calibrations(*db_).checks(limit); });
  }

 private:
  template <typename T, typename Work>
  Result<T> read_value(const Work& work) {
    T value;
    const Status status = read([&] { value = work(); });
    if (!status.ok()) return status.error();
    return value;
  }

  static std::vector<std::int64_t> keys_of(Statement& rows) {
    std::vector<std::int64_t> keys;
    while (rows.step()) keys.push_back(rows.integer(0));
    rows.reset();
    return keys;
  }

  std::optional<RecipeText> find_recipe_text(std::string_view sha256) {
    std::optional<RecipeText> found;
    if (sha256.empty()) return found;
    Statement rows(*db_,
                   "SELECT sha256, name, text, kept_utime_us FROM recipe_text "
                   "WHERE substr(sha256, 1, length(?1)) = ?1 LIMIT 2");
    rows.bind(1, sha256);
    while (rows.step()) {
      if (found) return std::nullopt;  // ambiguous prefix
      found.emplace();
      found->sha256.assign(rows.text(0));
      found->name.assign(rows.text(1));
      found->text = rows.stored_text(2);
      found->kept_utime_us = rows.integer(3);
    }
    return found;
  }

  std::vector<HistoryGap> find_gaps() {
    std::vector<HistoryGap> gaps;
    Statement line(*db_, "SELECT pruned_key, pruned_slabs FROM line WHERE pruned_slabs > 0");
    while (line.step()) {
      HistoryGap& gap = gaps.emplace_back();
      gap.what = HistoryGap::What::pruned;
      gap.slab_key = line.integer(0);
      gap.slabs = line.integer(1);
    }
    Statement care(*db_,
                   "SELECT what, care.slab_key, source, who, why, utime_us, (SELECT coalesce(max(slab.slab_key), 0) "
                   "FROM slab WHERE slab.slab_key <= care.slab_key), (SELECT pruned_key FROM line) FROM care ORDER BY "
                   "seq");
    while (care.step()) {
      HistoryGap& gap = gaps.emplace_back();
      gap.what = care.text(0) == "restored" ? HistoryGap::What::restored : HistoryGap::What::begun_anew;
      gap.slab_key = care.integer(1);
      gap.source = care.text(2);
      gap.note.who = care.text(3);
      gap.note.why = care.text(4);
      gap.note.utime_us = care.integer(5);
      // Retention may have deleted the newest slab of the backup; then kept_key is unknown.
      gap.kept_key = care.integer(6) > care.integer(7) ? care.integer(6) : 0;
    }
    return gaps;
  }

  SlabSummary summary(const SlabHeader& header, SlabResult& result) {
    SlabSummary s;
    s.header = header;
    result = {};
    if (loader_.slab_result(header.key, result, s.ended_utime_us)) {
      s.verdict = result.verdict;
      s.reason = result.reason;
    }
    if (acknowledged_.bind(1, header.key).step()) s.acknowledged = acknowledged_.integer(0) == 1;
    acknowledged_.reset();
    if (measured_.bind(1, header.key).step()) s.stations_measured = static_cast<int>(measured_.integer(0));
    measured_.reset();
    return s;
  }

  SlabBlock block(const StoredAttempt& stored, const SlabResult& result) {
    SlabBlock b;
    b.attempt = stored.attempt;
    b.phase = stored.state.phase;
    b.code = stored.state.code;
    // A failed attempt has no block; then the verdict of `b.block` is none.
    static_cast<void>(loader_.block({b.attempt.slab_key, b.attempt.station, b.attempt.number}, b.block));
    b.final_verdict = result.station_verdict[b.attempt.station - 1U];
    b.final_reason = result.station_reason[b.attempt.station - 1U];
    return b;
  }

  template <typename Work>
  Status read(const Work& work) {
    try {
      Transaction transaction(*db_, "BEGIN");
      begin_to_read(*db_);
      work();
      transaction.commit();
      return success();
    } catch (const SqlFailure& failure) {
      return error(Code::journal_write, "cannot read database %s: %s", path_.c_str(), failure.text.c_str());
    } catch (const std::exception& e) {
      return error(Code::internal, "cannot read database %s: %s", path_.c_str(), e.what());
    }
  }

  std::unique_ptr<Connection> db_;
  std::string path_;
  Loader loader_;
  Statement find_id_;
  Statement find_no_;
  Statement acknowledged_;
  Statement measured_;
};

}  // namespace

bool is_unused(const std::string& db_path) {
  return unused_at(db_path);
}

bool is_unfinished(const std::string& db_path) {
  return log_is_in_doubt(db_path);
}

Result<std::unique_ptr<Reader>> open_reader(const std::string& db_path, TextFor text) {
  Result<std::unique_ptr<Connection>> db = open_for_reading(db_path);
  if (!db.ok()) return db.error();
  if (text == TextFor::people) db.value()->read_plain_text();
  try {
    return std::unique_ptr<Reader>(std::make_unique<SqliteReader>(std::move(db.value()), db_path));
  } catch (const SqlFailure& failure) {
    return error(Code::config, "cannot use database %s: %s", db_path.c_str(), failure.text.c_str());
  }
}

}  // namespace slabd::storage
