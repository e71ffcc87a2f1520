// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "tests/sim/process.h"

/// The disk below the database: SQLite's own file layer on a folder in memory, below a layer that records what was
/// synced. It also caches the content of the files, so that reading needs no system calls. The disk can fail like real
/// disks. At a loss of power it can lose or tear unsynced data, and it can end the process during any write.
///
/// After a failed sync the written data stay readable and are never written again, as in Linux: a later successful sync
/// does not include them.
namespace slabd::sim {

class Disk {
 public:
  /// Registers the layer as SQLite's default once; at most one Disk at a time.
  explicit Disk(World& world);
  ~Disk();
  Disk(const Disk&) = delete;
  Disk& operator=(const Disk&) = delete;

  /// Process whose calls have an effect; nullptr: none.
  void serve(Process* process) { process_ = process; }
  /// The process dies at its `count`-th call that changes a file; if `torn`, that write is torn.
  void kill_at(std::int64_t count, bool torn) {
    kill_in_ = count;
    kill_torn_ = torn;
  }
  /// Unsynced data are lost, kept or torn, sector by sector. Only while no process runs.
  void lose_power();
  [[nodiscard]] std::uint64_t calls() const { return calls_; }
  [[nodiscard]] std::uint64_t free_bytes() const;

  // ---- for the layer ----
  static constexpr std::int64_t kSector = 512;
  struct OldSector {
    bool existed = false;
    bool doomed = false;  ///< its sync failed
    std::array<unsigned char, kSector> bytes{};
  };
  /// A range of sectors that was written, and its content before.
  struct Run {
    std::int64_t sector = 0;
    std::int64_t count = 0;
    std::size_t old_at = 0;     ///< in `old`
    std::size_t old_bytes = 0;  ///< less than the range: the rest did not exist
  };
  struct File {
    std::vector<Run> runs;  ///< since the last sync, in order
    std::vector<unsigned char> old;
    std::map<std::int64_t, OldSector> unsynced;  ///< the same by sector, filled once an error occurs
    std::int64_t synced_bytes = 0;
    std::weak_ptr<std::vector<unsigned char>> content;  ///< content of the file, shared by all that have it open
    /// Moves the runs into `unsynced`.
    void fold(bool doomed);
  };
  enum class Call : std::uint8_t { read, write, truncate, sync, remove, open };
  /// SQLITE_OK to continue; otherwise the call fails with this code. `tear` becomes true if half of the write must be
  /// done first.
  int allow(Call call, bool& tear);
  [[nodiscard]] bool believed() const { return process_ != nullptr && !process_->dead(); }
  File& file(const std::string& path) { return files_[path]; }
  void forget(const std::string& path) { files_.erase(path); }
  void renamed(const std::string& from, const std::string& to);
  void sync_takes_time();

 private:
  World& world_;
  Prng chance_;
  Process* process_ = nullptr;
  std::map<std::string, File> files_;
  std::int64_t kill_in_ = 0;
  bool kill_torn_ = false;
  std::uint64_t calls_ = 0;
};

}  // namespace slabd::sim
