// SPDX-License-Identifier: Apache-2.0
//
// Upgrade of an old database by a new slabd. It runs unattended, and the database contains the only record of installed
// slabs. Therefore a durable copy is made first, and all changes are one transaction. An interruption leaves the old
// database and at least one copy. An interrupted upgrade that starts again finds an identical copy and does not write
// another.
#include "storage/files/upgrade.h"

#include <sqlite3.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>

#include "storage/files/file_checksum.h"
#include "storage/files/folders.h"
#include "storage/storage.h"

namespace slabd::storage {
namespace {

constexpr int kBackupsMax = 100;

/// Counts rows that refer to a missing calibration. A step that rebuilds another table must add that table here.
/// Checking all tables would take minutes, because they contain every item of every slab.
constexpr const char* kLostReferences =
    "SELECT count(*) FROM (SELECT DISTINCT m.name FROM sqlite_schema AS m, pragma_foreign_key_list(m.name) AS f "
    "WHERE f.\"table\" = 'calibration') AS child, pragma_foreign_key_check(child.name)";

[[noreturn]] void fail(const std::string& text, int result = SQLITE_IOERR) {
  throw SqlFailure{result, text};
}

/// Copies the whole database, including the write-ahead log, into one file.
void copy_database(Connection& db, const std::string& to) {
  Connection copy(to, SQLITE_OPEN_READWRITE);
  sqlite3_backup* const backup = sqlite3_backup_init(copy.handle(), "main", db.handle(), "main");
  if (backup == nullptr) fail("it cannot be copied to " + to + ": " + sqlite3_errmsg(copy.handle()));
  const int stepped = sqlite3_backup_step(backup, -1);
  const int result = sqlite3_backup_finish(backup);
  if (stepped != SQLITE_DONE || result != SQLITE_OK)
    fail("it cannot be copied to " + to + ": " + sqlite3_errmsg(copy.handle()),
         sqlite3_extended_errcode(copy.handle()));
}

bool same_content(const std::string& a, const std::string& b) {
  std::ifstream left(a, std::ios::binary);
  std::ifstream right(b, std::ios::binary);
  std::array<char, 65'536> x{};
  std::array<char, 65'536> y{};
  while (left && right) {
    left.read(x.data(), x.size());
    right.read(y.data(), y.size());
    if (left.gcount() != right.gcount()) return false;
    if (!std::equal(x.begin(), x.begin() + left.gcount(), y.begin())) return false;
  }
  return left.eof() && right.eof();
}

void remove_part(const std::string& part) {
  std::error_code ec;
  for (const char* side : {"", "-journal"}) std::filesystem::remove(part + side, ec);
}

/// Copies only if there is enough space, and deletes the copy on failure.
void copy_into_part(Connection& db, const std::string& folder, const std::string& part) {
  const std::int64_t bytes = db.integer("PRAGMA page_count") * db.integer("PRAGMA page_size");
  must(check_room(folder, static_cast<std::uint64_t>(bytes), "a copy before it is brought up to date"));
  try {
    must(create_file(part));
    copy_database(db, part);
    must(sync_file(part));
    ChecksumWriter checksum(part);
    for (bool done = false; !done;) must(checksum.step(~std::uint64_t{0}, done));
  } catch (const SqlFailure&) {
    remove_part(part);
    throw;
  }
}

/// Stores a synced copy next to the database and keeps all older ones.
void back_up(Connection& db, const std::string& path, std::int64_t version) {
  const std::string name = path + ".v" + std::to_string(version) + "-backup";
  const std::string folder = std::filesystem::path(path).parent_path().string();
  const std::string part = name + ".part";
  std::error_code ec;
  remove_part(part);  // left by an interrupted upgrade
  copy_into_part(db, folder, part);
  for (int i = 1; i <= kBackupsMax; ++i) {
    const std::string wanted = i == 1 ? name : name + "." + std::to_string(i);
    if (std::filesystem::exists(wanted, ec)) {
      if (!same_content(part, wanted)) continue;
      std::filesystem::remove(part, ec);
      // The process that renamed it may have been stopped before the rename was durable.
      must(sync_file(folder));
      return;
    }
    // The writer's lock is held, so no other process writes here.
    must(rename_file(part, wanted));
    must(sync_file(folder));
    return;
  }
  fail("there are " + std::to_string(kBackupsMax) + " copies of it already, " + name + " and so on");
}

}  // namespace

void upgrade(Connection& db, const std::string& path, bool with_copy) {
  const Schema& to = schema();
  const std::int64_t version = db.integer("PRAGMA user_version");
  if (version >= to.version) return;
  if (with_copy) back_up(db, path, version);
  // A referenced table can only be rebuilt while foreign keys are off; lost references are checked before the commit.
  // Inside a transaction the pragma has no effect.
  db.execute("PRAGMA foreign_keys = OFF");
  Transaction transaction(db, "BEGIN EXCLUSIVE");
  for (const char* step : to.steps.subspan(static_cast<std::size_t>(version - 1))) db.execute(step);
  db.execute("PRAGMA user_version = " + std::to_string(to.version));
  if (db.integer(kLostReferences) != 0)
    fail("calibrations that others refer to would be lost", SQLITE_CONSTRAINT_FOREIGNKEY);
  transaction.commit();
  db.execute("PRAGMA foreign_keys = ON");
}

}  // namespace slabd::storage
