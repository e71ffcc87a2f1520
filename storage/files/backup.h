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

/// A copy of a whole database under way. It is made over the connection that writes, so that what is committed
/// meanwhile goes into the copy as well and no second process ever has to checkpoint. Piece by piece, each synced; then
/// the copy is read again, piece by piece, for its checksum (storage/files/file_checksum.h). The copy has its name only
/// when it is whole. Everything throws SqlFailure.
class Backup {
 public:
  enum class Kind : std::uint8_t {
    backup,      ///< with a checksum
    in_the_work  ///< without: it will be written to
  };
  /// Fails when `to` exists, or when there is not the room for a copy, the records of a day and `leave_bytes`: what the
  /// line needs to begin a slab.
  Backup(Connection& from, std::string to, std::uint64_t leave_bytes, Kind kind = Kind::backup);
  /// A copy that is not whole is deleted.
  ~Backup();
  Backup(const Backup&) = delete;
  Backup& operator=(const Backup&) = delete;

  /// Copies or reads up to `pages`; -1: all that are left. True: the copy is whole, synced and has its name.
  bool step(int pages);
  [[nodiscard]] std::int64_t pages_all() const { return pages_all_; }
  [[nodiscard]] std::int64_t pages_done() const { return pages_done_; }

 private:
  /// On the part, for remove_cut_short_backups(): somebody is at work. SQLite's own locks are of another kind.
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
  std::unique_ptr<ChecksumWriter> checksum_;  ///< under way
  Kind kind_;
  std::int64_t page_bytes_ = 0;
  bool has_its_name_ = false;
  std::int64_t pages_all_ = 0;
  std::int64_t pages_done_ = 0;
};

/// Deletes what backups that a crash cut short have left in the folder of the backups; not what another process works
/// at just now.
void remove_cut_short_backups(const std::string& db_path);

}  // namespace slabd::storage
