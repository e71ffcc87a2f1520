// SPDX-License-Identifier: Apache-2.0
//
// The settings and their reasons:
//   synchronous=EXTRA   set before the switch to WAL: the journal of that switch must be gone for good, or a power cut
//                       can bring it back and roll the database back to that moment
//   journal_mode=WAL    readers never block the writer; one sync for each commit
//   checkpoints         by the writer only: two more syncs, so when it has had nothing to do for a while (Store::idle);
//                       in a commit only when the log has reached 16 MB, to which its file is cut back afterwards
//   mmap off, fixed cache, trusted_schema off, cell_size_check, defensive: a damaged or hostile file is an error
//                       message, not memory damage
#include "storage/database.h"

#include <sqlite3.h>

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <memory>
#include <vector>

#include "storage/folders.h"
#include "storage/schema.h"
#include "storage/storage.h"
#include "storage/upgrade.h"

namespace slabd::storage {
namespace {

constexpr int kBusyMs = 2000;  ///< only a person with another tool can make the writer wait

/// Settings that write nothing into the file.
void protect(Connection& db) {
  sqlite3_busy_timeout(db.handle(), kBusyMs);
  if (sqlite3_db_config(db.handle(), SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr) != SQLITE_OK)
    throw SqlFailure{SQLITE_ERROR, "SQLITE_DBCONFIG_DEFENSIVE is not available"};
  db.execute("PRAGMA trusted_schema = OFF");
  db.execute("PRAGMA cell_size_check = ON");
  db.execute("PRAGMA mmap_size = 0");
  db.execute("PRAGMA cache_size = -2048");
  db.execute("PRAGMA temp_store = MEMORY");
  db.execute("PRAGMA foreign_keys = ON");
}

enum class Owner { nobody, us };

/// Throws when the file is another application's or from a newer slabd. "nobody": an empty file, or one that a crash
/// left between its first page and the schema.
Owner owner_of(Connection& db) {
  const std::int64_t application = db.integer("PRAGMA application_id");
  const std::int64_t version = db.integer("PRAGMA user_version");
  const std::int64_t tables = db.integer("SELECT count(*) FROM sqlite_schema");
  if (application == 0 && version == 0 && tables == 0) return Owner::nobody;
  if (application != kApplicationId)
    throw SqlFailure{SQLITE_NOTADB, "it belongs to another application (application_id " + std::to_string(application) +
                                        ", expected " + std::to_string(kApplicationId) + ")"};
  if (version > kSchemaVersion)
    throw SqlFailure{SQLITE_SCHEMA, "it was written by a newer slabd (schema version " + std::to_string(version) +
                                        ", this program knows up to " + std::to_string(kSchemaVersion) + ")"};
  if (version < 1)
    throw SqlFailure{SQLITE_SCHEMA, "its schema version is " + std::to_string(version) + ", expected 1.." +
                                        std::to_string(kSchemaVersion)};
  return Owner::us;
}

void use_write_ahead_log(Connection& db) {
  db.execute("PRAGMA synchronous = EXTRA");
  const std::string mode = db.text("PRAGMA journal_mode = WAL");
  if (mode != "wal")
    throw SqlFailure{SQLITE_ERROR, "journal_mode is \"" + mode + "\" and cannot be set to \"wal\" (network disk?)"};
  db.execute("PRAGMA wal_autocheckpoint = 4096");
  db.execute("PRAGMA journal_size_limit = 16777216");
}

void create_schema(Connection& db) {
  Transaction transaction(db, "BEGIN EXCLUSIVE");
  db.execute(schema_sql());
  db.execute("PRAGMA application_id = " + std::to_string(kApplicationId));
  db.execute("PRAGMA user_version = " + std::to_string(kSchemaVersion));
  transaction.commit();
}

void check(Connection& db) {
  const std::string answer = db.text("PRAGMA quick_check(1)");
  if (answer != "ok") throw SqlFailure{SQLITE_CORRUPT, "it is damaged (quick_check: " + answer + ")"};
}

/// Writes the write-ahead log onto itself and syncs it. What a failed sync has left unwritten, Linux takes for written:
/// it can still be read, and no later sync writes it, so commits behind it would go with it at the next power cut. The
/// same bytes written once more are written for good.
void write_log(const std::string& db_path) {
  const std::string path = db_path + "-wal";
  sqlite3_vfs* vfs = sqlite3_vfs_find(nullptr);
  int exists = 0;
  if (vfs->xAccess(vfs, path.c_str(), SQLITE_ACCESS_EXISTS, &exists) != SQLITE_OK || exists == 0) return;
  const auto memory =
      std::make_unique<std::max_align_t[]>(static_cast<std::size_t>(vfs->szOsFile) / sizeof(std::max_align_t) + 1);
  void* place = memory.get();
  auto* file = static_cast<sqlite3_file*>(place);
  int result = vfs->xOpen(vfs, path.c_str(), file, SQLITE_OPEN_READWRITE | SQLITE_OPEN_WAL, nullptr);
  if (result == SQLITE_OK) {
    sqlite3_int64 bytes = 0;
    result = file->pMethods->xFileSize(file, &bytes);
    std::vector<unsigned char> chunk(65'536);
    for (sqlite3_int64 at = 0; result == SQLITE_OK && at < bytes; at += static_cast<sqlite3_int64>(chunk.size())) {
      const int size = static_cast<int>(std::min(bytes - at, static_cast<sqlite3_int64>(chunk.size())));
      result = file->pMethods->xRead(file, chunk.data(), size, at);
      if (result == SQLITE_OK) result = file->pMethods->xWrite(file, chunk.data(), size, at);
    }
    if (result == SQLITE_OK && bytes > 0) result = file->pMethods->xSync(file, SQLITE_SYNC_FULL);
  }
  if (file->pMethods != nullptr) file->pMethods->xClose(file);
  if (result != SQLITE_OK)
    throw SqlFailure{result, "its log cannot be written again (SQLite " + std::to_string(result) + ")"};
}

Error cannot_open(const std::string& path, const SqlFailure& failure, Code code) {
  const bool full = (failure.result & 0xFF) == SQLITE_FULL;
  return error(full ? Code::store_full : code, "cannot use database %s: %s", path.c_str(), failure.text.c_str());
}

}  // namespace

Status write_log_again(const std::string& path) {
  try {
    write_log(path);
    return success();
  } catch (const SqlFailure& failure) {
    return cannot_open(path, failure, Code::journal_write);
  }
}

Result<std::unique_ptr<Connection>> open_for_writing(const std::string& path) {
  const std::string folder = std::filesystem::path(path).parent_path().string();
  if (!folder.empty())
    if (Status status = make_folder(folder); !status.ok()) return status.error();
  if (Status status = create_file(path); !status.ok()) return status.error();
  try {
    auto db = std::make_unique<Connection>(path, SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOFOLLOW);
    protect(*db);
    const Owner owner = owner_of(*db);
    use_write_ahead_log(*db);
    if (owner == Owner::nobody) create_schema(*db);
    check(*db);  // before an upgrade: a damaged database is not touched
    upgrade(*db, path);
    return db;
  } catch (const SqlFailure& failure) {
    return cannot_open(path, failure, Code::journal_write);
  }
}

Result<std::unique_ptr<Connection>> open_for_reading(const std::string& path) {
  std::error_code ec;
  if (!std::filesystem::exists(path, ec))
    return error(Code::config, "there is no database %s: slabd has not run with it yet, or the path is wrong",
                 path.c_str());
  try {
    auto db = std::make_unique<Connection>(path, SQLITE_OPEN_READONLY);
    protect(*db);
    if (sqlite3_db_config(db->handle(), SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, nullptr) != SQLITE_OK)
      throw SqlFailure{SQLITE_ERROR, "SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE is not available"};
    if (owner_of(*db) == Owner::nobody) throw SqlFailure{SQLITE_NOTADB, "it is empty; slabd has not used it yet"};
    if (const std::int64_t version = db->integer("PRAGMA user_version"); version < kSchemaVersion)
      throw SqlFailure{SQLITE_SCHEMA, "it has schema version " + std::to_string(version) + " of an older slabd, and " +
                                          std::to_string(kSchemaVersion) +
                                          " is needed; starting slabd brings it up to date"};
    return db;
  } catch (const SqlFailure& failure) {
    return cannot_open(path, failure, Code::config);
  }
}

bool unused_at(const std::string& path) {
  std::error_code ec;
  if (!std::filesystem::exists(path, ec)) return !ec;
  try {
    Connection db(path, SQLITE_OPEN_READONLY);
    protect(db);
    return owner_of(db) == Owner::nobody;
  } catch (const SqlFailure&) {
    return false;  // whoever opens it properly says what is wrong
  }
}

}  // namespace slabd::storage
