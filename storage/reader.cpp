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
#include "storage/search.h"
#include "storage/storage.h"
#include "storage/values.h"

namespace slabd::storage {

namespace {

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
  Result<Inspections> inspections(const InspectionFilter& filter) override {
    return read_value<Inspections>([&] { return find_inspections(*db_, filter); });
  }
  Result<std::vector<ItemValue>> values(const ItemFilter& filter) override {
    return read_value<std::vector<ItemValue>>(
        [&] { return std::move(read_values(*db_, filter, std::array{filter.item}).front()); });
  }
  Result<std::vector<std::vector<ItemValue>>> values_of(const ItemFilter& filter,
                                                        std::span<const ItemId> items) override {
    return read_value<std::vector<std::vector<ItemValue>>>([&] { return read_values(*db_, filter, items); });
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
  Result<std::optional<CalibrationRecord>> current(CalibrationKind kind, std::uint16_t slab_type,
                                                   std::string_view scanner) override {
    return read_value<std::optional<CalibrationRecord>>(
        [&] { return Calibrations(*db_).current(kind, slab_type, scanner); });
  }
  Result<std::unique_ptr<LineCalibration>> line_calibration(std::string_view scanner) override {
    auto calibration = std::make_unique<LineCalibration>();
    const Status status = read([&] { Calibrations(*db_).in_force(scanner, *calibration); });
    if (!status.ok()) return status.error();
    return calibration;
  }
  Result<std::unique_ptr<CellCalibration>> cell_calibration(const LineArms& arms) override {
    auto calibration = std::make_unique<CellCalibration>();
    const Status status = read([&] { Calibrations(*db_).in_force(arms, *calibration); });
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
  return log_is_in_doubt(db_path) || has_half_a_write(db_path);
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
