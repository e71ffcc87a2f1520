// SPDX-License-Identifier: Apache-2.0
#include "storage/files/backup.h"

#include <fcntl.h>
#include <sqlite3.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <ctime>
#include <filesystem>

#include "storage/files/database.h"
#include "storage/files/folders.h"
#include "storage/storage.h"

namespace slabd::storage {
namespace {

constexpr std::uint64_t kRoomLeft = 200'000'000;  ///< space for the records of a day

[[noreturn]] void fail(const std::string& text, int result = SQLITE_IOERR) {
  throw SqlFailure{result, text};
}

std::string folder_of(const std::string& path) {
  return std::filesystem::path(path).parent_path().string();
}

}  // namespace

// If the file system does not support these locks, the copy continues; deletion requires the lock too, so the copy is
// safe.
void Backup::WorkLock::take(const std::string& path) {
  fd_ = Fd(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (fd_.is_open()) (void)flock(fd_.get(), LOCK_EX | LOCK_NB);
}

Backup::Backup(Connection& from, std::string to, std::uint64_t leave_bytes, Kind kind)
    : to_(std::move(to)), part_(to_ + ".part"), kind_(kind), page_bytes_(from.integer("PRAGMA page_size")) {
  std::error_code ec;
  if (std::filesystem::exists(std::filesystem::symlink_status(to_, ec))) fail(to_ + " exists already");
  const auto bytes = static_cast<std::uint64_t>(from.integer("PRAGMA page_count") * page_bytes_);
  std::array<char, 160> what{};
  constexpr double kMb = 1e6;
  std::snprintf(what.data(), what.size(), "a copy of %.1f MB, with %.0f MB left for a day's records%s,",
                static_cast<double>(bytes) / kMb, static_cast<double>(kRoomLeft) / kMb,
                leave_bytes > 0 ? " and the room for the next slab's scans" : "");
  must(check_room(folder_of(to_), bytes + kRoomLeft + leave_bytes, what.data()));
  std::filesystem::remove(part_, ec);  // left by an interrupted copy
  try {
    must(create_file(part_));
    begin(from);
  } catch (...) {
    end();
    std::filesystem::remove(part_, ec);
    throw;
  }
}

void Backup::begin(Connection& from) {
  lock_.take(part_);
  copy_ = std::make_unique<Connection>(in_real_folder(part_), SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOFOLLOW);
  // step() syncs the copy, and it is not valid before it is renamed.
  copy_->execute("PRAGMA synchronous = OFF");
  copy_->execute("PRAGMA journal_mode = OFF");
  copy_->execute("PRAGMA cache_size = -1024");
  backup_ = sqlite3_backup_init(copy_->handle(), "main", from.handle(), "main");
  if (backup_ == nullptr) fail(std::string("no copy can be made: ") + sqlite3_errmsg(copy_->handle()));
}

Backup::~Backup() {
  end();
  if (has_its_name_) return;
  std::error_code ec;
  std::filesystem::remove(part_, ec);
}

void Backup::end() {
  if (backup_ != nullptr) sqlite3_backup_finish(backup_);
  backup_ = nullptr;
  copy_.reset();
  checksum_.reset();
}

bool Backup::step(int pages) {
  if (checksum_) {
    bool done = false;
    must(checksum_->step(pages < 0 ? ~std::uint64_t{0} : static_cast<std::uint64_t>(pages * page_bytes_), done));
    // Reading takes as long as copying. slabctl gives up if the count does not change for two minutes.
    pages_done_ = std::min(pages_all_, static_cast<std::int64_t>(checksum_->bytes_read()) / page_bytes_);
    if (done) name_it();
    return done;
  }
  const int stepped = sqlite3_backup_step(backup_, pages);
  if (stepped == SQLITE_BUSY || stepped == SQLITE_LOCKED) return false;
  if (stepped != SQLITE_OK && stepped != SQLITE_DONE)
    fail("copying to " + part_ + ": " + sqlite3_errstr(stepped), stepped);
  pages_all_ = sqlite3_backup_pagecount(backup_);
  pages_done_ = pages_all_ - sqlite3_backup_remaining(backup_);
  if (stepped != SQLITE_DONE) {
    must(sync_file(part_));
    return false;
  }
  finish_copy();
  if (kind_ == Kind::in_the_work) {
    name_it();
    return true;
  }
  checksum_ = std::make_unique<ChecksumWriter>(part_);
  return false;
}

void Backup::finish_copy() {
  const int result = sqlite3_backup_finish(backup_);
  backup_ = nullptr;
  if (result != SQLITE_OK) fail("copying to " + part_ + ": " + sqlite3_errstr(result), result);
  if (kind_ == Kind::backup) copy_->execute("PRAGMA default_cache_size = " + std::to_string(kBackupMark));
  // The result is a single file that can be read anywhere, without a log next to it.
  if (copy_->text("PRAGMA journal_mode = DELETE") != "delete") fail(part_ + " cannot be made a file of its own");
  copy_.reset();
  must(sync_file(part_));
}

void Backup::name_it() {
  checksum_.reset();
  must(rename_file(part_, to_));
  has_its_name_ = true;
  must(sync_file(folder_of(to_)));
}

Result<std::string> backup_folder(const std::string& db_path) {
  const std::string folder = db_path.substr(0, db_path.rfind('/') + 1) + "backups";
  if (Status status = make_folder(folder); !status.ok()) return status.error();
  return folder;
}

void remove_cut_short_backups(const std::string& db_path) {
  namespace fs = std::filesystem;
  std::error_code ec;
  const std::string folder = db_path.substr(0, db_path.rfind('/') + 1) + "backups";
  for (fs::directory_iterator entry(folder, ec), end; !ec && entry != end; entry.increment(ec)) {
    const std::string name = entry->path().filename().string();
    if (!name.starts_with("slabd-") || !name.ends_with(".db.part")) continue;
    // Decided by the lock of the writing process, not by age: after a power cut the daemon starts within a minute.
    const Fd part(open(entry->path().c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW));
    std::error_code gone;
    if (part.is_open() && flock(part.get(), LOCK_EX | LOCK_NB) == 0) fs::remove(entry->path(), gone);
  }
}

Result<std::string> backup_path(const std::string& db_path, std::int64_t utime_us) {
  // No look at the disk: the loop calls this.
  const std::string folder = db_path.substr(0, db_path.rfind('/') + 1) + "backups";
  const std::time_t seconds = utime_us / 1'000'000;
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  std::array<char, 32> day{};
  std::strftime(day.data(), day.size(), "/slabd-%Y%m%dT%H%M%S.", &utc);
  const std::string ms = std::to_string(1000 + utime_us / 1000 % 1000).substr(1);
  return folder + day.data() + ms + "Z.db";
}

Status back_up_database(const std::string& db_path, const std::string& to) {
  Result<std::unique_ptr<Connection>> db = open_for_reading(db_path);
  if (!db.ok()) return db.error();
  try {
    Backup backup(*db.value(), to, 0);
    while (!backup.step(-1)) usleep(10'000);
    db.value()->check_still();
    return success();
  } catch (const SqlFailure& failure) {
    return error((failure.result & 0xFF) == SQLITE_FULL ? Code::store_full : Code::journal_write, "backup of %s: %s",
                 db_path.c_str(), failure.text.c_str());
  }
}

}  // namespace slabd::storage
