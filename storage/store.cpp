// SPDX-License-Identifier: Apache-2.0
//
// The writer: one connection, one thread, one transaction per job.
//
// A rejected job (a contradiction, a full disk) is rolled back and the connection is kept. Any other write error closes
// the connection. After a failed sync the state of the disk is unknown, and a retry on the same connection could depend
// on it. The next job reopens the file, which makes the log durable; quick_check runs only if the error looked like
// damage.
#include <sqlite3.h>

#include <algorithm>
#include <array>
#include <exception>
#include <mutex>
#include <optional>
#include <tuple>

#include "base/durable.h"
#include "base/rules.h"
#include "storage/calibrations.h"
#include "storage/chain.h"
#include "storage/files/backup.h"
#include "storage/files/database.h"
#include "storage/files/folders.h"
#include "storage/files/quarantine.h"
#include "storage/files/retention.h"
#include "storage/jobs.h"
#include "storage/load.h"
#include "storage/storage.h"

namespace slabd::storage {
namespace {

/// A third of a second: the PLC sends its next command sooner after a commit.
constexpr int kQuietLooks = 4;
/// Five seconds: limits the retries on a failing disk.
constexpr int kLooksToSettle = 50;
/// 1 MB of a copy per call, ten times a second: a few milliseconds of disk time.
constexpr int kBackupPages = 256;
/// One second: time until an idle line detects that its database was removed.
constexpr int kLooksAtPlace = 10;

/// Objects that depend on one opened file.
struct OpenDatabase {
  OpenDatabase(std::unique_ptr<Connection> connection, const StoreSettings& settings, const HeldBack& held_back)
      : db(std::move(connection)),
        jobs(*db, settings, held_back),
        spool(*db, settings.spool_dir, settings.spool_budget_bytes),
        retention(*db, settings.keep_unsent),
        log_file(file_id(settings.db_path + "-wal")) {}

  std::unique_ptr<Connection> db;
  Jobs jobs;
  Spool spool;
  Retention retention;
  std::optional<FileId> log_file;  ///< stays the same while the connection is open
  std::unique_ptr<Backup> backup;  ///< copy in progress; ends with the connection it reads
};

/// True for errors after which SQLite has rolled back cleanly and the connection is usable.
bool leaves_connection_good(int result) {
  const int primary = result & 0xFF;
  return primary == SQLITE_CONSTRAINT || primary == SQLITE_FULL || primary == SQLITE_BUSY;
}

/// True if the next open must check the whole file.
bool looks_damaged(int result) {
  const int primary = result & 0xFF;
  return primary == SQLITE_CORRUPT || primary == SQLITE_NOTADB;
}

/// Jobs that returned an error but may be in the database. Records for the PLC are reverted. A failed scan is written,
/// because the job is not repeated. Otherwise the previous attempt would remain the valid one for the slab's verdict.
class Unsettled {
 public:
  [[nodiscard]] bool empty() const {
    const auto unused = [](const BlockKey& block) { return block.slab_key == 0; };
    return end_ == 0 && report_ == 0 && attempt_.attempt.slab_key == 0 &&
           std::all_of(blocks_.begin(), blocks_.end(), unused);
  }
  void add(const StoreJob& job, Code code) {
    if (const auto* end = std::get_if<SlabJob>(&job.what)) end_ = end->slab_key;
    if (const auto* report = std::get_if<ReportJob>(&job.what)) report_ = report->record.res_seq;
    if (const auto* block = std::get_if<BlockJob>(&job.what))
      if (block->block.station >= 1 && block->block.station <= blocks_.size())
        blocks_[block->block.station - 1U] = {block->slab_key, block->block.station, block->attempt};
    // Only one at a time: the command for the next one is written before it begins.
    if (const auto* scan = std::get_if<AcquiredJob>(&job.what))
      attempt_ = {scan->attempt, static_cast<std::uint16_t>(code), scan->fingerprint};
    if (const auto* failed = std::get_if<FailedAttemptJob>(&job.what)) attempt_ = *failed;
  }
  void forget_attempt() { attempt_ = {}; }
  /// Reverts the jobs, in the transaction of the next job before its changes, or in a separate one.
  void settle(Jobs& jobs) const {
    if (end_ != 0) jobs.undo_end(end_);
    if (report_ != 0) jobs.undo_report(report_);
    for (const BlockKey& block : blocks_)
      if (block.slab_key != 0) jobs.undo_block(block);
    if (attempt_.attempt.slab_key != 0) jobs(attempt_);
  }

