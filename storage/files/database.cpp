// SPDX-License-Identifier: Apache-2.0
//
// Settings and their reasons:
//   synchronous=EXTRA: set before the switch to WAL. The journal of that switch must be deleted permanently, or a power
//     cut could restore it and roll the database back to that moment.
//   journal_mode=WAL: readers never block the writer; one sync per commit.
//   persistent log: -wal (empty) and -shm remain when the writer closes. A user who may read these files but not write
//     in the folder can then read the database with any SQLite while slabd is stopped.
//   checkpoints: only by the writer, because they cost two more syncs, and only after an idle period (Store::idle). A
//     commit performs one only if the log has reached 16 MB; the log file is then truncated to that size.
//   mmap off, fixed cache, trusted_schema off, cell_size_check, defensive: a damaged or hostile file causes an error
//     message, not memory corruption.
#include "storage/files/database.h"

#include <sqlite3.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <charconv>
#include <filesystem>
#include <fstream>
#include <memory>

#include "base/rules.h"
#include "storage/files/file_checksum.h"
#include "storage/files/folders.h"
#include "storage/files/log_copy.h"
#include "storage/files/quarantine.h"
#include "storage/files/upgrade.h"
#include "storage/storage.h"

namespace slabd::storage {
namespace {

constexpr int kMoreLooks = 2;   ///< further checks of a database that looks damaged
constexpr int kBusy_ms = 2000;  ///< only a person with another tool can make the writer wait

/// Applies settings that do not write to the file.
void protect(Connection& db) {
  sqlite3_busy_timeout(db.handle(), kBusy_ms);
  if (sqlite3_db_config(db.handle(), SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr) != SQLITE_OK)
    throw SqlFailure{SQLITE_ERROR, "SQLITE_DBCONFIG_DEFENSIVE is not available"};
  db.execute("PRAGMA trusted_schema = OFF");
  db.execute("PRAGMA cell_size_check = ON");
  db.execute("PRAGMA mmap_size = 0");
  db.execute("PRAGMA cache_size = -2048");
  db.execute("PRAGMA temp_store = MEMORY");
  db.execute("PRAGMA foreign_keys = ON");
}

/// "SLAB": test versions before 1.0, with their own schema versions.
constexpr std::int64_t kApplicationIdBefore1_0 = 0x534C4142;

enum class Owner { nobody, us };

/// Throws if the file belongs to another application, a version before 1.0 or a newer slabd. A file without owner is
/// empty, or was left by a crash between its first page and the schema.
Owner owner_of(Connection& db) {
  const std::int64_t application = db.integer("PRAGMA application_id");
  const std::int64_t version = db.integer("PRAGMA user_version");
  const std::int64_t tables = db.integer("SELECT count(*) FROM sqlite_schema");
  if (application == 0 && version == 0 && tables == 0) return Owner::nobody;
  if (application == kApplicationIdBefore1_0)
    throw SqlFailure{SQLITE_NOTADB, "a test version of slabd before 1.0 wrote it (schema version " +
                                        std::to_string(version) +
                                        "), and no later one reads it: begin a new one with slabctl db restore "
                                        "--fresh, which keeps this one in quarantine"};
  if (application != kApplicationId)
    throw SqlFailure{SQLITE_NOTADB, "it belongs to another application (application_id " + std::to_string(application) +
                                        ", expected " + std::to_string(kApplicationId) + ")"};
  const std::string known = std::to_string(schema().version);
  if (version > schema().version)
    throw SqlFailure{SQLITE_SCHEMA, "it was written by a newer slabd (schema version " + std::to_string(version) +
                                        ", this program supports up to " + known + ")"};
  if (version < 1)
    throw SqlFailure{SQLITE_SCHEMA, "its schema version is " + std::to_string(version) + ", expected 1.." + known};
  return Owner::us;
}

void use_write_ahead_log(Connection& db) {
  db.execute(holds(Rule::synced_commits) ? "PRAGMA synchronous = EXTRA" : "PRAGMA synchronous = OFF");
  const std::string mode = db.text("PRAGMA journal_mode = WAL");
  if (mode != "wal")
    throw SqlFailure{SQLITE_ERROR, "journal_mode is \"" + mode + "\" and cannot be set to \"wal\" (network disk?)"};
  int keep = 1;
  if (sqlite3_file_control(db.handle(), "main", SQLITE_FCNTL_PERSIST_WAL, &keep) != SQLITE_OK)
    throw SqlFailure{SQLITE_ERROR, "SQLITE_FCNTL_PERSIST_WAL is not available"};
  db.execute("PRAGMA wal_autocheckpoint = 4096");
  db.execute("PRAGMA journal_size_limit = 16777216");
}

void create_schema(Connection& db) {
  Transaction transaction(db, "BEGIN EXCLUSIVE");
  db.execute(schema().sql);
  db.execute("PRAGMA application_id = " + std::to_string(kApplicationId));
  db.execute("PRAGMA user_version = " + std::to_string(schema().version));
  transaction.commit();
}

/// Code in "unable to get the page. error code=266", with which SQLite's check reports a failed read; 0 if there is
/// none.
int read_failure_in(const std::string& answer) {
  static constexpr std::string_view kWords = "error code=";
  const std::size_t at = answer.find(kWords);
  if (at == std::string::npos) return 0;
  int code = 0;
  (void)std::from_chars(answer.data() + at + kWords.size(), answer.data() + answer.size(), code);
  return (code & 0xFF) == SQLITE_CORRUPT ? 0 : code;
}

void check(Connection& db) {
  const std::string answer = db.text("PRAGMA quick_check(1)");
  if (answer == "ok") return;
  if (const int code = read_failure_in(answer); code != 0)
    throw SqlFailure{code, "it cannot be read (quick_check: " + answer + ")"};
  throw SqlFailure{SQLITE_CORRUPT, "it is damaged (quick_check: " + answer + ")"};
}

Error cannot_open(const std::string& path, const SqlFailure& failure, Code code) {
  const bool full = (failure.result & 0xFF) == SQLITE_FULL;
  static LockProbe probe;  // its files stay open
  std::string holder = (failure.result & 0xFF) == SQLITE_BUSY ? probe.holder(path) : std::string();
  if (!holder.empty()) holder = "; it is locked by " + holder + ": end that program, or its transaction";
  return error(full ? Code::store_full : code, "cannot use database %s: %s%s", path.c_str(), failure.text.c_str(),
               holder.c_str());
}

void checkpoint_on_close(Connection& db, bool on) {
  if (sqlite3_db_config(db.handle(), SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, on ? 0 : 1, nullptr) != SQLITE_OK)
    throw SqlFailure{SQLITE_ERROR, "SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE is not available"};
}

Error in_quarantine(const std::string& path, const std::string& folder, const char* why) {
  return error(
      Code::journal_write,
      "the database %s was damaged (%.100s) and is now in %s; put a backup in its place with slabctl db restore",
      path.c_str(), why, folder.c_str());
}

bool is_damage(const SqlFailure& failure) {
  return (failure.result & 0xFF) == SQLITE_CORRUPT;
}

/// True if the file can be read but nothing can be created next to it: read-only permissions or a read-only disk.
bool is_for_reading_only(const std::string& path) {
  const std::string folder = std::filesystem::path(path).parent_path().string();
  return access(path.c_str(), R_OK) == 0 && access(folder.empty() ? "." : folder.c_str(), W_OK) != 0;
}

/// Adds the reason to SQLite's message: a database with a log requires a -shm file, for readers too.
SqlFailure explained(SqlFailure failure, const std::string& path) {
  const int primary = failure.result & 0xFF;
  if (failure.result == SQLITE_READONLY_ROLLBACK)
    failure.text =
        "the program that last opened it for writing was killed before its first commit (-journal exists next to it); "
        "start slabd to undo that half of a write";
  if ((primary == SQLITE_CANTOPEN || primary == SQLITE_READONLY) && is_for_reading_only(path))
    failure.text +=
        "; it has a log (-wal) without its index (-shm), which cannot be made here: start slabd, read as its user, or "
        "copy database and log elsewhere";
  else if (primary == SQLITE_CANTOPEN && access(path.c_str(), R_OK) != 0 && errno == EACCES)
    failure.text += "; it may not be read: are you in its group?";
  return failure;
}

/// Damage found through a separate connection; empty if there is none, or if the failure is not damage.
std::string damage_at(const std::string& path) {
  try {
    Connection db(in_real_folder(path), SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOFOLLOW);
    checkpoint_on_close(db, false);
    protect(db);
    (void)owner_of(db);
    check(db);
    return {};
  } catch (const SqlFailure& failure) {
    return is_damage(failure) ? failure.text : std::string();
  }
}

/// True if repeated checks report the same damage, and all files can be read completely. A temporary read failure may
/// look like damage to SQLite, and must not move an intact database to quarantine.
bool is_damaged_for_good(const std::string& path) {
  const std::string damage = damage_at(path);
  if (damage.empty()) return false;
  for (int look = 0; look < kMoreLooks; ++look) {
    try {
      read_through(path, RawFile::Kind::database);
      if (RawFile::exists(path + "-wal")) read_through(path + "-wal", RawFile::Kind::log);
    } catch (const SqlFailure&) {
      return false;
    }
    if (damage_at(path) != damage) return false;
  }
  return true;
}

/// Removes the mark of a backup that was copied into place: it is a database now and has lost its checksum.
void forget_mark(Connection& db) {
  if (db.integer("PRAGMA default_cache_size") != kBackupMark) return;
  db.execute("PRAGMA default_cache_size = 0");
  db.execute("PRAGMA cache_size = -2048");
}

enum class Upgrade : std::uint8_t { with_copy, in_place };

std::unique_ptr<Connection> open_checked(const std::string& path, Upgrade how, bool check_whole) {
  auto db = std::make_unique<Connection>(in_real_folder(path), SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOFOLLOW);
  // Until the database is known to be intact, closing must not checkpoint the log: a damaged database stays unchanged.
  checkpoint_on_close(*db, false);
  protect(*db);
  const Owner owner = owner_of(*db);
  use_write_ahead_log(*db);
  if (owner == Owner::nobody) create_schema(*db);
  if (check_whole) check(*db);  // before an upgrade, because a damaged database must not be changed
  upgrade(*db, path, how == Upgrade::with_copy);
  forget_mark(*db);
  checkpoint_on_close(*db, true);
  return db;
}

Result<std::unique_ptr<Connection>> open_file_for_writing(const std::string& path, Upgrade how,
                                                          bool check_whole = true) {
  const std::string folder = std::filesystem::path(path).parent_path().string();
  if (!folder.empty())
    if (Status status = make_folder(folder); !status.ok()) return status.error();
  std::error_code no_link;
  if (const auto to = std::filesystem::read_symlink(path, no_link); !no_link)
    return error(
        Code::journal_write,
        "the database %s is a link to %s: quarantine and restore would replace the link, not the file. Name the "
        "file itself, or link its folder",
        path.c_str(), to.c_str());
  if (const auto note = quarantine_note(path)) {
    if (Status status = finish_quarantine(path); !status.ok()) return status.error();
    return error(Code::journal_write,
                 "the database %s is in quarantine; put a backup in its place with slabctl db "
                 "restore",
                 path.c_str());
  }
  if (Status status = create_file(path); !status.ok()) return status.error();
  for (const char* side : {"", "-wal", "-shm", "-journal"}) close_to_writers(path + side);
  if (holds(Rule::log_durable_at_start))
    if (Status status = make_log_durable(path); !status.ok()) return status.error();
  if (Status status = remove_checksum(path); !status.ok()) return status.error();
  try {
    return open_checked(path, how, check_whole);
  } catch (const SqlFailure& failure) {
    if (!is_damage(failure) || !has_our_header(path) || !is_damaged_for_good(path))
      return cannot_open(path, failure, Code::journal_write);
    const Result<std::string> kept = quarantine(path, failure.text);
    if (!kept.ok()) return cannot_open(path, failure, Code::journal_write);
    return in_quarantine(path, kept.value(), failure.text.c_str());
  }
}

/// Waits for a starting daemon, which makes its log durable within a fraction of a second.
void wait_for_log(const std::string& path) {
  constexpr unsigned kLook_us = 50'000;
  for (int waited_ms = 0; log_is_in_doubt(path); waited_ms += static_cast<int>(kLook_us / 1000)) {
    if (waited_ms >= kBusy_ms)
      throw SqlFailure{SQLITE_BUSY, std::string("its log may be spoilt by a power cut (") + kLogCopy +
                                        " exists next to it); start slabd to recover it"};
    usleep(kLook_us);
  }
}

/// True if the database can be read without locks and without -shm. A process that cannot write in the folder cannot
/// create -shm, which SQLite requires for a database with a log. If -shm exists, SQLite uses it, even for an unfinished
/// log. If it does not, and no log has content, no process has the database open. It is then opened as unchanging, and
/// every transaction verifies that at its end.
bool can_be_read_still(const std::string& path, const SqlFailure& failure) {
  const int primary = failure.result & 0xFF;
  if (primary != SQLITE_CANTOPEN && primary != SQLITE_READONLY) return false;
  if (!is_for_reading_only(path) || file_bytes(path + "-wal") > 0 || file_bytes(path + "-journal") > 0) return false;
  return !RawFile::exists(path + "-wal") || !RawFile::exists(path + "-shm");
}

std::unique_ptr<Connection> connect_for_reading(const std::string& path) {
  try {
    auto db = std::make_unique<Connection>(path, SQLITE_OPEN_READONLY);
    protect(*db);
    checkpoint_on_close(*db, false);
    begin_to_read(*db);
    return db;
  } catch (const SqlFailure& failure) {
    if (!can_be_read_still(path, failure)) throw;
  }
  auto db = std::make_unique<Connection>(path, Connection::ReadUnchanged{});
  protect(*db);
  return db;
}

std::unique_ptr<Connection> open_protected(const std::string& path) {
  wait_for_log(path);
  auto db = connect_for_reading(path);
  if (owner_of(*db) == Owner::nobody) throw SqlFailure{SQLITE_NOTADB, "it is empty; slabd has not used it yet"};
  return db;
}

/// True if the write that the journal undoes was the first one, so that the database is empty without it. SQLite's file
/// format, section 3: 8 bytes of magic, then four numbers of 4 bytes; the third is the number of pages before the
/// write.
bool was_empty_before_journal(const std::string& path) {
  static constexpr std::string_view kMagic("\xd9\xd5\x05\xf9\x20\xa1\x63\xd7", 8);
  std::ifstream in(path + "-journal", std::ios::binary);
  std::array<char, 20> header{};
  in.read(header.data(), header.size());
  const std::string_view text(header.data(), header.size());
  return in.good() && text.starts_with(kMagic) && text.substr(16, 4) == std::string_view("\0\0\0\0", 4);
}

/// `looked`: result of the check for the file; it may exist in a folder without permission.
Error no_database(const std::string& path, const std::error_code& looked) {
  if (looked)
    return error(Code::config, "cannot look for database %s: %s; are you in the group of its folder?", path.c_str(),
                 looked.message().c_str());
  return error(Code::config, "there is no database %s: slabd has not run with it yet, or the path is wrong",
               path.c_str());
}

}  // namespace

void begin_to_read(Connection& db) {
  constexpr unsigned kLook_us = 5'000;
  for (int waited_us = 0;; waited_us += static_cast<int>(kLook_us)) {
    try {
      (void)db.integer("SELECT count(*) FROM sqlite_schema");
      return;
    } catch (const SqlFailure& failure) {
      const bool starts = failure.result == SQLITE_READONLY_RECOVERY || failure.result == SQLITE_READONLY_CANTINIT;
      if (!starts || waited_us >= 1000 * kBusy_ms) throw;
    }
    usleep(kLook_us);
  }
}

Result<std::unique_ptr<Connection>> open_for_writing(const std::string& path) {
  return open_file_for_writing(path, Upgrade::with_copy);
}

Result<std::unique_ptr<Connection>> open_again_for_writing(const std::string& path) {
  return open_file_for_writing(path, Upgrade::with_copy, false);
}

Result<std::unique_ptr<Connection>> open_copy_for_writing(const std::string& path) {
  return open_file_for_writing(path, Upgrade::in_place);
}

Result<std::unique_ptr<Connection>> open_any_version(const std::string& path) {
  std::error_code ec;
  if (!std::filesystem::exists(path, ec)) return no_database(path, ec);
  try {
    return open_protected(path);
  } catch (const SqlFailure& failure) {
    const int primary = failure.result & 0xFF;
    const bool damaged = has_our_header(path) && (primary == SQLITE_CORRUPT || primary == SQLITE_NOTADB);
    return cannot_open(path, explained(failure, path), damaged ? Code::journal_write : Code::config);
  }
}

Result<std::unique_ptr<Connection>> open_for_reading(const std::string& path) {
  std::error_code ec;
  if (!std::filesystem::exists(path, ec)) return no_database(path, ec);
  if (const auto note = quarantine_note(path))
    return error(Code::config, "%s is in quarantine: %.200s", path.c_str(), note->c_str());
  try {
    auto db = open_protected(path);
    if (const std::int64_t version = db->integer("PRAGMA user_version"); version < schema().version)
      throw SqlFailure{SQLITE_SCHEMA, "it has schema version " + std::to_string(version) + " of an older slabd, and " +
                                          std::to_string(schema().version) +
                                          " is needed; starting slabd brings it up to date"};
    return db;
  } catch (const SqlFailure& failure) {
    return cannot_open(path, explained(failure, path), Code::config);
  }
}

bool has_our_header(const std::string& path) {
  // SQLite's file format: 16 bytes of text; the application_id at byte 68, most significant byte first.
  static constexpr std::string_view kMagic("SQLite format 3\0", 16);
  static constexpr std::string_view kOurs("SLBD");
  static_assert(kApplicationId == 0x534C4244);
  std::error_code fault;
  if (!std::filesystem::is_regular_file(path, fault)) return false;  // opening a FIFO would block
  std::ifstream in(path, std::ios::binary);
  std::array<char, 72> header{};
  in.read(header.data(), header.size());
  const std::string_view text(header.data(), header.size());
  return in.good() && text.starts_with(kMagic) && text.substr(68, 4) == kOurs;
}

bool unused_at(const std::string& path) {
  std::error_code ec;
  if (!std::filesystem::exists(path, ec)) return !ec;
  try {
    return owner_of(*connect_for_reading(path)) == Owner::nobody;
  } catch (const SqlFailure& failure) {
    // Otherwise open_for_writing() and open_for_reading() report the cause.
    return failure.result == SQLITE_READONLY_ROLLBACK && was_empty_before_journal(path);
  }
}

bool has_half_a_write(const std::string& path) {
  if (file_bytes(path + "-journal") == 0) return false;
  try {
    (void)connect_for_reading(path);
    return false;
  } catch (const SqlFailure& failure) {
    return failure.result == SQLITE_READONLY_ROLLBACK;
  }
}

// Integrity check of a file. SQLite's check covers the pages, the queries after it the rows. The file is opened
// read-only and never checkpointed, so that a backup stays unchanged.

namespace {

struct Question {
  const char* count;    ///< counts violations
  const char* meaning;  ///< description if the count is not 0
};

constexpr std::array kQuestions = {
    Question{"SELECT count(*) FROM pragma_foreign_key_check", "rows refer to rows that are not there"},
    Question{"SELECT count(*) FROM attempt WHERE phase = 'measured' AND NOT EXISTS (SELECT 1 FROM block WHERE "
             "(block.slab_key, block.station, block.attempt) = (attempt.slab_key, attempt.station, attempt.attempt))",
             "attempts are called measured and have no block"},
    Question{"SELECT count(*) FROM block WHERE (SELECT count(*) FROM plane WHERE (plane.slab_key, plane.station, "
             "plane.attempt) = (block.slab_key, block.station, block.attempt)) <> 5",
             "blocks do not have their five planes"},
    Question{"SELECT count(*) FROM slab_result WHERE NOT EXISTS (SELECT 1 FROM result WHERE result.slab_key = "
             "slab_result.slab_key AND kind = 2)",
             "slabs have ended without a record for the PLC"},
    Question{"SELECT count(*) <> 1 FROM line", "the one row of the line is not there"},
};

/// Problem of the file before it is read as a database.
std::string trouble_of_file(const std::string& path, const FileChecksum& checksum) {
  for (const char* side : {"-wal", "-journal"}) {
    if (file_bytes(path + side) == 0) continue;
    if (checksum.present) return path + side + " exists next to it and would change it: a backup has no log";
    return {};  // its last pages may still be in the log
  }
  return checksum.trouble;
}

std::string trouble_of(Connection& db, bool full) {
  std::string answer = db.text(full ? "PRAGMA integrity_check(1)" : "PRAGMA quick_check(1)");
  if (answer != "ok") return answer;
  for (const Question& question : kQuestions)
    if (const std::int64_t count = db.integer(question.count); count != 0)
      return std::to_string(count) + " " + question.meaning;
  return {};
}

}  // namespace

Result<std::int64_t> newest_slab_key(const std::string& path) {
  const Result<std::unique_ptr<Connection>> opened = open_any_version(path);
  if (!opened.ok()) return opened.error();
  try {
    Transaction moment(*opened.value(), "BEGIN");
    begin_to_read(*opened.value());
    const std::int64_t key = opened.value()->integer("SELECT coalesce(max(slab_key), 0) FROM slab");
    moment.commit();
    return key;
  } catch (const SqlFailure& failure) {
    return error(Code::journal_write, "%s: %s", path.c_str(), failure.text.c_str());
  }
}

Result<DatabaseReport> check_database(const std::string& path, bool full) {
  if (const auto note = quarantine_note(path))
    return error(Code::config, "%s is in quarantine: %.200s", path.c_str(), note->c_str());
  DatabaseReport report;
  report.bytes = file_bytes(path);
  report.log_bytes = file_bytes(path + "-wal");
  if (std::error_code ec; std::filesystem::exists(path, ec)) {
    const Result<FileChecksum> checksum = check_checksum(path);
    if (!checksum.ok()) return checksum.error();
    report.trouble = trouble_of_file(path, checksum.value());
    if (!report.trouble.empty()) return report;
    report.has_checksum = checksum.value().present;
  }
  Result<std::unique_ptr<Connection>> opened = open_any_version(path);
  if (!opened.ok()) {
    // A file that cannot be opened here (a newer slabd's, a read-only disk) may still be intact.
    if (opened.error().code != Code::journal_write) return opened.error();
    report.trouble = opened.error().text.view();
    return report;
  }
  Connection& db = *opened.value();
  try {
    Transaction moment(db, "BEGIN");
    begin_to_read(db);
    report.version = static_cast<int>(db.integer("PRAGMA user_version"));
    report.trouble = trouble_of(db, full);
    report.slabs = db.integer("SELECT count(*) FROM slab");
    report.oldest_key = db.integer("SELECT coalesce(min(slab_key), 0) FROM slab");
    report.newest_key = db.integer("SELECT coalesce(max(slab_key), 0) FROM slab");
    report.newest_utime_us = db.integer("SELECT newest_utime_us FROM line");
    moment.commit();
  } catch (const SqlFailure& failure) {
    report.trouble = failure.text;
  }
  return report;
}

}  // namespace slabd::storage
