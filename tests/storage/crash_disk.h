// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "base/prng.h"

/// A disk that simulates power cuts. While a folder is watched, every system call of this process that changes it is
/// executed and recorded. The calls of SQLite and slabd are replaced by name. From this list it generates possible disk
/// contents after a power cut at any moment: all synced data, and any part of the rest.
///
/// The same hooks can make the n-th call fail, or kill the process there.
namespace slabd::storage {

struct DiskChange {
  enum class Kind : std::uint8_t { create, write, resize, sync, sync_folder, unlink, rename, link, make_folder, mark };
  Kind kind = Kind::mark;
  int file = -1;            ///< for create, write, resize, sync, link
  std::int64_t offset = 0;  ///< for write; for resize the new size
  std::string bytes;        ///< for write
  std::string path;         ///< for all changes of a name
  std::string other;        ///< for rename: the new name
};

/// Folders, and files by their path below the watched folder.
struct DiskImage {
  std::map<std::string, std::string> files;
  std::set<std::string> folders;
  void write_to(const std::string& root) const;
  [[nodiscard]] static DiskImage read_from(const std::string& root);
};

struct DiskLog {
  DiskImage base;  ///< durable content when the watch began
  std::vector<DiskChange> changes;
  [[nodiscard]] std::size_t marks_before(std::size_t end) const;
};

/// Guarantees of a file system for names.
enum class NameModel : std::uint8_t {
  ordered,  ///< A: any sync makes all earlier changes of names durable, in order (ext4, XFS)
  strict,   ///< B: a change of a name is durable only after a sync of its own folder (POSIX)
};

/// Returns a possible content after a power cut following `end` changes. Unsynced bytes: each sector of 512 bytes is
/// independently new, old, or (rarely) neither. A file that grew may have its length without its content.
[[nodiscard]] DiskImage image_after(const DiskLog& log, std::size_t end, NameModel model, Prng& prng);
/// Content with all changes up to `end`: the state after a kill.
[[nodiscard]] DiskImage image_of_all(const DiskLog& log, std::size_t end);

namespace crash_disk {

/// Starts recording below `root` (an absolute path without a slash at the end).
void watch(const std::string& root);
/// Records a mark: a step was reported as done.
void mark();
/// Ends the watch.
[[nodiscard]] DiskLog stop();

/// Makes calls below `root` fail with `error_number`: the `first`-th call (from 1) and the `count - 1` after it.
/// `with_reads`: reading calls count too.
void fail(const std::string& root, std::uint64_t first, std::uint64_t count, int error_number, bool with_reads);
/// Kills the process by SIGKILL in place of the `first`-th call.
void kill_at(const std::string& root, std::uint64_t first);
/// A `count` for fail(): all calls until heal().
inline constexpr std::uint64_t kAllThatFollow = 1'000'000'000;
/// Simulates a full disk: existing bytes may be overwritten, but nothing can grow.
void fill(const std::string& root);
/// Ends all faults and returns the number of calls counted.
std::uint64_t heal();
/// True if the fault has occurred.
[[nodiscard]] bool has_hit();

}  // namespace crash_disk
}  // namespace slabd::storage
