// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "storage/files/sqlite.h"

namespace slabd::storage {

// Canonical form of a slab's stored data, and its SHA-256.
//
// A form is a list of tables, columns and row orders. It is frozen, because seals made with it are checked with it
// permanently. A schema that adds columns adds a form. A value is hashed as its type (one letter) and its bytes:
// numbers most significant byte first, texts and blobs after their length. A form excludes data that may change after
// the end of a slab. These are result.acknowledged and repeated records, attempt.scan_state and measuring_since_ns,
// and commands.

inline constexpr std::int64_t kSealForm = 2;

using Sha256 = std::array<std::uint8_t, 32>;

/// Incremental SHA-256 of values.
class Digest {
 public:
  Digest();
  ~Digest();
  Digest(const Digest&) = delete;
  Digest& operator=(const Digest&) = delete;
  Digest& bytes(std::span<const std::uint8_t> value);
  Digest& text(std::string_view value);  ///< length, then the bytes
  Digest& integer(std::int64_t value);   ///< 8 bytes, most significant first
  Digest& column(const Statement& row, int column);
  /// Returns the SHA-256 of all values since the last call, and starts again.
  [[nodiscard]] Sha256 take();

 private:
  void put(const void* data, std::size_t size);
  struct Sum;
  std::unique_ptr<Sum> sum_;
};

/// One table of a form.
struct SealedTable {
  std::string_view name;
  std::string_view columns;
  std::string_view where;  ///< condition in addition to slab_key = ?1
  std::string_view order;
};
/// Tables of a form in hashing order; empty if the form is unknown.
[[nodiscard]] std::span<const SealedTable> sealed_tables(std::int64_t form);

/// Keep: the statements stay prepared, 0.3 MB, for a writer of many slabs. Otherwise a statement exists only while its
/// table is hashed, because the daemon seals one slab in some minutes.
enum class SealStatements : std::uint8_t { drop, keep };

/// Hashes the rows of slabs, table by table.
class SlabDigests {
 public:
  SlabDigests(Connection& db, std::int64_t form, SealStatements statements = SealStatements::drop);
  /// Digests in the order of sealed_tables(form), valid until the next call.
  [[nodiscard]] const std::vector<Sha256>& of(std::int64_t slab_key);

 private:
  Connection& db_;
  std::span<const SealedTable> tables_;
  SealStatements statements_;
  std::vector<std::unique_ptr<Statement>> rows_;
  std::vector<Sha256> digests_;
  Digest digest_;
};

/// Digest of the digests of all tables; the chain stores it for a slab.
[[nodiscard]] Sha256 digest_of(const std::vector<Sha256>& tables);

/// SHA-256 of the decisions about a slab (table disposition).
[[nodiscard]] Sha256 decisions_digest(Connection& db, std::int64_t slab_key);

/// SHA-256 of the rows of a table in which the column `key` has this value.
[[nodiscard]] Sha256 rows_digest(Connection& db, const SealedTable& table, const char* key, std::int64_t value);

/// SHA-256 of a row of table care.
[[nodiscard]] Sha256 care_digest(Connection& db, std::int64_t seq);

/// One row of table slab_seal without its checksums.
struct SealEntry {
  std::int64_t seq = 0;
  std::string kind;
  std::int64_t form = kSealForm;
  std::int64_t about = 0;
  std::int64_t slab_no = 0;
  std::string slab_id;
  std::int64_t utime_us = 0;
  Sha256 rows{};
};
/// Checksum of an entry after one with checksum `previous`, which is all zeros before the first entry.
[[nodiscard]] Sha256 seal_of(const Sha256& previous, const SealEntry& entry);

/// Appends to the chain of results. It holds statements, so it is created only when needed, a few times per slab. Every
/// call must be in the transaction that makes the sealed change. Throws SqlFailure.
class Seals {
 public:
  explicit Seals(Connection& db, SealStatements statements = SealStatements::drop);
  /// Begins the chain if there is none, and adds entries for the existing gaps of the history and decisions.
  void begin();
  /// Seals the final rows of an ended slab. Does nothing if the slab's newest seal is equal.
  void seal(std::int64_t slab_key);
  /// As seal(), but does nothing if the slab is still open.
  void seal_if_ended(std::int64_t slab_key);
  /// Adds an entry for a slab whose end is reverted.
  void reopen(std::int64_t slab_key);
  /// Adds an entry; call it before the rows of a slab are deleted.
  void prune(std::int64_t slab_key);
  /// Adds an entry for a new row of table care.
  void note_care(std::int64_t seq);
  /// Adds an entry for a new decision about a slab.
  void note_decision(std::int64_t slab_key);

 private:
  void append(SealEntry& entry, std::string_view tables);
  /// The newest entry about the slab's end; its kind is empty if there is none.
  [[nodiscard]] SealEntry newest_of(std::int64_t slab_key);
  [[nodiscard]] SealEntry about_slab(const char* kind, std::int64_t slab_key);

  Connection& db_;
  SlabDigests digests_;
  Statement head_;
  Statement insert_;
  Statement newest_of_;
  Statement slab_;
  Statement ended_;
  Statement now_;
};

}  // namespace slabd::storage
