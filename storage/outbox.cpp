// SPDX-License-Identifier: Apache-2.0
#include "storage/outbox.h"

#include <sqlite3.h>

#include <exception>
#include <utility>

#include "base/hex.h"
#include "storage/files/database.h"
#include "storage/seals.h"

namespace slabd::storage {
namespace {

/// Tables whose rows are never changed, and their columns when the first row was sent. A column that is added later
/// does not belong to the checksum: the same row always has the same one.
struct Subject {
  std::string_view kind;
  SealedTable table;
  std::string_view select;  ///< the row ?1 with its names
};
constexpr auto kSubjects = std::to_array<Subject>({
    {"applied",
     {"applied", "seq, kind, slab_type, is_rollback, calibration_id, replaced_id, before_seq, who, why, utime_us", "",
      "seq"},
     "SELECT applied.seq, applied.kind, applied.slab_type, is_rollback, calibration_id, replaced_id, who, why, "
     "utime_us, "
     "operator_name, robot_serial, scanner_serial, temperature_c, calibration.software, created_utime_us, "
     "nullif(expires_utime_us, 0) AS expires_utime_us FROM applied JOIN calibration ON calibration.id = calibration_id "
     "WHERE applied.seq = ?1"},
    {"check",
     {"calibration_check",
      "seq, kind, reference_id, hand_eye_id, passed, slope_rad, slope_U_rad, jaw_distance_mm, jaw_distance_U_mm, "
      "off_x, "
      "off_y, off_z, utime_us, who, source, note",
      "", "seq"},
     "SELECT seq, kind, reference_id, hand_eye_id, passed, slope_rad, slope_U_rad, jaw_distance_mm, jaw_distance_U_mm, "
     "off_x AS off_x_mm, off_y AS off_y_mm, off_z AS off_z_mm, utime_us, who, note FROM calibration_check WHERE seq = "
     "?1"},
    {"gauge_check",
     {"gauge_check", "seq, gauge, unit, value, master_value, master_u, within, passed, utime_us, who, why, source", "",
      "seq"},
     "SELECT seq, gauge, unit, value, master_value, master_u, within, passed, utime_us, who, why FROM gauge_check "
     "WHERE seq = ?1"},
    {"mould_reset",
     {"mould_reset", "seq, mould, from_utime_us, who, why, utime_us", "", "seq"},
     "SELECT seq, mould, from_utime_us, who, why, utime_us FROM mould_reset WHERE seq = ?1"},
    {"event",
     {"event", "seq, kind, code, text, utime_us", "", "seq"},
     "SELECT seq, kind, code, text, utime_us FROM event WHERE seq = ?1"},
});
/// The seal's entry names the row.
constexpr const char* kCare =
    "SELECT care.seq, what AS kind, slab_key, source, who, why, care.utime_us FROM care JOIN slab_seal ON about = "
    "care.seq "
    "WHERE slab_seal.seq = ?1 AND slab_seal.kind = 'care'";

const Subject* subject_of(std::string_view kind) {
  for (const Subject& subject : kSubjects)
    if (subject.kind == kind) return &subject;
  return nullptr;
}

StoredField field_at(const Statement& row, int column) {
  StoredField field{sqlite3_column_name(row.handle(), column), {}};
  switch (sqlite3_column_type(row.handle(), column)) {
    case SQLITE_INTEGER: field.value = row.integer(column); break;
    case SQLITE_FLOAT: field.value = row.real(column); break;
    case SQLITE_NULL: break;
    default: field.value = std::string(row.stored_text(column));
  }
  return field;
}

class SqliteOutbox final : public Outbox {
 public:
  SqliteOutbox(std::string path, std::unique_ptr<Connection> db) : path_(std::move(path)), db_(std::move(db)) {}

  Result<std::vector<Epoch>> epochs() override {
    return read([&] {
      std::vector<Epoch> list;
      for (Statement rows(*db_, "SELECT uuid, began_utime_us FROM epoch ORDER BY n"); rows.step();)
        list.push_back({std::string(rows.stored_text(0)), rows.integer(1)});
      return list;
    });
  }

  Result<std::int64_t> first_seq(std::string_view epoch) override {
    return read([&] {
      Statement first(*db_,
                      "SELECT coalesce(min(seq), 0) FROM outbox WHERE epoch = (SELECT n FROM epoch WHERE uuid = ?1)");
      first.bind(1, epoch);
      (void)first.step();
      return first.integer(0);
    });
  }

