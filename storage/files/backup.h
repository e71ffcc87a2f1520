// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "base/os.h"
#include "storage/files/file_checksum.h"
#include "storage/files/sqlite.h"

struct sqlite3_backup;

namespace slabd::storage {

/// A backup in progress. It uses the writing connection, so that concurrent commits are included and no second process
/// has to checkpoint. It is copied in pieces, each synced, and then read again in pieces for its checksum
/// (storage/files/file_checksum.h). The copy gets its final name only when it is complete. All members throw
/// SqlFailure.
class Backup {
 public:
  enum class Kind : std::uint8_t {
    backup,      ///< with a checksum
    in_the_work  ///< without a checksum, because the copy will be modified
  };
  /// Fails if `to` exists, or if the disk lacks space for the copy, the records of a day and `leave_bytes`.
  /// `leave_bytes` is the space required to begin a slab.
  Backup(Connection& from, std::string to, std::uint64_t leave_bytes, Kind kind = Kind::backup);
  /// Deletes an incomplete copy.
  ~Backup();
  Backup(const Backup&) = delete;
  Backup& operator=(const Backup&) = delete;

  /// Copies or reads up to `pages`, or all remaining ones if -1. Returns true if the copy is complete, synced and
  /// renamed.
  bool step(int pages);
  [[nodiscard]] std::int64_t pages_all() const { return pages_all_; }
  /// Pages copied, and then, counted again from 0, pages read for the checksum.
  [[nodiscard]] std::int64_t pages_done() const { return pages_done_; }

 private:
  /// Lock on the partial file, checked by remove_cut_short_backups(). SQLite's own locks are of another kind.
  class WorkLock {
   public:
    void take(const std::string& path);

   private:
    Fd fd_;
  };

  void begin(Connection& from);
  void finish_copy();
  void name_it();
  void end();

  std::string to_;
  std::string part_;
  WorkLock lock_;
  std::unique_ptr<Connection> copy_;
  sqlite3_backup* backup_ = nullptr;
  std::unique_ptr<ChecksumWriter> checksum_;  ///< checksum in progress
  Kind kind_;
  std::int64_t page_bytes_ = 0;
  bool has_its_name_ = false;
  std::int64_t pages_all_ = 0;
  std::int64_t pages_done_ = 0;
};

/// Deletes incomplete copies left by a crash in the backup folder, but not one that another process is writing.
void remove_cut_short_backups(const std::string& db_path);

}  // namespace slabd::storage
