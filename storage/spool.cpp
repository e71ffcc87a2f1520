// SPDX-License-Identifier: Apache-2.0
#include "storage/spool.h"

#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <set>
#include <vector>

#include "storage/folders.h"

namespace slabd::storage {

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
                 "ORDER BY verdict <> 'pass', slab_result.slab_key LIMIT 1"),
      mark_deleting_(db, "UPDATE attempt SET scan_state = 'deleting' WHERE slab_key = ?1 AND scan_state = 'kept'"),
      deleting_(db, "SELECT slab_key, station, attempt, scan_path FROM attempt WHERE scan_state = 'deleting'"),
      mark_deleted_(
          db, "UPDATE attempt SET scan_state = 'deleted' WHERE slab_key = ?1 AND station = ?2 AND attempt = ?3") {}

Status Spool::trim() {
  if (Status status = finish_deleting(); !status.ok()) return status;
  std::uint64_t kept = 0;
  if (kept_bytes_.step()) kept = static_cast<std::uint64_t>(kept_bytes_.integer(0));
  kept_bytes_.reset();
  if (kept <= budget_bytes_ || !next_slab_.step()) return success();
  const std::int64_t slab_key = next_slab_.integer(0);
  next_slab_.reset();
  {
    Transaction transaction(db_, "BEGIN IMMEDIATE");
    mark_deleting_.bind(1, slab_key).run();
    transaction.commit();
  }
  return finish_deleting();
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

}  // namespace slabd::storage
