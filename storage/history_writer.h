// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "base/jobs.h"
#include "base/result.h"
#include "storage/storage.h"

/// Writer of a history of emulated slabs at the level of records: the jobs of the daemon, many slabs in one
/// transaction. It is for databases on which commands and pages are tried. The daemon does not use it.
namespace slabd::storage {

class HistoryWriter {
 public:
  virtual ~HistoryWriter() = default;
  /// Carries out the next job of the history, in the order of the daemon. It is durable after finish() only. After an
  /// error the database is not usable.
  [[nodiscard]] virtual Status apply(const StoreJob& job) = 0;
  /// Commits and closes the database.
  [[nodiscard]] virtual Status finish() = 0;
};

/// Creates the database. config: a file of this name exists, because a history is never mixed with another one.
[[nodiscard]] Result<std::unique_ptr<HistoryWriter>> write_history(const StoreSettings& settings);

}  // namespace slabd::storage
