// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "tests/sim/process.h"

/// The disk under the database: SQLite's own file layer on a folder in memory, with a layer of ours above it that knows
/// what has been synced (and what the files hold: reading asks no kernel). It can fail as disks do, lose or tear at a
/// loss of power what was not synced, and end the process in the middle of any write.
///
/// After a failed sync what was written stays readable and is never written again, as Linux does it: a later sync that
/// succeeds says nothing about it.
namespace slabd::sim {

class Disk {
 public:
  /// Registers the layer as SQLite's default once; at most one Disk at a time.
  explicit Disk(World& world);
  ~Disk();
  Disk(const Disk&) = delete;
  Disk& operator=(const Disk&) = delete;

  /// Whose calls are to be believed; nullptr: nobody's.
  void serve(Process* process) { process_ = process; }
  /// The process dies at its `count`-th call that changes a file, a write being torn when `torn`.
  void kill_at(std::int64_t count, bool torn) {
    kill_in_ = count;
    kill_torn_ = torn;
  }
  /// What was not synced is lost, kept or torn, sector by sector. Only when no process runs.
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
  /// A run of sectors that was written, and how it was before.
  struct Run {
    std::int64_t sector = 0;
    std::int64_t count = 0;
    std::size_t old_at = 0;     ///< in `old`
    std::size_t old_bytes = 0;  ///< fewer than the run: the rest did not exist
  };
  struct File {
    std::vector<Run> runs;  ///< since the last sync, in order
    std::vector<unsigned char> old;
    std::map<std::int64_t, OldSector> unsynced;  ///< the same by sector, as soon as something goes wrong
    std::int64_t synced_bytes = 0;
    std::weak_ptr<std::vector<unsigned char>> content;  ///< as in the folder, for whoever has it open
    /// Puts the runs into `unsynced`.
    void fold(bool doomed);
  };
  enum class Call : std::uint8_t { read, write, truncate, sync, remove, open };
  /// SQLITE_OK: go on. Otherwise the call fails with it. `tear` becomes true when half of the write is to be done
  /// first.
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