 private:
  std::int64_t end_ = 0;
  std::uint16_t report_ = 0;
  /// Indexed by station: no other attempt of a station is measured before a job was written.
  std::array<BlockKey, limits::kStationsMax> blocks_{};
  FailedAttemptJob attempt_;
};

class SqliteStore final : public Store {
 public:
  explicit SqliteStore(const StoreSettings& settings) : settings_(settings) {}

  Status open() {
    if (Status status = make_folder(settings_.spool_dir); !status.ok()) return status;
    if (Status status = check_writable(settings_.spool_dir); !status.ok()) return status;
    if (const std::string sign = traces_of_a_lost_database(settings_.db_path, settings_.spool_dir); !sign.empty())
      return error(Code::journal_write,
                   "there is no database %s, but %s shows that there was one: is its disk mounted? Else put a backup "
                   "there with slabctl db restore, or start again with --fresh",
                   settings_.db_path.c_str(), sign.c_str());
    if (Status status = reopen(); !status.ok()) return status;
    if (Status status = check_age(); !status.ok()) return status;
    file_ = file_id(settings_.db_path);
    (void)backup_folder(settings_.db_path);
    remove_cut_short_backups(settings_.db_path);
    return success();
  }

  Result<std::unique_ptr<RecoveredLine>> recover() override {
    auto line = std::make_unique<RecoveredLine>();
    HeldBack held_back;
    const Status status = run("recovery", [&](OpenDatabase& open) {
      Transaction transaction(*open.db, "BEGIN IMMEDIATE");
      open.jobs.begin_chain();
      open.jobs.interrupt_unfinished();
      held_back = read_line(*open.db, *line);
      Calibrations calibrations(*open.db);
      calibrations.in_force(settings_.arms, line->calibration);
      if (line->slab_open) calibrations.of_slab(line->slab, line->slab_calibration);
      transaction.commit();
    });
    if (!status.ok()) return status.error();
    read_head();
    held_back_ = held_back;
    tidy_spool([](Spool& spool) { return spool.drop_orphans(); });
    return line;
  }

  Status apply(const StoreJob& job) override {
    take_recipes();
    quiet_looks_ = 0;
    log_holds_commits_ = true;
    backlog_due_ = true;
    if (std::holds_alternative<BeginSlabJob>(job.what))
      if (Status status = check_free_space(); !status.ok()) {
        trim_due_ = true;  // a slab that does not begin does not end either, so the spool is trimmed in idle()
        return status;
      }
    Status status = look_at_place();
    contradicted_ = false;
    std::optional<Error> answer;
    if (status.ok())
      status = run("job", [&](OpenDatabase& open) {
        Transaction transaction(*open.db, "BEGIN IMMEDIATE");
        unsettled_.settle(open.jobs);
        std::ignore = open.jobs.take_answer();
        std::visit(open.jobs, job.what);
        answer = open.jobs.take_answer();
        transaction.commit();
      });
    // A job is reported as done only if the next start will find it.
    if (status.ok()) status = look_at_place();
    if (status.ok()) {
      unsettled_ = {};
    } else if (contradicted_) {
      // It was rolled back and would be rejected again. The cause may be an unsettled job.
      looks_to_settle_ = 0;
      (void)settle();
    } else {
      unsettled_.add(job, status.error().code);
      looks_to_settle_ = 0;
    }
    const bool ended = std::holds_alternative<SlabJob>(job.what);
    if (ended && status.ok()) read_head();
    if (ended) retention_due_ = true;
    const bool may_trim = ended || std::holds_alternative<AckJob>(job.what);
    if (status.ok() && may_trim) trim_spool();
    if (status.ok() && answer) return *answer;
    return status;
  }

