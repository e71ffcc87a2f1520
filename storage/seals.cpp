// SPDX-License-Identifier: Apache-2.0
#include "storage/seals.h"

#include <algorithm>
#include <vector>

namespace slabd::storage {
namespace {

constexpr std::string_view kEntry = "slabd seal 1";

std::span<const std::uint8_t> bytes_of(std::string_view text) {
  // An empty view may hold a null pointer.
  return {reinterpret_cast<const std::uint8_t*>(text.empty() ? "" : text.data()), text.size()};
}

Sha256 sha_at(const Statement& row, int column) {
  Sha256 sum{};
  const std::span<const std::uint8_t> bytes = row.bytes(column);
  if (bytes.size() != sum.size()) row.refuse(column, "is not a SHA-256");
  std::copy(bytes.begin(), bytes.end(), sum.begin());
  return sum;
}

}  // namespace

Sha256 seal_of(const Sha256& previous, const SealEntry& entry) {
  Digest digest;
  return digest.text(kEntry)
      .bytes(previous)
      .integer(entry.seq)
      .text(entry.kind)
      .integer(entry.form)
      .integer(entry.about)
      .integer(entry.slab_no)
      .text(entry.slab_id)
      .integer(entry.utime_us)
      .bytes(entry.rows)
      .take();
}

Seals::Seals(Connection& db)
    : db_(db),
      digests_(db, kSealForm),
      head_(db, "SELECT seq, sha256 FROM slab_seal ORDER BY seq DESC LIMIT 1"),
      insert_(db,
              "INSERT INTO slab_seal (seq, kind, form, about, slab_no, slab_id, utime_us, rows_sha256, sha256, tables) "
              "VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10)"),
      newest_of_(db,
                 "SELECT kind, form, rows_sha256 FROM slab_seal WHERE about = ?1 AND kind IN ('slab', 'reopened', "
                 "'pruned') ORDER BY seq DESC LIMIT 1"),
      slab_(db, "SELECT slab_no, slab_id FROM slab WHERE slab_key = ?1"),
      ended_(db, "SELECT ended_utime_us FROM slab_result WHERE slab_key = ?1"),
      now_(db, "SELECT newest_utime_us FROM line") {}

void Seals::append(SealEntry& entry, std::string_view tables) {
  Sha256 previous{};
  entry.seq = 1;
  if (head_.step()) {
    entry.seq = head_.integer(0) + 1;
    previous = sha_at(head_, 1);
    head_.reset();
  }
  const Sha256 sum = seal_of(previous, entry);
  insert_.bind(1, entry.seq)
      .bind(2, std::string_view(entry.kind))
      .bind(3, entry.form)
      .bind(4, entry.about)
      .bind(5, entry.slab_no)
      .bind(6, std::string_view(entry.slab_id))
      .bind(7, entry.utime_us)
      .bind(8, std::span<const std::uint8_t>(entry.rows))
      .bind(9, std::span<const std::uint8_t>(sum))
      .bind(10, bytes_of(tables))
      .run();
}

SealEntry Seals::newest_of(std::int64_t slab_key) {
  SealEntry entry;
  if (newest_of_.bind(1, slab_key).step()) {
    entry.kind = newest_of_.stored_text(0);
    entry.form = newest_of_.integer(1);
    entry.rows = sha_at(newest_of_, 2);
  }
  newest_of_.reset();
  return entry;
}

SealEntry Seals::about_slab(const char* kind, std::int64_t slab_key) {
  SealEntry entry;
  entry.kind = kind;
  entry.about = slab_key;
  if (slab_.bind(1, slab_key).step()) {
    entry.slab_no = slab_.integer(0);
    entry.slab_id = slab_.stored_text(1);
  }
  slab_.reset();
  if (now_.step()) entry.utime_us = now_.integer(0);
  now_.reset();
  return entry;
}

void Seals::begin() {
  const bool is_there = head_.step();
  head_.reset();
  if (is_there) return;
  SealEntry entry = about_slab("begun", 0);
  entry.about = db_.integer("SELECT coalesce(max(slab_key), 0) FROM slab_result");
  append(entry, {});
  std::vector<std::int64_t> gaps;
  for (Statement care(db_, "SELECT seq FROM care ORDER BY seq"); care.step();) gaps.push_back(care.integer(0));
  for (const std::int64_t seq : gaps) note_care(seq);
}

void Seals::seal(std::int64_t slab_key) {
  begin();
  SealEntry entry = about_slab("slab", slab_key);
  if (ended_.bind(1, slab_key).step()) entry.utime_us = ended_.integer(0);
  ended_.reset();
  const std::vector<Sha256>& tables = digests_.of(slab_key);
  entry.rows = digest_of(tables);
  const SealEntry last = newest_of(slab_key);
  if (last.kind == "slab" && last.form == kSealForm && last.rows == entry.rows) return;
  append(entry, {reinterpret_cast<const char*>(tables.data()), tables.size() * sizeof(Sha256)});
}

void Seals::seal_if_ended(std::int64_t slab_key) {
  const bool ended = ended_.bind(1, slab_key).step();
  ended_.reset();
  // A slab whose seal was deleted gets none by a late change.
  if (ended && newest_of(slab_key).kind == "slab") seal(slab_key);
}

void Seals::reopen(std::int64_t slab_key) {
  if (newest_of(slab_key).kind != "slab") return;
  SealEntry entry = about_slab("reopened", slab_key);
  append(entry, {});
}

void Seals::prune(std::int64_t slab_key) {
  begin();
  SealEntry entry = about_slab("pruned", slab_key);
  append(entry, {});
  Statement(db_, "UPDATE slab_seal SET tables = x'' WHERE about = ?1 AND kind = 'slab'").bind(1, slab_key).run();
}

void Seals::note_care(std::int64_t seq) {
  begin();
  SealEntry entry = about_slab("care", 0);
  entry.about = seq;
  entry.rows = care_digest(db_, seq);
  append(entry, {});
}

}  // namespace slabd::storage
