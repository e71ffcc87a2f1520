// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "base/jobs.h"
#include "storage/sqlite.h"

namespace slabd::storage {

/// Fills what a restarted daemon must know. Call it inside a transaction, after the unfinished commands have been
/// marked interrupted. Throws SqlFailure.
void read_line(Connection& db, RecoveredLine& line);

}  // namespace slabd::storage
