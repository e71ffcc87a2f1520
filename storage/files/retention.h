// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "base/result.h"
#include "storage/files/sqlite.h"

namespace slabd::storage {

/// Takes the records of old slabs away, a slab at a time: some 500 rows in one transaction, so that a power cut leaves
/// a slab whole or gone and no job waits for long. Candidates have ended, every result of theirs was acknowledged, none
/// of their scans is kept, and at least kKeepSlabsMin newer slabs stay. Slabs that did not pass stay longer: people ask
/// for those. Both numbers are counts, so the database is bounded whatever the line makes. The line says how many went,
/// up to which key, and the chain of results gets an entry for each. Calibrations and seals stay for ever. The file
/// does not shrink; its free pages are used again.
class Retention {
 public:
  explicit Retention(Connection& db);
  /// Takes the oldest candidate away that is neither one of the newest `keep_slabs` nor one of the newest
  /// `keep_failed_slabs` (0: all) of those that did not pass; false: there is none. Throws SqlFailure.
  bool take_one(std::int64_t keep_slabs, std::int64_t keep_failed_slabs);

 private:
  /// Key of row `offset`, 0 when there are fewer.
  [[nodiscard]] static std::int64_t key_at(Statement& newest_first, std::int64_t offset);

  Connection& db_;
  Statement newest_;
  Statement newest_failed_;
  Statement candidate_;
  Statement drop_of_no_slab_;  ///< commands given between slabs: REPORT
  Statement note_;
};

/// "04-2.ply": station and attempt, as the daemon names its scans; "04-2-unseen.ply": one that is thrown away. Anything
/// else in the spool is somebody else's.
[[nodiscard]] bool is_scan_name(const std::string& name);

/// Keeps the spool within its budget by deleting scans, never records. Candidates are slabs that have ended and whose
/// every result the PLC has acknowledged: passed ones first, then the others, each by age. A slab at a time: each call
/// deletes the scans of at most one, so that a smaller budget does not stop the line for minutes.
///
/// First the rows say "deleting", then the files go, then the rows say "deleted": a crash between leaves either a file
/// that the next call deletes, or nothing.
class Spool {
 public:
  /// A file of this name beside a slab's scans keeps them, whatever the budget: slabctl pin puts it there, with a
  /// reason.
  static constexpr const char* kPinName = "pin.json";

  Spool(Connection& db, std::string spool_dir, std::uint64_t budget_bytes);

  /// `more`: a slab's scans went, and others may have to. Throws SqlFailure. journal_write: a file could not be
  /// deleted; its rows stay "deleting" and are tried again, and it does not keep the others from going. Scans that were
  /// recorded in another folder than today's spool neither count nor go; those of a slab that was pinned before the
  /// rest of them could go are kept again.
  [[nodiscard]] Status trim(bool& more);

  /// Deletes what a crash between spooling a scan and recording it left: files in the newest slab's folder that carry
  /// a scan's name, came there after that slab had begun, and are named by no attempt of it. Not where a lost database
  /// may have named them, and not of a pinned slab. Call it before the first scan after a start. Throws SqlFailure.
  /// journal_write: a file could not be deleted.
  [[nodiscard]] Status drop_orphans();

 private:
  [[nodiscard]] Status finish_deleting();
  [[nodiscard]] bool is_pinned(std::int64_t slab_key) const;
  /// For a statement on the paths of this spool: they lie from ?1 on and before ?2.
  Statement& below(Statement& statement) const;

  Connection& db_;
  std::string spool_dir_;
  std::string first_path_;
  std::string end_path_;
  std::uint64_t budget_bytes_;
  Statement kept_bytes_;       ///< of all folders: an index alone answers it
  Statement kept_here_bytes_;  ///< of this spool
  Statement next_slab_;
  Statement mark_deleting_;
  Statement deleting_;
  Statement release_;  ///< not to be deleted after all
  Statement mark_deleted_;
  Statement newest_slab_;
  Statement scan_paths_;
};

}  // namespace slabd::storage
