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

// Canonical form of what is stored of a slab, and its SHA-256.
//
// A form is a list of tables, columns and row orders. It is frozen: seals that were made with it are checked with it
// for ever. A schema that adds columns adds a form. A value is hashed as its type (one letter) and its bytes, numbers
// high byte first, texts and blobs behind their length. Not in a form is what changes legitimately after the end of a
// slab: result.acknowledged and records that are shown again, attempt.scan_state and measuring_since_ns, commands.

inline constexpr std::int64_t kSealForm = 1;

using Sha256 = std::array<std::uint8_t, 32>;

/// SHA-256 of values, piece by piece.
class Digest {
 public:
  Digest();
  ~Digest();
  Digest(const Digest&) = delete;
  Digest& operator=(const Digest&) = delete;
  Digest& bytes(std::span<const std::uint8_t> value);
  Digest& text(std::string_view value);  ///< behind its length
  Digest& integer(std::int64_t value);   ///< 8 bytes, high byte first
  Digest& column(const Statement& row, int column);
  /// Of everything until now; begins again.
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
  std::string_view where;  ///< more than slab_key = ?1
  std::string_view order;
};
/// In the order in which they are hashed. Empty: this program does not know the form.
[[nodiscard]] std::span<const SealedTable> sealed_tables(std::int64_t form);

/// Hashes the rows of slabs, table by table. A statement lives for one table: the daemon seals a slab in some minutes,
/// and eleven wide statements that wait for that would hold 0.3 MB.
class SlabDigests {
 public:
  SlabDigests(Connection& db, std::int64_t form);
  /// Valid until the next call; as many as sealed_tables(form).
  [[nodiscard]] const std::vector<Sha256>& of(std::int64_t slab_key);

 private:
  Connection& db_;
  std::span<const SealedTable> tables_;
  std::vector<Sha256> digests_;
  Digest digest_;
};

/// Of the digests of all tables: what the chain holds of a slab.
[[nodiscard]] Sha256 digest_of(const std::vector<Sha256>& tables);

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
/// The checksum of an entry that follows one with checksum `previous`; all zeros before the first.
[[nodiscard]] Sha256 seal_of(const Sha256& previous, const SealEntry& entry);

/// Appends to the chain of results. Made when it is needed, some times a slab: it holds statements. Every call belongs
/// into the transaction that changes what it seals. Throws SqlFailure.
class Seals {
 public:
  explicit Seals(Connection& db);
  /// Begins the chain where there is none; gaps of the history that are known by then get their entries.
  void begin();
  /// The rows of an ended slab are as they will stay. Does nothing when the newest seal of the slab holds exactly that.
  void seal(std::int64_t slab_key);
  /// As seal(), of a slab that may still be open: then it does nothing.
  void seal_if_ended(std::int64_t slab_key);
  /// The end of a slab is taken back.
  void reopen(std::int64_t slab_key);
  /// Before the rows of a slab are deleted.
  void prune(std::int64_t slab_key);
  /// A row was added to table care.
  void note_care(std::int64_t seq);

 private:
  void append(SealEntry& entry, std::string_view tables);
  /// The newest entry about the slab's end; kind is empty when there is none.
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
