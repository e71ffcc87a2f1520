// SPDX-License-Identifier: Apache-2.0
#include "storage/files/retention.h"

#include <sys/stat.h>
#include <unistd.h>
#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <filesystem>
#include <set>
#include <utility>
#include <vector>

#include "storage/files/folders.h"
#include "storage/seals.h"
#include "storage/storage.h"

namespace slabd::storage {
namespace {

/// Tables in the order of their references; deleting a block also deletes its planes, casings and maps.
constexpr std::array kTables = {"item",           "gauge_value", "block",    "attempt", "result",     "command",
                                "station_result", "slab_result", "slab_arm", "slab",    "disposition"};

/// With slab_key > 0, the condition of the index outbox_by_slab, without which each slab reads all unsent rows.
constexpr const char* kIsSent =
    "AND NOT EXISTS (SELECT 1 FROM outbox WHERE outbox.slab_key > 0 AND outbox.slab_key = slab.slab_key AND seq > "
    "(SELECT sent_seq FROM line)) ";

}  // namespace

Retention::Retention(Connection& db, bool keep_unsent)
    : db_(db),
      newest_(db, "SELECT slab_key FROM slab ORDER BY slab_key DESC LIMIT 1 OFFSET ?1"),
      newest_failed_(
          db, "SELECT slab_key FROM slab_result WHERE verdict <> 'pass' ORDER BY slab_key DESC LIMIT 1 OFFSET ?1"),
      candidate_(db,
                 std::string("SELECT slab_key FROM slab JOIN slab_result USING (slab_key) WHERE slab_key <= ?1 ") +
                     (keep_unsent ? kIsSent : "") +
                     "AND (verdict = 'pass' OR slab_key <= ?2) "
                     "AND NOT EXISTS (SELECT 1 FROM result WHERE result.slab_key = slab.slab_key AND acknowledged = 0) "
                     "AND NOT EXISTS (SELECT 1 FROM attempt WHERE attempt.slab_key = slab.slab_key "
                     "AND scan_state IN ('kept', 'deleting')) ORDER BY slab_key LIMIT 1"),
      drop_of_no_slab_(db,
                       "DELETE FROM command WHERE slab_key IS NULL "
                       "AND id < (SELECT min(id) FROM command WHERE slab_key IS NOT NULL)"),
      note_(db, "UPDATE line SET pruned_slabs = pruned_slabs + 1, pruned_key = max(pruned_key, ?1)") {}

std::int64_t Retention::key_at(Statement& newest_first, std::int64_t offset) {
  if (!newest_first.bind(1, offset).step()) return 0;
  const std::int64_t key = newest_first.integer(0);
  newest_first.reset();
  return key;
}

bool Retention::take_one(std::int64_t keep_slabs, std::int64_t keep_failed_slabs) {
  Transaction transaction(db_, "BEGIN IMMEDIATE");
  const std::int64_t newest = key_at(newest_, std::max(keep_slabs, kKeepSlabsMin));
  if (newest == 0) return false;
  const std::int64_t newest_failed = keep_failed_slabs == 0 ? 0 : key_at(newest_failed_, keep_failed_slabs);
  if (!candidate_.bind(1, newest).bind(2, newest_failed).step()) return false;
  const std::int64_t key = candidate_.integer(0);
  candidate_.reset();
  Seals(db_).prune(key);
  for (const char* table : kTables)
    db_.execute(std::string("DELETE FROM ") + table + " WHERE slab_key = " + std::to_string(key));
  drop_of_no_slab_.run();
  note_.bind(1, key).run();
  transaction.commit();
  return true;
}

namespace {

/// True for a regular file that got its name at `utime_us` or later: a rename sets ctime and keeps the other times. A
/// spool that outlived its database contains older files under the same slab keys; those are kept.
bool came_after(const std::string& path, std::int64_t utime_us) {
  struct stat there {};
  if (lstat(path.c_str(), &there) != 0 || !S_ISREG(there.st_mode)) return false;
  return there.st_ctim.tv_sec * std::int64_t{1'000'000} + there.st_ctim.tv_nsec / 1000 >= utime_us;
}

bool is_there(const std::string& path) {
  struct stat there {};
  return lstat(path.c_str(), &there) == 0 || errno != ENOENT;
}

std::string without_end_slash(std::string folder) {
  while (folder.size() > 1 && folder.back() == '/') folder.pop_back();
  return folder;
}

}  // namespace

bool is_scan_name(const std::string& name) {
  constexpr std::string_view kUnseen = "-unseen";
  const auto digits_end = [&](std::size_t from) { return name.find_first_not_of("0123456789", from); };
  const std::size_t dash = digits_end(0);
  if (dash == 0 || dash == std::string::npos || name[dash] != '-') return false;
  const std::size_t end = digits_end(dash + 1);
  if (end == dash + 1 || end == std::string::npos) return false;
  const std::size_t dot = name.compare(end, kUnseen.size(), kUnseen) == 0 ? end + kUnseen.size() : end;
  return dot < name.size() && name[dot] == '.';
}

namespace {

/// Station and attempt at the start of a scan's name.
using Attempted = std::pair<std::int64_t, std::int64_t>;
Attempted attempted(const std::string& name) {
  Attempted of = {0, 0};
  const char* end = name.data() + name.size();
  const auto [dash, fault] = std::from_chars(name.data(), end, of.first);
  if (fault != std::errc{} || dash == end || std::from_chars(dash + 1, end, of.second).ec != std::errc{}) return {0, 0};
  return of;
}

}  // namespace

Spool::Spool(Connection& db, std::string spool_dir, std::uint64_t budget_bytes)
    : db_(db),
      spool_dir_(without_end_slash(std::move(spool_dir))),
      first_path_(spool_dir_ + '/'),
      end_path_(spool_dir_ + static_cast<char>('/' + 1)),
      budget_bytes_(budget_bytes),
      kept_bytes_(db, "SELECT coalesce(sum(scan_bytes), 0) FROM attempt WHERE scan_state = 'kept'"),
      kept_here_bytes_(db,
                       "SELECT coalesce(sum(scan_bytes), 0) FROM attempt "
                       "WHERE scan_state = 'kept' AND scan_path >= ?1 AND scan_path < ?2"),
      next_slab_(db,
                 "SELECT slab_result.slab_key FROM "
                 "(SELECT DISTINCT slab_key FROM attempt "
                 "WHERE scan_state = 'kept' AND scan_path >= ?1 AND scan_path < ?2) AS kept "
                 "JOIN slab_result ON slab_result.slab_key = kept.slab_key "
                 "WHERE NOT EXISTS (SELECT 1 FROM result WHERE result.slab_key = kept.slab_key AND acknowledged = 0) "
                 "ORDER BY verdict <> 'pass', slab_result.slab_key"),
      mark_deleting_(db,
                     "UPDATE attempt SET scan_state = 'deleting' "
                     "WHERE slab_key = ?3 AND scan_state = 'kept' AND scan_path >= ?1 AND scan_path < ?2"),
      deleting_(db, "SELECT slab_key, station, attempt, scan_path FROM attempt WHERE scan_state = 'deleting'"),
      release_(db,
               "UPDATE attempt SET scan_state = 'kept' "
               "WHERE slab_key = ?1 AND station = ?2 AND attempt = ?3"),
      mark_deleted_(db,
                    "UPDATE attempt SET scan_state = 'deleted' WHERE slab_key = ?1 AND station = ?2 AND attempt = ?3"),
      newest_slab_(
          db, "SELECT slab_key, began_utime_us, (SELECT keys_used FROM line) FROM slab ORDER BY slab_key DESC LIMIT 1"),
      scan_paths_(db, "SELECT scan_path, station, attempt FROM attempt WHERE slab_key = ?1") {}

Statement& Spool::below(Statement& statement) const {
  return statement.bind(1, std::string_view(first_path_)).bind(2, std::string_view(end_path_));
}

Status Spool::trim(bool& more) {
  more = false;
  const Status stuck = finish_deleting();
  const auto within_budget = [&](Statement& kept_bytes) {
    const bool within = !kept_bytes.step() || static_cast<std::uint64_t>(kept_bytes.integer(0)) <= budget_bytes_;
    kept_bytes.reset();
    return within;
  };
  if (within_budget(kept_bytes_) || within_budget(below(kept_here_bytes_))) return stuck;
  std::int64_t slab_key = 0;
  below(next_slab_);
  while (slab_key == 0 && next_slab_.step())
    if (!is_pinned(next_slab_.integer(0))) slab_key = next_slab_.integer(0);
  next_slab_.reset();
  if (slab_key == 0) return stuck;
  {
    Transaction transaction(db_, "BEGIN IMMEDIATE");
    below(mark_deleting_).bind(3, slab_key).run();
    transaction.commit();
  }
  more = true;
  return finish_deleting();
}

bool Spool::is_pinned(std::int64_t slab_key) const {
  // If the check fails, the slab counts as pinned, because a deletion cannot be undone.
  struct stat there {};
  const std::string pin = spool_dir_ + "/" + std::to_string(slab_key) + "/" + kPinName;
  return lstat(pin.c_str(), &there) == 0 || (errno != ENOENT && errno != ENOTDIR);
}

Status Spool::finish_deleting() {
  struct Scan {
    std::int64_t slab_key;
    std::int64_t station;
    std::int64_t attempt;
    std::string path;
  };
  std::vector<Scan> scans;
  while (deleting_.step())
    scans.push_back({deleting_.integer(0), deleting_.integer(1), deleting_.integer(2), std::string(deleting_.text(3))});
  if (scans.empty()) return success();

  Status status = success();
  std::set<std::string> folders;
  Transaction transaction(db_, "BEGIN IMMEDIATE");
  for (const Scan& scan : scans) {
    // If the spool's path has changed, the file is not in the current spool and is kept. If the slab was pinned
    // meanwhile (while slabd was stopped, or a file could not be deleted), its remaining scans are kept.
    const bool ours = lies_below(scan.path, spool_dir_);
    if (!ours || (is_there(scan.path) && is_pinned(scan.slab_key))) {
      release_.bind(1, scan.slab_key).bind(2, scan.station).bind(3, scan.attempt).run();
      continue;
    }
    if (unlink(scan.path.c_str()) != 0 && errno != ENOENT) {
      status = error(Code::journal_write, "scan %s cannot be deleted: %s", scan.path.c_str(), std::strerror(errno));
      continue;
    }
    folders.insert(std::filesystem::path(scan.path).parent_path().string());
    mark_deleted_.bind(1, scan.slab_key).bind(2, scan.station).bind(3, scan.attempt).run();
  }
  transaction.commit();
  // Deletes a slab's folder after its last scan; a folder that is not empty stays.
  for (const std::string& folder : folders)
    if (lies_below(folder, spool_dir_)) rmdir(folder.c_str());
  return status;
}

Status Spool::drop_orphans() {
  if (!newest_slab_.step()) return success();
  const std::int64_t slab_key = newest_slab_.integer(0);
  const std::int64_t began_utime_us = newest_slab_.integer(1);
  // After a restore the slab's record is from the time of the backup; later scans are evidence and are kept.
  const bool may_be_a_lost_ones = slab_key <= newest_slab_.integer(2);
  newest_slab_.reset();
  if (may_be_a_lost_ones || is_pinned(slab_key)) return success();
  // Compares names, not paths: the spool may have had another path when the scan was recorded.
  std::set<std::string> recorded;
  std::set<Attempted> attempts;
  scan_paths_.bind(1, slab_key);
  while (scan_paths_.step()) {
    recorded.insert(std::filesystem::path(scan_paths_.text(0)).filename().string());
    attempts.insert({scan_paths_.integer(1), scan_paths_.integer(2)});
  }

  const std::string folder = spool_dir_ + "/" + std::to_string(slab_key);
  std::error_code ec;
  if (!std::filesystem::is_directory(std::filesystem::symlink_status(folder, ec))) return success();
  Status status = success();
  int unknown = 0;
  for (std::filesystem::directory_iterator entry(folder, ec), end; !ec && entry != end; entry.increment(ec)) {
    const std::string name = entry->path().filename().string();
    const std::string path = folder + "/" + name;
    if (!is_scan_name(name) || recorded.contains(name) || !came_after(path, began_utime_us)) continue;
    // At this point a scan in progress has its attempt. A scan of an attempt unknown to this database is from a newer
    // database.
    if (!name.ends_with(".part") && !attempts.contains(attempted(name))) {
      ++unknown;
      continue;
    }
    if (unlink(path.c_str()) != 0 && errno != ENOENT)
      status = error(Code::journal_write, "scan %s, which no record names, cannot be deleted: %s", path.c_str(),
                     std::strerror(errno));
  }
  if (unknown > 0 && status.ok())
    status = error(Code::journal_write,
                   "%s holds %d scans of attempts that are not in this database: was it replaced by an older one while "
                   "that slab was measured? They are kept",
                   folder.c_str(), unknown);
  return status;
}

}  // namespace slabd::storage
