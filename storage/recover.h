// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "base/jobs.h"
#include "storage/files/sqlite.h"

namespace slabd::storage {

/// Unacknowledged results that did not fit into RecoveredLine: ids in this closed range. The PLC is not shown them
/// before the next restart, so that no acknowledgement may mean them, although newer results are shown meanwhile.
struct HeldBack {
  std::int64_t first_id = 1;
  std::int64_t last_id = 0;  ///< below first_id: none
};

/// The newest slab key that was ever used, as far as the database knows. Throws SqlFailure.
[[nodiscard]] std::int64_t newest_key_used(Connection& db);

/// Fills what a restarted daemon must know. Call it inside a transaction, after the unfinished commands have been
/// marked interrupted. Throws SqlFailure.
[[nodiscard]] HeldBack read_line(Connection& db, RecoveredLine& line);

}  // namespace slabd::storage