  /// In the thread that also deletes scans, so a pin is never written next to scans that are being deleted.
  [[nodiscard]] Result<std::string> keep_pin(const KeepPin& pin) const {
    constexpr std::size_t kPinBytesMax = 8'192;
    const std::string slab = "slab " + std::to_string(pin.slab_key);
    const std::string folder = settings_.spool_dir + "/" + std::to_string(pin.slab_key);
    const std::string path = folder + "/" + Spool::kPinName;
    const FileState there = file_state(AT_FDCWD, folder.c_str());
    if (pin.slab_key < 1 || !there.known || !S_ISDIR(there.mode))
      return error(Code::config, "%s: its scans are gone (%s is not there)", slab.c_str(), folder.c_str());
    if (pin.text.size() > kPinBytesMax)
      return error(Code::config, "%s: a pin of %zu bytes, allowed are %zu", slab.c_str(), pin.text.size(),
                   kPinBytesMax);
    if (pin.text.empty()) {
      if (::unlink(path.c_str()) == 0) return "unpinned " + slab;
      if (errno == ENOENT) return error(Code::config, "%s is not pinned", slab.c_str());
      return error(Code::journal_write, "%s cannot be removed: %s", path.c_str(), errno_text(errno));
    }
    if (Status status = write_durably(path, pin.text); !status.ok()) return status.error();
    return "pinned " + slab;
  }

  Result<std::string> change(const CalibrationChange& ordered) override {
    if (const auto* pin = std::get_if<KeepPin>(&ordered)) return keep_pin(*pin);
    CalibrationChange change = ordered;
    if (auto* keep = std::get_if<KeepDisposition>(&change)) keep->needs_second = settings_.second_person;
    log_holds_commits_ = true;
    backlog_due_ = true;
    if (Status status = look_at_place(); !status.ok()) return status.error();
    std::string id;
    const Status status = run("calibration", [&](OpenDatabase& open) {
      Transaction transaction(*open.db, "BEGIN IMMEDIATE");
      id = Calibrations(*open.db).carry_out(change);
      transaction.commit();
    });
    if (!status.ok()) return status.error();
    return id;
  }

  Result<std::unique_ptr<CellCalibration>> calibration() override {
    auto calibration = std::make_unique<CellCalibration>();
    const Status status = run("calibration", [&](OpenDatabase& open) {
      Transaction transaction(*open.db, "BEGIN");
      Calibrations(*open.db).in_force(settings_.arms, *calibration);
      transaction.commit();
    });
    if (!status.ok()) return status.error();
    return calibration;
  }

  void idle() override {
    if (looks_to_reopen_ > 0) --looks_to_reopen_;
    if (looks_to_place_ > 0) --looks_to_place_;
    if (looks_to_place_ == 0) (void)look_at_place();
    if (quiet_looks_ < kQuietLooks && ++quiet_looks_ < kQuietLooks) return;
    // A failure does not stop the rest: pruning, trimming and the checkpoint may free space. If the file was removed
    // and is not open, the waiting backup order ends with an error.
    if (settle() || (!open_ && !trouble_.empty())) back_up_a_piece();
    if (!trouble_.empty()) {
      // Nothing is deleted if the next start would not find this database.
      refuse_to_prune();
      return;
    }
    prune_one();
    if (trim_due_) trim_spool();
    look_at_outbox();
    if (!log_holds_commits_ || !open_) return;
    // The log's content is durable, so a failure here is ignored; the next job reopens the file and reports it.
    (void)run("checkpoint", [&](OpenDatabase& open) { log_holds_commits_ = !open.db->checkpoint(); });
  }

  Status keep_events(const std::vector<LineEvent>& events) override {
    static constexpr std::array<std::string_view, 3> kKinds = {"started", "fault", "cleared"};
    if (Status status = look_at_place(); !status.ok()) return status;
    if (Status status = reopen_when_idle(); !status.ok()) return status;
    log_holds_commits_ = true;
    backlog_due_ = true;
    return run("events", [&](OpenDatabase& open) {
      Transaction transaction(*open.db, "BEGIN IMMEDIATE");
      // An event of a commit whose sync failed may be there: the log was written again when the file was opened.
      Statement insert(
          *open.db,
          "INSERT INTO event (kind, code, text, utime_us) SELECT ?1, ?2, ?3, ?4 WHERE NOT EXISTS (SELECT 1 "
          "FROM (SELECT kind, code, utime_us FROM event ORDER BY seq DESC LIMIT 64) WHERE kind = ?1 AND "
          "code = ?2 AND utime_us = ?4)");
      for (const LineEvent& event : events)
        insert.bind(1, kKinds.at(static_cast<std::size_t>(event.kind)))
            .bind(2, std::int64_t{event.code})
            .bind(3, std::string_view(event.text))
            .bind(4, event.utime_us)
            .run();
      transaction.commit();
    });
  }

  std::string_view spool_trouble() const override { return spool_trouble_.view(); }

  void use_recipes(const std::vector<RecipeText>& texts) override {
    const std::lock_guard lock(recipes_mutex_);
    recipes_next_ = texts;
  }

