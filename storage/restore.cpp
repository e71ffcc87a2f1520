// SPDX-License-Identifier: Apache-2.0
//
// A backup replaces the current database. Data that it lacks must not be hidden, so the history gets an entry about the
// gap. Slab keys that may have been used are skipped, because their scans may still be in the spool. The session number
// and the record numbers continue from unused values. A slab that was open in the backup is ended.
//
// Everything is prepared in a separate file. Then the old files are moved to quarantine, and the new file gets the
// database's name. After an interruption the daemon finds the quarantine's note and waits for a person.
#include <sqlite3.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>
#include <utility>

#include "storage/chain.h"
#include "storage/files/backup.h"
#include "storage/files/database.h"
#include "storage/files/folders.h"
#include "storage/files/log_copy.h"
#include "storage/files/quarantine.h"
#include "storage/files/upgrade.h"
#include "storage/jobs.h"
#include "storage/seals.h"
#include "storage/storage.h"

namespace slabd::storage {
namespace {

namespace fs = std::filesystem;

/// Data of a database that must not be lost silently; empty if it cannot be read. Calibrations are compared
/// individually, not by number: after an earlier restore, or in another line's backup, equal numbers may be different
/// ones.
struct Known {
  std::int64_t slab_key = 0;        ///< the newest key
  std::set<std::string> applied{};  ///< calibrations put in force
  std::set<std::string> checks{};
  std::set<std::string> decisions{};  ///< dispositions of slabs
  std::set<std::string> resets{};     ///< of moulds
  std::set<std::string> gauges{};     ///< master checks of gauges
};

std::int64_t missing(const std::set<std::string>& lost, const std::set<std::string>& back) {
  return std::count_if(lost.begin(), lost.end(), [&](const std::string& one) { return !back.contains(one); });
}

/// "2 changes of calibrations, 1 decision about slabs"; empty if nothing would be lost.
std::string losses_of(const Known& lost, const Known& back) {
  std::string text;
  const auto count = [&text](std::int64_t n, const char* one, const char* many) {
    if (n > 0) text += (text.empty() ? "" : ", ") + std::to_string(n) + " " + (n == 1 ? one : many);
  };
  count(missing(lost.applied, back.applied), "change of calibrations", "changes of calibrations");
  count(missing(lost.checks, back.checks), "check of a calibration", "checks of calibrations");
  count(missing(lost.decisions, back.decisions), "decision about a slab", "decisions about slabs");
  count(missing(lost.resets, back.resets), "reset of a mould", "resets of moulds");
  count(missing(lost.gauges, back.gauges), "master check of a gauge", "master checks of gauges");
  return text;
}

Known known_at(const std::string& path) {
  Known known;
  if (file_bytes(path) == 0) return known;
  const Result<std::unique_ptr<Connection>> opened = open_any_version(path);
  if (!opened.ok()) return known;
  Connection& db = *opened.value();
  const auto newest = [&db](const char* sql) -> std::int64_t {
    try {
      return db.integer(sql);
    } catch (const SqlFailure&) {
      return 0;  // damaged
    }
  };
  known.slab_key = std::max(newest("SELECT coalesce(max(slab_key), 0) FROM slab"),
                            newest("SELECT max(keys_used, pruned_key) FROM line"));
  const auto all = [&db](const char* sql) -> std::set<std::string> {
    std::set<std::string> found;
    try {
      Statement rows(db, sql);
      while (rows.step()) found.emplace(rows.text(0));
    } catch (const SqlFailure&) {
      // Damaged; the rows that could be read count.
    }
    return found;
  };
  known.applied =
      all("SELECT seq || ' ' || kind || ' ' || slab_type || ' ' || calibration_id || ' ' || utime_us FROM applied");
  known.checks = all("SELECT seq || ' ' || reference_id || ' ' || passed || ' ' || utime_us FROM calibration_check");
  known.decisions = all("SELECT slab_key || ' ' || n || ' ' || decision || ' ' || utime_us FROM disposition");
  known.resets = all("SELECT mould || ' ' || from_utime_us || ' ' || utime_us FROM mould_reset");
  known.gauges = all("SELECT seq || ' ' || gauge || ' ' || passed || ' ' || utime_us FROM gauge_check");
  return known;
}

void end_open_slab(Connection& db, const RestoreOrder& order, Jobs& jobs) {
  const std::int64_t key = db.integer(
      "SELECT coalesce(max(slab.slab_key), 0) FROM slab LEFT JOIN slab_result USING (slab_key) "
      "WHERE slab_result.slab_key IS NULL");
  if (key == 0) return;
  SlabJob job;
  job.slab_key = key;
  job.slab.verdict = Verdict::aborted;
  job.slab.reason = static_cast<std::uint16_t>(Code::interrupted);
  job.record.res_seq = order.session;
  job.record.kind = 2;
  job.record.slab_no =
      static_cast<std::uint32_t>(db.integer("SELECT slab_no FROM slab WHERE slab_key = " + std::to_string(key)));
  job.record.verdict = Verdict::aborted;
  job.record.reason = job.slab.reason;
  job.ended_utime_us = order.note.utime_us;
  jobs(job);
}

void prepare(Connection& db, const StoreSettings& settings, const RestoreOrder& order, std::int64_t keys_used) {
  const HeldBack nothing;
  Jobs jobs(db, settings, nothing);
  Transaction transaction(db, "BEGIN IMMEDIATE");
  Statement(db, "INSERT INTO epoch (uuid, began_utime_us) VALUES (lower(hex(randomblob(16))), ?1)")
      .bind(1, order.note.utime_us)
      .run();
  jobs.begin_chain();
  jobs.interrupt_unfinished();
  end_open_slab(db, order, jobs);
  const std::int64_t keys = std::max({keys_used, db.integer("SELECT max(keys_used, pruned_key) FROM line"),
                                      db.integer("SELECT coalesce(max(slab_key), 0) FROM slab")});
  Statement(db, "UPDATE line SET session = ?1, keys_used = ?2")
      .bind(1, std::int64_t{order.session})
      .bind(2, keys)
      .run();
  Statement(
      db,
      "INSERT INTO care (what, slab_key, source, who, why, utime_us, res_seq, result_id) VALUES (?1, ?2, ?3, ?4, ?5, "
      "?6, ?7, (SELECT coalesce(max(id), 0) FROM result))")
      .bind(1, std::string_view(order.from.empty() ? "begun_anew" : "restored"))
      .bind(2, keys)
      .bind(3, std::string_view(order.from))
      .bind(4, std::string_view(order.note.who))
      .bind(5, std::string_view(order.note.why))
      .bind(6, order.note.utime_us)
      .bind(7, std::int64_t{order.session})
      .run();
  Seals(db).note_care(db.integer("SELECT max(seq) FROM care"));
  // The scans of the last days are unknown here, so the first scan of the scanner cannot be trusted.
  jobs(SeenScanJob{kUnseenScan});
  transaction.commit();
}

Status clear_part(const std::string& part) {
  std::error_code ec;
  for (const char* side : {"", "-wal", "-shm", "-journal", ".part"}) {
    fs::remove(part + side, ec);
    if (ec) return error(Code::journal_write, "cannot delete %s%s: %s", part.c_str(), side, ec.message().c_str());
  }
  return success();
}

/// Deletes the prepared file on failure, because it may have gigabytes and no program refers to it. After keep() the
/// file stays: it proves that there was a database, while the replaced one is moved to quarantine.
class PartGuard {
 public:
  /// `is_sign`: the file of an earlier interrupted restore is the only proof that there was a database.
  PartGuard(std::string part, bool is_sign) : part_(std::move(part)), is_sign_(is_sign) {}
  ~PartGuard() {
    if (kept_) return;
    (void)clear_part(part_);  // the failure is already reported
    if (is_sign_) std::ofstream(part_) << "slabctl db restore was cut short here, and failed when it was begun again\n";
  }
  PartGuard(const PartGuard&) = delete;
  PartGuard& operator=(const PartGuard&) = delete;
  void keep() { kept_ = true; }

