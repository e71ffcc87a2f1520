// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>

#include "storage/files/sqlite.h"

namespace slabd::storage {

/// The tables of a new database, and the steps that bring a database of each earlier version to them.
struct Schema {
  int version = 0;
  const char* sql = nullptr;             ///< makes the tables in an empty file
  std::span<const char* const> steps{};  ///< steps[i]: from version i + 1 to i + 2; as many as version - 1
};
/// The schema of this program: schema.sql, compiled in, with version kSchemaVersion.
[[nodiscard]] const Schema& schema();

/// Replaces schema() for the whole process while it lives. For tests of upgrade() only: it must be made before a
/// database is opened and before other threads run. `schema` must outlive it.
class SchemaOfTest {
 public:
  explicit SchemaOfTest(const Schema& schema);
  ~SchemaOfTest();
  SchemaOfTest(const SchemaOfTest&) = delete;
  SchemaOfTest& operator=(const SchemaOfTest&) = delete;

 private:
  const Schema* before_;
};

/// Brings a database of an older schema version, opened for writing at `path`, to that of schema(); does nothing when
/// it has that version. Before the first change the database is copied to `<path>.v<version>-backup` and the copy
/// synced; a file of that name is never overwritten (one with other content makes the copy take `...-backup.2`, `.3`,
/// ...). Without `with_copy` (the file is a copy) none is made. The change is one transaction: afterwards the database
/// is new, or as it was. Throws SqlFailure.
void upgrade(Connection& db, const std::string& path, bool with_copy = true);

}  // namespace slabd::storage
