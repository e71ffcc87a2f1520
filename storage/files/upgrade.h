// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "storage/files/sqlite.h"

namespace slabd::storage {

/// Brings a database of an older schema version, opened for writing at `path`, to that of schema(); does nothing when
/// it has that version. Before the first change the database is copied to `<path>.v<version>-backup` and the copy
/// synced; a file of that name is never overwritten (one with other content makes the copy take `...-backup.2`, `.3`,
/// ...). Without `with_copy` (the file is a copy) none is made. The change is one transaction: afterwards the database
/// is new, or as it was. Throws SqlFailure.
void upgrade(Connection& db, const std::string& path, bool with_copy = true);

}  // namespace slabd::storage
