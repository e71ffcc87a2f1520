// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "storage/files/sqlite.h"

namespace slabd::storage {

/// Takes the records of old slabs away, a slab at a time: some 500 rows in one transaction, so that a power cut leaves
/// a slab whole or gone and no job waits for long. Candidates have ended, every result of theirs was acknowledged, none
/// of their scans is kept, and at least kKeepSlabsMin newer slabs stay. Slabs that did not pass stay longer: people ask
/// for those. Both numbers are counts, so the database is bounded whatever the line makes. The line says how many went,
/// up to which key, and the chain of results gets an entry for each. Calibrations and seals stay for ever. The file
/// does not shrink; its free pages are used again.
class Retention {
 public:
  explicit Retention(Connection& db);
  /// Takes the oldest candidate away that is neither one of the newest `keep_slabs` nor one of the newest
  /// `keep_failed_slabs` (0: all) of those that did not pass; false: there is none. Throws SqlFailure.
  bool take_one(std::int64_t keep_slabs, std::int64_t keep_failed_slabs);

 private:
  /// Key of row `offset`, 0 when there are fewer.
  [[nodiscard]] static std::int64_t key_at(Statement& newest_first, std::int64_t offset);

  Connection& db_;
  Statement newest_;
  Statement newest_failed_;
  Statement candidate_;
  Statement drop_of_no_slab_;  ///< commands given between slabs: REPORT
  Statement note_;
};

}  // namespace slabd::storage