 private:
  std::string part_;
  bool is_sign_;
  bool kept_ = false;
};

/// Rejects a log that SQLite would use for the new database. If a database or a quarantine's note exists, the log
/// belongs to it and is moved with it.
Status check_nothing_strays(const std::string& path) {
  if (file_bytes(path) > 0) return success();
  for (const char* side : {"-wal", "-shm", "-journal", kLogCopy})
    if (file_bytes(path + side) > 0)
      return error(Code::journal_write, "%s%s exists without its database; move it away", path.c_str(), side);
  return success();
}

Status put_in_place(const std::string& part, const std::string& path, PartGuard& guard) {
  if (Status status = check_nothing_strays(path); !status.ok()) return status;
  if (file_bytes(path) > 0) guard.keep();
  if (file_bytes(path) > 0 && !quarantine_note(path)) {
    const Result<std::string> folder = quarantine(path, kReplaced);
    if (!folder.ok()) return folder.error();
  }
  if (Status status = finish_quarantine(path); !status.ok()) return status;
  if (Status status = rename_file(part, path); !status.ok()) return status;
  guard.keep();  // the file is the database now
  return sync_file(fs::path(path).parent_path().string());
}

}  // namespace

Status restore_database(const StoreSettings& settings, const RestoreOrder& order) {
  const std::string& path = settings.db_path;
  if (const std::string folder = fs::path(path).parent_path().string(); !folder.empty())
    if (Status status = make_folder(folder); !status.ok()) return status;
  WriterLock lock;
  if (Status status = lock.take(path); !status.ok()) return status;
  const std::string part = path + kRestored;
  if (!order.from.empty()) {
    std::error_code ec;
    if (fs::equivalent(order.from, part, ec) || fs::equivalent(order.from, part + ".part", ec))
      return error(Code::config,
                   "%s is the remainder of an interrupted restore and will be deleted: give the backup itself",
                   order.from.c_str());
    const Result<DatabaseReport> report = check_database(order.from, true);
    if (!report.ok()) return report.error();
    if (!report.value().trouble.empty())
      return error(Code::journal_write, "%s is not whole: %s", order.from.c_str(), report.value().trouble.c_str());
    if (!report.value().has_checksum && !order.accept_unproven)
      return error(Code::config,
                   "%s has no checksum: another program made it, and a value in it may have changed unseen. Take a "
                   "backup that has one; --unproven restores this one",
                   order.from.c_str());
    const Result<ChainReport> chain = check_chain(order.from);
    if (!chain.ok()) return chain.error();
    if (!chain.value().trouble.empty() && !order.accept_unproven)
      return error(Code::config,
                   "%s was altered before it was backed up: %.300s. Take an older backup; --unproven restores this one",
                   order.from.c_str(), chain.value().trouble.c_str());
  }
  // An intact database that an earlier, interrupted restore had moved to quarantine still shows the losses. A damaged
  // one, or one whose log cannot be made durable, does not.
  if (Status status = finish_quarantine(path); !status.ok()) return status;
  const std::string replaced = quarantine_note(path) ? replaced_in_quarantine(path) : path;
  const bool speaks = !replaced.empty() && file_bytes(replaced) > 0 && make_log_durable(replaced).ok();
  const Known lost = speaks ? known_at(replaced) : Known{};
  const Known back = order.from.empty() ? Known{} : known_at(order.from);
  const std::string losses = losses_of(lost, back);
  if (!order.lose_calibrations && !losses.empty())
    return error(Code::config,
                 "%s holds what is not in %s and would be lost: %s. Look at it (slabctl calibrate history, history "
                 "--disposition, mould list); --lose-calibrations accepts the loss",
                 replaced.c_str(), order.from.empty() ? "an empty history" : order.from.c_str(), losses.c_str());
  const std::int64_t keys_used = std::max(lost.slab_key, newest_key_in_spool(settings.spool_dir));
  if (Status status = check_nothing_strays(path); !status.ok()) return status;
  const bool is_sign = file_bytes(path) == 0 && (file_bytes(part) > 0 || file_bytes(part + ".part") > 0);
  if (Status status = clear_part(part); !status.ok()) return status;
  PartGuard guard(part, is_sign);  // outlives the connections below
  try {
    if (!order.from.empty()) {
      Result<std::unique_ptr<Connection>> source = open_any_version(order.from);
      if (!source.ok()) return source.error();
      Backup copy(*source.value(), part, 0, Backup::Kind::in_the_work);
      while (!copy.step(-1)) usleep(10'000);
    }
    Result<std::unique_ptr<Connection>> db = open_copy_for_writing(part);
    if (!db.ok()) return db.error();
    prepare(*db.value(), settings, order, keys_used);
  } catch (const SqlFailure& failure) {
    return error((failure.result & 0xFF) == SQLITE_FULL ? Code::store_full : Code::journal_write, "%s: %s",
                 part.c_str(), failure.text.c_str());
  }
  // After the only connection is closed, all data is in the file and the log is empty.
  if (file_bytes(part + "-wal") > 0) return error(Code::journal_write, "%s could not be closed", part.c_str());
  std::error_code ec;
  fs::remove(part + "-wal", ec);
  fs::remove(part + "-shm", ec);
  if (Status status = sync_file(part); !status.ok()) return status;
  return put_in_place(part, path, guard);
}

}  // namespace slabd::storage
