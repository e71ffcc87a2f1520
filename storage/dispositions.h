// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "storage/files/sqlite.h"
#include "storage/storage.h"

namespace slabd::storage {

/// Database rows of dispositions. Every call must be inside the caller's transaction and throws SqlFailure.
class Dispositions {
 public:
  explicit Dispositions(Connection& db) : db_(db) {}

  /// Adds a decision about a slab that did not pass; returns "disposition 2 of slab 17: scrap". The newest decision
  /// repeated counts as added. Throws Refusal (storage/jobs.h) with the remedy if it cannot be added.
  std::string keep(const KeepDisposition& change);
  /// Decisions about a slab, oldest first.
  [[nodiscard]] std::vector<DispositionRecord> of_slab(std::int64_t slab_key);

 private:
  Connection& db_;
};

}  // namespace slabd::storage
