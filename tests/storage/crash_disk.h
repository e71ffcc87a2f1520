// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "base/prng.h"

/// A disk whose power fails. While a folder is watched, every system call of this process that changes something below
/// it (SQLite's and our own: the calls are taken over by name) is carried out and written down. From the list, what the
/// disk may hold after a power cut at any moment is made: what was synced, and any part of what was not.
///
/// The same place makes calls fail, or kills the process, at the n-th call.
namespace slabd::storage {

struct DiskChange {
  enum class Kind : std::uint8_t { create, write, resize, sync, sync_folder, unlink, rename, link, make_folder, mark };
  Kind kind = Kind::mark;
  int file = -1;            ///< of create, write, resize, sync, link
  std::int64_t offset = 0;  ///< of write; the new size of resize
  std::string bytes;        ///< of write
  std::string path;         ///< of everything that is about a name
  std::string other;        ///< the new name of rename
};

/// Files by their path below the watched folder, and folders.
struct DiskImage {
  std::map<std::string, std::string> files;
  std::set<std::string> folders;
  void write_to(const std::string& root) const;
  [[nodiscard]] static DiskImage read_from(const std::string& root);
};

struct DiskLog {
  DiskImage base;  ///< durable when the watch began
  std::vector<DiskChange> changes;
  [[nodiscard]] std::size_t marks_before(std::size_t end) const;
};

/// What a file system promises about names.
enum class NameModel : std::uint8_t {
  ordered,  ///< A: any sync makes every earlier change of names durable, and they become so in order (ext4, XFS)
  strict,   ///< B: a change of a name is durable when its own folder was synced, and not before (POSIX)
};

/// One of the things that may be there when the power failed after `end` changes. Unsynced bytes: each sector of 512
/// alone is new, old, or (rarely) neither; a file that grew may have its length without its content.
[[nodiscard]] DiskImage image_after(const DiskLog& log, std::size_t end, NameModel model, Prng& prng);
/// Everything up to `end` done: what a killed process leaves.
[[nodiscard]] DiskImage image_of_all(const DiskLog& log, std::size_t end);

namespace crash_disk {

/// Begins to write down what happens below `root` (an absolute path without a slash at the end).
void watch(const std::string& root);
/// A point the log should know: something has been promised to somebody.
void mark();
/// Ends the watch.
[[nodiscard]] DiskLog stop();

/// Calls below `root` that a fault may hit, from 1 on, are counted; the `first`-th and the `count - 1` after it fail
/// with `error_number`. `with_reads`: reading calls count too.
void fail(const std::string& root, std::uint64_t first, std::uint64_t count, int error_number, bool with_reads);
/// The process dies by SIGKILL instead of making the `first`-th call.
void kill_at(const std::string& root, std::uint64_t first);
/// A `count` for fail(): until it is healed.
inline constexpr std::uint64_t kAllThatFollow = 1'000'000'000;
/// The disk is full from now on: what there is may be written over, and nothing grows.
void fill(const std::string& root);
/// No more faults. Returns how many calls were counted.
std::uint64_t heal();
/// Whether the fault has hit.
[[nodiscard]] bool has_hit();

}  // namespace crash_disk
}  // namespace slabd::storage
