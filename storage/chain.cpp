// SPDX-License-Identifier: Apache-2.0
#include "storage/chain.h"

#include <algorithm>
#include <map>
#include <memory>
#include <set>
#include <utility>
#include <vector>

#include "base/hex.h"
#include "base/plain_text.h"
#include "storage/calibrations.h"
#include "storage/files/database.h"
#include "storage/seals.h"
#include "storage/storage.h"

namespace slabd::storage {
namespace {

std::string slab_words(const SealEntry& entry) {
  return "slab key " + std::to_string(entry.about) + " (number " + std::to_string(entry.slab_no) + ", \"" +
         plain(entry.slab_id, Lines::replaced) + "\")";
}

std::string words(const SealEntry& entry) {
  const std::string where = "entry " + std::to_string(entry.seq) + " of the chain, ";
  if (entry.kind == "slab") return where + "the seal of " + slab_words(entry) + ",";
  if (entry.kind == "care") return where + "about gap " + std::to_string(entry.about) + " of the history,";
  if (entry.kind == "begun") return where + "its beginning,";
  if (entry.kind == "decided") return where + "a decision about " + slab_words(entry) + ",";
  return where + plain(entry.kind, Lines::replaced) + " " + slab_words(entry) + ",";
}

class Examination {
 public:
  Examination(Connection& db, std::int64_t asked) : db_(db), asked_(asked) {}

  ChainReport run() {
    walk();
    compare_slabs();
    look_for_added_slabs();
    compare_gaps();
    compare_decisions();
    compare_texts();
    return std::move(report_);
  }

 private:
  void altered(std::string what) {
    ++report_.altered;
    if (report_.trouble.empty()) report_.trouble = std::move(what);
  }

  SealEntry entry_of(const Statement& row) {
    SealEntry entry;
    entry.seq = row.integer(0);
    entry.kind = row.stored_text(1);
    entry.form = row.integer(2);
    entry.about = row.integer(3);
    entry.slab_no = row.integer(4);
    entry.slab_id = row.stored_text(5);
    entry.utime_us = row.integer(6);
    rows_length_ok_ = take(row, 7, entry.rows);
    return entry;
  }
  static bool take(const Statement& row, int column, Sha256& sum) {
    const std::span<const std::uint8_t> bytes = row.bytes(column);
    if (bytes.size() != sum.size()) return false;
    std::copy(bytes.begin(), bytes.end(), sum.begin());
    return true;
  }

  void walk() {
    Statement rows(db_, std::string(kSelect) + "ORDER BY seq");
    Sha256 previous{};
    std::int64_t expected = 1;
    while (rows.step()) {
      const SealEntry entry = entry_of(rows);
      const bool follows = entry.seq == expected;
      if (!follows)
        altered("entries " + std::to_string(expected) + " to " + std::to_string(entry.seq - 1) +
                " of the chain are missing");
      expected = entry.seq + 1;
      ++report_.entries;
      Sha256 sum{};
      const bool whole = take(rows, 8, sum) && rows_length_ok_;
      // After a gap the previous entry is unknown, and the gap is already reported.
      if (!whole || (follows && sum != seal_of(previous, entry)))
        altered(words(entry) + " was altered");
      else if (entry.kind == "slab" && !tables_fit(rows.bytes(9), entry.rows))
        altered(words(entry) + " was altered");
      if (entry.seq == 1 && entry.kind != "begun") altered("the chain does not begin with its beginning");
      note(entry);
      previous = sum;
      if (entry.seq == asked_) report_.asked = hex(sum);
    }
    if (report_.entries > 0) report_.head = hex(previous);
  }

  static bool tables_fit(std::span<const std::uint8_t> tables, const Sha256& rows) {
    if (tables.empty()) return true;
    Digest digest;
    return digest.bytes(tables).take() == rows;
  }

  void note(const SealEntry& entry) {
    if (entry.kind == "begun") begun_key_ = std::max(begun_key_, entry.about);
    if (entry.kind == "slab") sealed_[entry.about] = entry.seq;
    if (entry.kind == "reopened" || entry.kind == "pruned") sealed_.erase(entry.about);
    if (entry.kind == "pruned") ++report_.pruned;
    if (entry.kind == "pruned" && entry.about <= begun_key_) pruned_before_.insert(entry.about);
    if (entry.kind == "care") gaps_[entry.about] = entry.rows;
    if (entry.kind == "decided") decided_[entry.about] = entry;
    if (entry.kind == "pruned") decided_.erase(entry.about);
  }

  /// Compares the sealed slabs in the order of the chain.
  void compare_slabs() {
    std::vector<std::int64_t> in_order;
    for (const auto& [key, seq] : sealed_) in_order.push_back(seq);
    std::sort(in_order.begin(), in_order.end());
    Statement one(db_, std::string(kSelect) + "WHERE seq = ?1");
    Statement exists(db_, "SELECT 1 FROM slab WHERE slab_key = ?1");
    for (const std::int64_t seq : in_order) {
      if (!one.bind(1, seq).step()) continue;
      const SealEntry entry = entry_of(one);
      const std::span<const std::uint8_t> bytes = one.bytes(9);
      const std::vector<std::uint8_t> tables(bytes.begin(), bytes.end());
      one.reset();
      const bool there = exists.bind(1, entry.about).step();
      exists.reset();
      if (!there) {
        altered(slab_words(entry) + " was deleted");
        continue;
      }
      compare_slab(entry, tables);
    }
  }