  std::string_view trouble() const override { return trouble_.view(); }

  Status order(const CareOrder& order) override {
    using Phase = CareState::Phase;
    const std::lock_guard lock(care_mutex_);
    if (const auto* backup = std::get_if<BackupOrder>(&order)) {
      if (backup->path.empty()) return error(Code::config, "a backup needs a path");
      if (care_.backup == Phase::under_way) return error(Code::busy, "a backup is under way already");
      care_.backup = Phase::under_way;
      care_.backup_path = backup->path;
      care_.backup_pages = care_.backup_pages_all = 0;
      care_.backup_error.clear();
      return success();
    }
    if (const auto* sent = std::get_if<SentOrder>(&order)) return note_sent(*sent);
    const PruneOrder& prune = std::get<PruneOrder>(order);
    // Slabs kept by the settings are deleted by an order only if it states so explicitly.
    const std::int64_t failed =
        prune.keep_failed_slabs.value_or(settings_.keep_slabs != 0 ? settings_.keep_failed_slabs : prune.keep_slabs);
    if (prune.keep_slabs < kKeepSlabsMin)
      return error(Code::config, "at least the newest %lld slabs are kept", static_cast<long long>(kKeepSlabsMin));
    if (failed != 0 && failed < kKeepSlabsMin)
      return error(Code::config, "of slabs that did not pass at least the newest %lld are kept, or all (0)",
                   static_cast<long long>(kKeepSlabsMin));
    if (care_.prune == Phase::under_way) return error(Code::busy, "pruning is under way already");
    care_.prune = Phase::under_way;
    care_.pruned_slabs = 0;
    care_.prune_error.clear();
    prune_order_ = {prune.keep_slabs, failed};
    return success();
  }

  [[nodiscard]] ChainHead head() const {
    const std::lock_guard lock(care_mutex_);
    return head_;
  }

  CareState care() const override {
    const std::lock_guard lock(care_mutex_);
    return care_;
  }

 private:
  /// Jobs reads the texts of the settings, only on this thread.
  void take_recipes() {
    const std::lock_guard lock(recipes_mutex_);
    if (recipes_next_) settings_.recipe_texts = std::move(*recipes_next_);
    recipes_next_.reset();
  }

  /// Reads the head of the chain. If that fails it is read after the next slab, because it is only displayed.
  void read_head() {
    ChainHead head;
    if (!open_) return;
    try {
      Statement newest(*open_->db, "SELECT seq, lower(hex(sha256)) FROM slab_seal ORDER BY seq DESC LIMIT 1");
      if (newest.step()) {
        head.entries = newest.integer(0);
        head.sha256.assign(newest.text(1));
      }
    } catch (const SqlFailure&) {
      return;
    }
    const std::lock_guard lock(care_mutex_);
    head_ = head;
  }

  /// Reverts unsettled jobs if no job arrives, so that unreported results do not appear in the history or in a copy.
  /// True if nothing is left to settle.
  bool settle() {
    if (unsettled_.empty()) return true;
    if (looks_to_settle_ > 0 && --looks_to_settle_ > 0) return false;
    const Status status = run("what came before", [&](OpenDatabase& open) {
      Transaction transaction(*open.db, "BEGIN IMMEDIATE");
      unsettled_.settle(open.jobs);
      transaction.commit();
    });
    log_holds_commits_ = true;
    // A job that contradicts the database would do so again, and must not block all later jobs.
    if (contradicted_) unsettled_.forget_attempt();
    if (status.ok())
      unsettled_ = {};
    else
      looks_to_settle_ = kLooksToSettle;
    return status.ok();
  }

