// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "storage/files/sqlite.h"
#include "storage/storage.h"

/// Database rows of the moulds: their resets, and the values of their slabs. Every call must be inside the caller's
/// transaction and throws SqlFailure.
namespace slabd::storage {

class Moulds {
 public:
  explicit Moulds(Connection& db) : db_(db) {}

  /// Adds a reset and returns "mould-7-epoch-2". A reset that cannot be added throws Refusal (storage/jobs.h).
  std::string reset(const ResetMould& change);
  [[nodiscard]] MouldRecords records(const MouldFilter& filter);

 private:
  [[nodiscard]] std::vector<MouldSlab> newest_slabs(const MouldFilter& filter);
  void read_values(MouldRecords& records);

  Connection& db_;
};

}  // namespace slabd::storage