  Result<std::int64_t> sent_seq() override {
    return read([&] { return db_->integer("SELECT sent_seq FROM line"); });
  }

  Result<std::vector<OutboxRow>> rows_after(std::int64_t seq, std::size_t limit) override {
    return read([&] { return rows("seq > ?1", seq, limit); });
  }

  Result<std::optional<OutboxRow>> row(std::int64_t seq) override {
    return read([&]() -> std::optional<OutboxRow> {
      std::vector<OutboxRow> one = rows("seq = ?1", seq, 1);
      if (one.empty()) return std::nullopt;
      return std::move(one.front());
    });
  }

  Result<std::optional<StoredRow>> subject(const OutboxRow& row) override {
    return read([&]() -> std::optional<StoredRow> {
      const Subject* const known = subject_of(row.kind);
      if (known == nullptr && row.kind != "care") return std::nullopt;
      Statement one(*db_, known == nullptr ? kCare : std::string(known->select));
      if (!one.bind(1, row.about).step()) return std::nullopt;
      StoredRow fields;
      for (int i = 0; i < sqlite3_column_count(one.handle()); ++i) fields.push_back(field_at(one, i));
      return fields;
    });
  }

  Result<std::string> epoch_of_slab(std::int64_t slab_key) override {
    return read([&]() -> std::string {
      Statement first(*db_,
                      "SELECT uuid FROM outbox JOIN epoch ON epoch.n = outbox.epoch WHERE slab_key = ?1 AND "
                      "slab_key > 0 AND kind = 'slab' ORDER BY seq LIMIT 1");
      if (!first.bind(1, slab_key).step()) return {};
      return std::string(first.stored_text(0));
    });
  }

 private:
  template <typename Work>
  auto read(const Work& work) -> Result<decltype(work())> {
    try {
      Transaction transaction(*db_, "BEGIN");
      begin_to_read(*db_);
      auto value = work();
      transaction.commit();
      return value;
    } catch (const SqlFailure& failure) {
      return error(Code::journal_write, "%s: %s", path_.c_str(), failure.text.c_str());
    }
  }

  std::vector<OutboxRow> rows(const char* where, std::int64_t seq, std::size_t limit) {
    Statement found(*db_,
                    std::string("SELECT seq, uuid, kind, about, slab_key, utime_us FROM outbox JOIN epoch ON epoch.n "
                                "= outbox.epoch WHERE ") +
                        where + " ORDER BY seq LIMIT ?2");
    std::vector<OutboxRow> list;
    for (found.bind(1, seq).bind(2, static_cast<std::int64_t>(limit)); found.step();) {
      OutboxRow& row = list.emplace_back();
      row.seq = found.integer(0);
      row.epoch = found.stored_text(1);
      row.kind = found.stored_text(2);
      row.about = found.integer(3);
      row.slab_key = found.integer(4);
      row.utime_us = found.integer(5);
    }
    for (OutboxRow& row : list) row.sha256 = digest_of(row);
    return list;
  }

  std::string digest_of(const OutboxRow& row) {
    if (const Subject* const subject = subject_of(row.kind))
      return hex(rows_digest(*db_, subject->table, "seq", row.about));
    if (row.kind == "remeasured")
      return hex(Digest().text(row.kind).integer(row.slab_key).integer(row.about).integer(row.utime_us).take());
    Statement seal(*db_, "SELECT lower(hex(sha256)) FROM slab_seal WHERE seq = ?1");
    if (!seal.bind(1, row.about).step())
      throw SqlFailure{0, "row " + std::to_string(row.seq) + " of the outbox names seal " + std::to_string(row.about) +
                              ", which is not there"};
    return std::string(seal.stored_text(0));
  }

  std::string path_;
  std::unique_ptr<Connection> db_;
};

}  // namespace

Result<std::unique_ptr<Outbox>> open_outbox(const std::string& db_path) {
  Result<std::unique_ptr<Connection>> db = open_for_reading(db_path);
  if (!db.ok()) return db.error();
  return std::unique_ptr<Outbox>(std::make_unique<SqliteOutbox>(db_path, std::move(db.value())));
}

}  // namespace slabd::storage