  /// Copies a piece of the ordered backup. A failure ends only the copy; the next job reopens the file if necessary.
  void back_up_a_piece() {
    std::string path;
    {
      const std::lock_guard lock(care_mutex_);
      if (care_.backup != CareState::Phase::under_way) return;
      path = care_.backup_path;
    }
    CareState::Phase phase = CareState::Phase::under_way;
    std::int64_t done = 0;
    std::int64_t all = 0;
    std::string why;
    const Status opened = reopen();
    try {
      if (!opened.ok()) throw SqlFailure{SQLITE_IOERR, std::string(opened.error().text.view())};
      if (!open_->backup) {
        (void)backup_folder(settings_.db_path);
        const std::string folder = path.substr(0, path.rfind('/') + 1);
        const bool takes_scans_room = share_a_disk(folder.empty() ? "." : folder, settings_.spool_dir);
        open_->backup =
            std::make_unique<Backup>(*open_->db, path, takes_scans_room ? settings_.spool_free_bytes_min : 0);
      }
      if (open_->backup->step(kBackupPages)) phase = CareState::Phase::done;
      done = open_->backup->pages_done();
      all = open_->backup->pages_all();
    } catch (const SqlFailure& failure) {
      phase = CareState::Phase::failed;
      why = failure.text;
    }
    if (phase != CareState::Phase::under_way && open_) open_->backup.reset();
    const std::lock_guard lock(care_mutex_);
    care_.backup = phase;
    care_.backup_error = why;
    care_.backup_pages = done;
    care_.backup_pages_all = all;
  }

  /// Prunes one slab, by order or because a slab has ended and the number is limited. Not during a copy, which would
  /// then have to copy the changed pages again.
  void prune_one() {
    std::int64_t keep = settings_.keep_slabs;
    std::int64_t keep_failed = settings_.keep_failed_slabs;
    bool ordered = false;
    {
      const std::lock_guard lock(care_mutex_);
      if (care_.backup == CareState::Phase::under_way) return;
      ordered = care_.prune == CareState::Phase::under_way;
      if (ordered) keep = prune_order_.keep_slabs;
      if (ordered) keep_failed = prune_order_.keep_failed_slabs.value_or(keep);
    }
    if (!ordered && (!retention_due_ || keep == 0)) return;
    bool more = false;
    const Status status =
        run("retention", [&](OpenDatabase& open) { more = open.retention.take_one(keep, keep_failed); });
    if (more) log_holds_commits_ = true;
    if (more) read_head();
    if (!more) retention_due_ = false;
    if (!ordered) return;
    const std::lock_guard lock(care_mutex_);
    if (more) ++care_.pruned_slabs;
    if (more) return;
    care_.prune = status.ok() ? CareState::Phase::done : CareState::Phase::failed;
    if (!status.ok()) care_.prune_error = status.error().text.view();
  }

  /// With care_mutex_ held.
  Status note_sent(const SentOrder& sent) {
    const Backlog& now = care_.backlog;
    if (sent.epoch != now.epoch)
      return error(Code::config, "the epoch of this database is %s, not %s: it was restored since", now.epoch.c_str(),
                   sent.epoch.c_str());
    if (sent.seq < 0 || sent.seq > now.newest_seq)
      return error(Code::config, "row %lld of the outbox is not there: the newest is %lld",
                   static_cast<long long>(sent.seq), static_cast<long long>(now.newest_seq));
    sent_next_ = std::max(sent_next_.value_or(0), sent.seq);
    return success();
  }

  /// Writes what the plant's database has acknowledged, and reads how far it is behind.
  void look_at_outbox() {
    {
      const std::lock_guard lock(care_mutex_);
      if (!sent_next_ && !backlog_due_) return;
    }
    if (!reopen_when_idle().ok()) return;
    std::optional<std::int64_t> sent;
    {
      const std::lock_guard lock(care_mutex_);
      sent = std::exchange(sent_next_, std::nullopt);
    }
    Backlog now;
    const Status status = run("outbox", [&](OpenDatabase& open) {
      if (sent) {
        Transaction transaction(*open.db, "BEGIN IMMEDIATE");
        Statement(*open.db, "UPDATE line SET sent_seq = ?1 WHERE sent_seq < ?1").bind(1, *sent).run();
        transaction.commit();
        log_holds_commits_ = true;
        retention_due_ = true;
      }
      now.epoch = open.db->text("SELECT uuid FROM epoch ORDER BY n DESC LIMIT 1");
      now.newest_seq = open.db->integer("SELECT coalesce(max(seq), 0) FROM outbox");
      now.sent_seq = open.db->integer("SELECT sent_seq FROM line");
      now.oldest_utime_us = open.db->integer(
          "SELECT coalesce((SELECT utime_us FROM outbox WHERE seq > (SELECT sent_seq FROM line) ORDER BY seq LIMIT 1), "
          "0)");
    });
    if (!status.ok()) return;  // the next call reads it
    backlog_due_ = false;
    const std::lock_guard lock(care_mutex_);
    care_.backlog = now;
  }