  void compare_slab(const SealEntry& entry, const std::vector<std::uint8_t>& tables) {
    const std::span<const SealedTable> form = sealed_tables(entry.form);
    if (form.empty()) {
      altered(words(entry) + " has form " + std::to_string(entry.form) + ", which this program does not support");
      return;
    }
    std::unique_ptr<SlabDigests>& digests = digests_[entry.form];
    if (!digests) digests = std::make_unique<SlabDigests>(db_, entry.form);
    const std::vector<Sha256>& now = digests->of(entry.about);
    ++report_.sealed;
    if (digest_of(now) == entry.rows) return;
    std::string names;
    for (std::size_t i = 0; i < now.size() && tables.size() == now.size() * sizeof(Sha256); ++i)
      if (!std::equal(now[i].begin(), now[i].end(), tables.begin() + static_cast<std::ptrdiff_t>(i * sizeof(Sha256))))
        names += (names.empty() ? "" : ", ") + std::string(form[i].name);
    altered(slab_words(entry) + " was altered: table " + (names.empty() ? "unknown" : names));
  }

  void look_for_added_slabs() {
    Statement ended(db_,
                    "SELECT slab_key, slab_no, slab_id, slab_result.slab_key IS NOT NULL, slab_key = (SELECT "
                    "max(slab_key) FROM slab) FROM slab LEFT JOIN slab_result USING (slab_key) ORDER BY slab_key");
    while (ended.step()) {
      SealEntry entry;
      entry.about = ended.integer(0);
      if (sealed_.contains(entry.about)) continue;
      entry.slab_no = ended.integer(1);
      entry.slab_id = ended.stored_text(2);
      const bool has_ended = ended.integer(3) == 1;
      const bool is_newest = ended.integer(4) == 1;
      if (pruned_before_.contains(entry.about))
        altered(slab_words(entry) + " was added: retention took it away");
      else if (has_ended && report_.entries > 0 && entry.about > begun_key_)
        altered(slab_words(entry) + " has no seal: it was added, or its seal was deleted");
      else if (has_ended)
        ++report_.unsealed;
      else if (!is_newest)
        altered(slab_words(entry) + " has not ended, and newer slabs are there: it was added");
    }
  }

  void compare_gaps() {
    if (report_.entries == 0) return;
    std::set<std::int64_t> there;
    for (Statement care(db_, "SELECT seq FROM care ORDER BY seq"); care.step();) there.insert(care.integer(0));
    for (const auto& [seq, rows] : gaps_)
      if (!there.contains(seq))
        altered("gap " + std::to_string(seq) + " of the history was deleted: table care");
      else if (care_digest(db_, seq) != rows)
        altered("gap " + std::to_string(seq) + " of the history was altered: table care");
    for (const std::int64_t seq : there)
      if (!gaps_.contains(seq)) altered("gap " + std::to_string(seq) + " of the history was added: table care");
  }

  void compare_decisions() {
    if (report_.entries == 0) return;
    for (const auto& [key, entry] : decided_)
      if (decisions_digest(db_, key) != entry.rows)
        altered("the decisions about " + slab_words(entry) + " were altered: table disposition");
    Statement rows(db_, "SELECT DISTINCT slab_key FROM disposition ORDER BY slab_key");
    while (rows.step())
      if (!decided_.contains(rows.integer(0)))
        altered("a decision about slab key " + std::to_string(rows.integer(0)) + " was added: table disposition");
  }

  /// Compares recipes and calibrations with the checksum in their name.
  void compare_texts() {
    Statement texts(db_, "SELECT sha256, name, text FROM recipe_text ORDER BY kept_utime_us, sha256");
    Digest digest;
    while (texts.step()) {
      const std::string_view text = texts.stored_text(2);
      const std::string sum =
          hex(digest.bytes({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}).take());
      if (sum != texts.stored_text(0))
        altered("recipe " + plain(texts.stored_text(1), Lines::replaced) + " (SHA-256 " +
                plain(texts.stored_text(0), Lines::replaced) + ") was altered: table recipe_text");
    }
    for (const CalibrationRecord& record : Calibrations(db_).all())
      if (calibration_id(record) != record.id)
        altered("calibration " + plain(record.id, Lines::replaced) +
                " was altered: its numbers are not those of its id");
  }

  static constexpr std::string_view kSelect =
      "SELECT seq, kind, form, about, slab_no, slab_id, utime_us, rows_sha256, sha256, tables FROM slab_seal ";

  Connection& db_;
  std::int64_t asked_;
  ChainReport report_;
  bool rows_length_ok_ = true;
  std::int64_t begun_key_ = 0;
  std::map<std::int64_t, std::int64_t> sealed_;  ///< newest valid seal by slab key
  std::set<std::int64_t> pruned_before_;         ///< pruned slabs that never had a seal
  std::map<std::int64_t, Sha256> gaps_;
  std::map<std::int64_t, SealEntry> decided_;  ///< newest entry about decisions by slab key
  std::map<std::int64_t, std::unique_ptr<SlabDigests>> digests_;
};

}  // namespace

Result<ChainReport> check_chain(const std::string& path, std::int64_t entry) {
  Result<std::unique_ptr<Connection>> opened = open_any_version(path);
  if (!opened.ok()) return opened.error();
  Connection& db = *opened.value();
  try {
    Transaction moment(db, "BEGIN");
    begin_to_read(db);
    ChainReport report = Examination(db, entry).run();
    moment.commit();
    return report;
  } catch (const SqlFailure& failure) {
    return error(Code::journal_write, "the chain of results of %s cannot be read: %s", path.c_str(),
                 failure.text.c_str());
  }
}

}  // namespace slabd::storage
