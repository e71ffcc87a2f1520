// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "storage/sqlite.h"

namespace slabd::storage {

/// Takes the records of old slabs away, a slab at a time: some 500 rows in one transaction, so that a power cut leaves
/// a slab whole or gone and no job waits for long. Candidates have ended, every result of theirs was acknowledged, none
/// of their scans is kept, and at least kKeepSlabsMin newer slabs stay. The line says how many went, up to which key.
/// Calibrations stay for ever. The file does not shrink; its free pages are used again.
class Retention {
 public:
  explicit Retention(Connection& db);
  /// Takes the oldest candidate beyond the newest `keep_slabs` away; false: there is none. Throws SqlFailure.
  bool take_one(std::int64_t keep_slabs);

 private:
  Connection& db_;
  Statement newest_to_go_;
  Statement candidate_;
  Statement note_;
};

}  // namespace slabd::storage