  void refuse_to_prune() {
    const std::lock_guard lock(care_mutex_);
    if (care_.prune != CareState::Phase::under_way) return;
    care_.prune = CareState::Phase::failed;
    care_.prune_error = trouble_.view();
  }

  Status reopen() {
    if (open_) return success();
    if (!lock_) {
      const std::string folder = settings_.db_path.substr(0, settings_.db_path.rfind('/') + 1);
      if (!folder.empty())
        if (Status status = make_folder(folder); !status.ok()) return status;
      lock_.emplace();
      if (Status status = lock_->take(settings_.db_path); !status.ok()) {
        lock_.reset();
        return status;
      }
    }
    // Only a start may begin a new history; a different file at this path is not this line's database.
    if (file_ && !quarantine_note(settings_.db_path) && file_id(settings_.db_path) != file_)
      return error(
          Code::journal_write,
          "%s is not the file any more that slabd has worked with since its start: is its disk mounted? Put it "
          "back, or restart slabd",
          settings_.db_path.c_str());
    Result<std::unique_ptr<Connection>> db =
        checked_ ? open_again_for_writing(settings_.db_path) : open_for_writing(settings_.db_path);
    if (!db.ok()) return db.error();
    try {
      open_ = std::make_unique<OpenDatabase>(std::move(db.value()), settings_, held_back_);
      checked_ = true;
    } catch (const SqlFailure& failure) {
      return error(Code::journal_write, "cannot use database %s: %s", settings_.db_path.c_str(), failure.text.c_str());
    }
    return success();
  }

  /// For work that is repeated as long as it fails. After a failed opening, which reads the log and may read the whole
  /// file, the next calls of idle() do not try again. Jobs and orders do.
  Status reopen_when_idle() {
    if (!open_ && looks_to_reopen_ > 0)
      return error(Code::journal_write, "%s could not be opened, and is tried again later", settings_.db_path.c_str());
    const Status status = reopen();
    if (!status.ok()) looks_to_reopen_ = kLooksToSettle;
    return status;
  }

  /// Rejects a database that is older than the spool. A slab is stored in the database before its folder exists, so a
  /// slab known only to the spool was in a newer database. Its key would otherwise be assigned again, and the history
  /// would appear complete.
  Status check_age() {
    std::int64_t known = 0;
    const Status read = run("recovery", [&](OpenDatabase& open) { known = newest_key_used(*open.db); });
    if (!read.ok()) return read;
    const std::string scans = scans_above(settings_.spool_dir, known);
    if (scans.empty()) return success();
    return error(
        Code::journal_write,
        "%s holds slabs up to %lld, and %s holds later scans: there was a newer database. Is the right disk mounted? "
        "Otherwise put the newest backup there with slabctl db restore (this file itself, if there is none), or remove "
        "scans that are not this line's",
        settings_.db_path.c_str(), static_cast<long long>(known), scans.c_str());
  }

  /// Checks that the next start would find the commits. A file that was deleted or replaced while open accepts all
  /// commits without an error, and loses them with the process. The connection stays open: it has the only copy, and a
  /// backup can be made from it.
  Status look_at_place() {
    looks_to_place_ = kLooksAtPlace;
    if (!open_ && file_ && !trouble_.empty() && file_id(settings_.db_path) != file_) return success();
    trouble_.clear();
    if (!open_ || !file_) return success();  // reopen() performs the check itself
    const std::string log = settings_.db_path + "-wal";
    const bool stands = file_id(settings_.db_path) == file_;
    if (stands && (!open_->log_file || file_id(log) == open_->log_file)) return success();
    const Error lost =
        error(Code::journal_write,
              "%s is no longer the file that slabd opened: it was deleted or replaced. slabd "
              "still has it open: slabctl db backup saves it; then stop slabd and restore that backup (or put the file "
              "back)",
              (stands ? log : settings_.db_path).c_str());
    trouble_ = lost.text;
    return lost;
  }

  template <typename Work>
  Status run(const char* what, const Work& work) {
    contradicted_ = false;
    if (Status status = reopen(); !status.ok()) return status;
    try {
      work(*open_);
      return success();
    } catch (const Refusal& refusal) {
      contradicted_ = true;
      return refusal.error;
    } catch (const SqlFailure& failure) {
      contradicted_ = (failure.result & 0xFF) == SQLITE_CONSTRAINT;
      const bool full = (failure.result & 0xFF) == SQLITE_FULL;
      if (holds(Rule::connection_closed_on_failure) && !leaves_connection_good(failure.result)) give_up();
      if (looks_damaged(failure.result)) checked_ = false;
      if ((failure.result & 0xFF) == SQLITE_BUSY) return locked_out(what);
      return error(full ? Code::store_full : Code::journal_write, "%s: %s not written: %s", settings_.db_path.c_str(),
                   what, failure.text.c_str());
    } catch (const std::exception& e) {
      give_up();
      return error(Code::internal, "%s: %s not written: %s", settings_.db_path.c_str(), what, e.what());
    }
  }

