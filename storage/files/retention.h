// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "base/result.h"
#include "storage/files/sqlite.h"

namespace slabd::storage {

/// Deletes the records of old slabs, one slab at a time. A transaction deletes about 500 rows of one slab, so that a
/// power cut never leaves part of a slab and jobs do not wait long. Candidates have ended, all their results were
/// acknowledged, their scans are deleted, and at least kKeepSlabsMin newer slabs remain. Slabs that did not pass are
/// kept longer, because they are requested more often. Both limits are counts, so the size of the database is bounded.
/// Table line stores the number of deleted slabs and the newest key, and the chain of results gets an entry for each.
/// Calibrations and seals are kept permanently. The file does not shrink; its free pages are reused.
class Retention {
 public:
  /// `keep_unsent`: a slab is also kept until the plant's database has all documents about it.
  Retention(Connection& db, bool keep_unsent);
  /// Deletes the oldest candidate that is neither one of the newest `keep_slabs` slabs nor one of the newest
  /// `keep_failed_slabs` (0: all) that did not pass. Returns false if there is none. Throws SqlFailure.
  bool take_one(std::int64_t keep_slabs, std::int64_t keep_failed_slabs);

 private:
  /// Key of row `offset`; 0 if there are fewer rows.
  [[nodiscard]] static std::int64_t key_at(Statement& newest_first, std::int64_t offset);

  Connection& db_;
  Statement newest_;
  Statement newest_failed_;
  Statement candidate_;
  Statement drop_of_no_slab_;  ///< commands outside slabs: REPORT
  Statement note_;
};

/// True for "04-2.ply" (station and attempt, the daemon's name of a scan) and "04-2-unseen.ply" (a discarded scan).
/// Other files in the spool do not belong to slabd.
[[nodiscard]] bool is_scan_name(const std::string& name);

/// Keeps the spool within its budget by deleting scans, never records. Candidates are ended slabs whose results were
/// all acknowledged by the PLC: passed ones first, then the others, each by age. Each call deletes the scans of at most
/// one slab, so that a reduced budget does not stop the line for minutes.
///
/// The rows are set to "deleting" first, then the files are deleted, then the rows are set to "deleted". A crash in
/// between leaves at most a file that the next call deletes.
class Spool {
 public:
  /// A file with this name next to a slab's scans protects them from the budget; slabctl pin creates it, with a reason.
  static constexpr const char* kPinName = "pin.json";

  Spool(Connection& db, std::string spool_dir, std::uint64_t budget_bytes);

  /// Deletes the scans of one slab if the spool exceeds its budget. `more`: scans were deleted, and others may have to
  /// be. Throws SqlFailure. journal_write: a file could not be deleted. Its rows stay "deleting" for another attempt,
  /// and it does not block the others. Scans recorded in another folder than the current spool are neither counted nor
  /// deleted. If a slab was pinned before all its scans were deleted, the rest is kept again.
  [[nodiscard]] Status trim(bool& more);

  /// Deletes files left by a crash between spooling a scan and recording it. These are files in the newest slab's
  /// folder that have a scan's name, are newer than the slab's begin, and belong to no attempt. Skips pinned slabs, and
  /// slabs whose records a lost database may contain. Call it before the first scan after a start. Throws SqlFailure.
  /// journal_write: a file could not be deleted.
  [[nodiscard]] Status drop_orphans();

 private:
  [[nodiscard]] Status finish_deleting();
  [[nodiscard]] bool is_pinned(std::int64_t slab_key) const;
  /// Binds ?1 and ?2 to the range of paths of this spool.
  Statement& below(Statement& statement) const;

  Connection& db_;
  std::string spool_dir_;
  std::string first_path_;
  std::string end_path_;
  std::uint64_t budget_bytes_;
  Statement kept_bytes_;       ///< all folders; answered from an index alone
  Statement kept_here_bytes_;  ///< this spool
  Statement next_slab_;
  Statement mark_deleting_;
  Statement deleting_;
  Statement release_;  ///< marks a scan as kept again
  Statement mark_deleted_;
  Statement newest_slab_;
  Statement scan_paths_;
};

}  // namespace slabd::storage
