// SPDX-License-Identifier: Apache-2.0
//
// Can this file be trusted? SQLite's check says whether the pages hold together; the questions after it, whether the
// rows do. Opened read-only, and never checkpointed: a backup stays the file it was.
#include <sqlite3.h>

#include <array>
#include <filesystem>

#include "storage/files/database.h"
#include "storage/files/file_checksum.h"
#include "storage/files/folders.h"
#include "storage/files/quarantine.h"
#include "storage/storage.h"

namespace slabd::storage {
namespace {

struct Question {
  const char* count;    ///< of what must not be
  const char* meaning;  ///< when it is not 0
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

/// What is wrong with the file before it is read as a database.
std::string trouble_of_file(const std::string& path, const FileChecksum& checksum) {
  for (const char* side : {"-wal", "-journal"}) {
    if (file_bytes(path + side) == 0) continue;
    if (checksum.present) return path + side + " lies beside it and would change it: a backup has no log";
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
    // One that cannot be opened here (a newer slabd's, a disk that is read-only) may be as whole as any.
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