  /// Error if another program has a transaction open.
  [[nodiscard]] Error locked_out(const char* what) {
    const std::string holder = lock_probe_.holder(settings_.db_path);
    return error(
        Code::journal_write,
        "%s: %s not written: the database is locked by %s; end that program, or its transaction, then reset the "
        "fault",
        settings_.db_path.c_str(), what,
        holder.empty() ? "another program, which has just released it" : holder.c_str());
  }

  /// Closes the file. The durable part of the log is unknown, so closing must not checkpoint it.
  void give_up() {
    if (open_) (void)sqlite3_db_config(open_->db->handle(), SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, nullptr);
    open_.reset();
  }

  Status check_free_space() const {
    const Result<std::uint64_t> free = free_bytes(settings_.spool_dir);
    if (!free.ok()) return free.error();
    if (free.value() >= settings_.spool_free_bytes_min) return success();
    return error(Code::store_full, "%s has %.1f MB free, a slab needs at least %.1f MB free to begin",
                 settings_.spool_dir.c_str(), static_cast<double>(free.value()) / 1e6,
                 static_cast<double>(settings_.spool_free_bytes_min) / 1e6);
  }

  /// Trims the scans of one slab per call, when a slab ends and when idle.
  void trim_spool() {
    trim_due_ = false;
    if (settings_.spool_budget_bytes == 0) return;
    tidy_spool([&](Spool& spool) { return spool.trim(trim_due_); });
    if (trim_due_) log_holds_commits_ = true;
  }

  /// Runs work on the spool; a failure there does not fail the job, which is already durable.
  template <typename Work>
  void tidy_spool(const Work& work) {
    Status tidied = success();
    const Status status = run("spool", [&](OpenDatabase& open) { tidied = work(open.spool); });
    const Status& worse = status.ok() ? tidied : status;
    spool_trouble_.clear();
    if (!worse.ok()) spool_trouble_ = worse.error().text;
  }

  StoreSettings settings_;
  std::optional<WriterLock> lock_;
  LockProbe lock_probe_;
  std::optional<FileId> file_;  ///< the database that was opened at the start
  bool checked_ = false;        ///< it was intact then, and no error has looked like damage since
  HeldBack held_back_;          ///< outlives a reopened file
  Unsettled unsettled_;
  bool contradicted_ = false;  ///< the last job contradicted the stored data
  int looks_to_settle_ = 0;    ///< calls of idle() until the next attempt
  int looks_to_reopen_ = 0;    ///< the same for reopen_when_idle()
  std::unique_ptr<OpenDatabase> open_;
  FixedString<limits::kErrorTextBytes> spool_trouble_;
  FixedString<limits::kErrorTextBytes> trouble_;
  int looks_to_place_ = 0;  ///< calls of idle() until the next check of the file's place
  bool log_holds_commits_ = false;
  int quiet_looks_ = 0;
  bool retention_due_ = true;  ///< a slab has ended since the last check
  bool trim_due_ = true;       ///< the spool may exceed its budget
  std::mutex recipes_mutex_;
  std::optional<std::vector<RecipeText>> recipes_next_;  ///< used by the next job
  mutable std::mutex care_mutex_;
  ChainHead head_;
  CareState care_;
  PruneOrder prune_order_;
  std::optional<std::int64_t> sent_next_;  ///< guarded by care_mutex_
  bool backlog_due_ = true;                ///< the outbox may have changed since it was read
};

}  // namespace

ChainHead chain_head(const Store& store) {
  const auto* sqlite = dynamic_cast<const SqliteStore*>(&store);
  return sqlite == nullptr ? ChainHead{} : sqlite->head();
}

Result<std::unique_ptr<Store>> open_store(const StoreSettings& settings) {
  auto store = std::make_unique<SqliteStore>(settings);
  if (Status status = store->open(); !status.ok()) return status.error();
  return std::unique_ptr<Store>(std::move(store));
}

}  // namespace slabd::storage
