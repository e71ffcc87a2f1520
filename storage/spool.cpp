// SPDX-License-Identifier: Apache-2.0
#include "storage/spool.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <set>
#include <vector>

#include "storage/folders.h"

namespace slabd::storage {
namespace {

/// "04-2.ply": station and attempt, as the daemon names its scans; "04-2-unseen.ply": one that is thrown away. Anything
/// else in the spool is somebody else's.
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

/// A regular file that got its name here at `utime_us` or later: a rename sets the time of change, and keeps the
/// others. A spool that outlived its database holds older files under the same slab keys; those are not ours to judge.
bool came_after(const std::string& path, std::int64_t utime_us) {
  struct stat there {};
  if (lstat(path.c_str(), &there) != 0 || !S_ISREG(there.st_mode)) return false;
  return there.st_ctim.tv_sec * std::int64_t{1'000'000} + there.st_ctim.tv_nsec / 1000 >= utime_us;
}

}  // namespace

Spool::Spool(Connection& db, std::string spool_dir, std::uint64_t budget_bytes)
    : db_(db),
      spool_dir_(std::move(spool_dir)),
      budget_bytes_(budget_bytes),
      kept_bytes_(db, "SELECT coalesce(sum(scan_bytes), 0) FROM attempt WHERE scan_state = 'kept'"),
      next_slab_(db,
                 "SELECT slab_result.slab_key FROM "
                 "(SELECT DISTINCT slab_key FROM attempt WHERE scan_state = 'kept') AS kept "
                 "JOIN slab_result ON slab_result.slab_key = kept.slab_key "
                 "WHERE NOT EXISTS (SELECT 1 FROM result WHERE result.slab_key = kept.slab_key AND acknowledged = 0) "
                 "ORDER BY verdict <> 'pass', slab_result.slab_key"),
      mark_deleting_(db, "UPDATE attempt SET scan_state = 'deleting' WHERE slab_key = ?1 AND scan_state = 'kept'"),
      deleting_(db, "SELECT slab_key, station, attempt, scan_path FROM attempt WHERE scan_state = 'deleting'"),
      mark_deleted_(db,
                    "UPDATE attempt SET scan_state = 'deleted' WHERE slab_key = ?1 AND station = ?2 AND attempt = ?3"),
      newest_slab_(db, "SELECT slab_key, began_utime_us FROM slab ORDER BY slab_key DESC LIMIT 1"),
      scan_paths_(db, "SELECT scan_path FROM attempt WHERE slab_key = ?1") {}

Status Spool::trim() {
  if (Status status = finish_deleting(); !status.ok()) return status;
  std::uint64_t kept = 0;
  if (kept_bytes_.step()) kept = static_cast<std::uint64_t>(kept_bytes_.integer(0));
  kept_bytes_.reset();
  if (kept <= budget_bytes_) return success();
  std::int64_t slab_key = 0;
  while (slab_key == 0 && next_slab_.step())
    if (!is_pinned(next_slab_.integer(0))) slab_key = next_slab_.integer(0);
  next_slab_.reset();
  if (slab_key == 0) return success();
  {
    Transaction transaction(db_, "BEGIN IMMEDIATE");
    mark_deleting_.bind(1, slab_key).run();
    transaction.commit();
  }
  return finish_deleting();
}

bool Spool::is_pinned(std::int64_t slab_key) const {
  // Whatever cannot be looked at counts as pinned: deleting is what cannot be undone.
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
    if (!lies_below(scan.path, spool_dir_)) {
      status = error(Code::journal_write, "scan %s is not deleted: it does not lie below the spool %s",
                     scan.path.c_str(), spool_dir_.c_str());
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
  // A slab's folder goes with its last scan; one that still holds something stays.
  for (const std::string& folder : folders)
    if (lies_below(folder, spool_dir_)) rmdir(folder.c_str());
  return status;
}

Status Spool::drop_orphans() {
  if (!newest_slab_.step()) return success();
  const std::int64_t slab_key = newest_slab_.integer(0);
  const std::int64_t began_utime_us = newest_slab_.integer(1);
  newest_slab_.reset();
  // Names, not whole paths: the spool may be known by another path today than when the scan was recorded.
  std::set<std::string> recorded;
  scan_paths_.bind(1, slab_key);
  while (scan_paths_.step()) recorded.insert(std::filesystem::path(scan_paths_.text(0)).filename().string());

  const std::string folder = spool_dir_ + "/" + std::to_string(slab_key);
  std::error_code ec;
  if (!std::filesystem::is_directory(std::filesystem::symlink_status(folder, ec))) return success();
  Status status = success();
  for (std::filesystem::directory_iterator entry(folder, ec), end; !ec && entry != end; entry.increment(ec)) {
    const std::string name = entry->path().filename().string();
    const std::string path = folder + "/" + name;
    if (!is_scan_name(name) || recorded.contains(name) || !came_after(path, began_utime_us)) continue;
    if (unlink(path.c_str()) != 0 && errno != ENOENT)
      status = error(Code::journal_write, "scan %s, which no record names, cannot be deleted: %s", path.c_str(),
                     std::strerror(errno));
  }
  return status;
}

}  // namespace slabd::storage
