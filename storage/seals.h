// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "storage/seal_form.h"

namespace slabd::storage {

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
