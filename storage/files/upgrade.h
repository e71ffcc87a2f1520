// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>

#include "storage/files/sqlite.h"

namespace slabd::storage {

/// The tables of a new database, and the upgrade steps from each earlier version.
struct Schema {
  int version = 0;
  const char* sql = nullptr;             ///< creates the tables in an empty file
  std::span<const char* const> steps{};  ///< steps[i] upgrades version i + 1 to i + 2; version - 1 steps
};
/// The schema of this program: schema.sql, compiled in, with version kSchemaVersion.
[[nodiscard]] const Schema& schema();

/// Replaces schema() for the whole process during its lifetime. Only for tests of upgrade(): construct it before a
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

/// Upgrades a database of an older schema version, opened for writing at `path`, to that of schema(); does nothing if
/// it has that version. Before the first change the database is copied to `<path>.v<version>-backup` and synced. A
/// different existing file is never overwritten; the copy is then named `...-backup.2`, `.3`, ... Without `with_copy`
/// (the file is a copy) no copy is made. The change is one transaction: the database is either upgraded or unchanged.
/// Throws SqlFailure.
void upgrade(Connection& db, const std::string& path, bool with_copy = true);

}  // namespace slabd::storage
