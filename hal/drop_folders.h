// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <string_view>

#include "base/base.h"
#include "hal/os.h"

/// The three folders of a drop directory. request/: what slabd asks the scanner software for. inbox/: what that
/// software answers. stray/: whatever else was found in inbox/. Folders are held by descriptor, so a name read there
/// is a name used there; links are never followed below drop_dir. No heap.
namespace slabd::hal {

/// Longest file name of Linux file systems.
using NameText = FixedString<255>;

/// Something in the inbox. Two looks at it are the same when the file has not been touched between them.
struct InboxEntry {
  NameText name;
  bool regular = false;
  dev_t device = 0;
  ino_t inode = 0;
  std::int64_t bytes = 0;
  std::int64_t changed_ns = 0;  ///< mtime

  [[nodiscard]] bool same_content(const InboxEntry& other) const {
    return device == other.device && inode == other.inode && bytes == other.bytes && changed_ns == other.changed_ns;
  }
};

/// Entries looked at together. An orderly inbox holds one; of a flood the rest is looked at once these are gone.
inline constexpr std::size_t kInboxEntriesMax = 32;
using InboxEntries = FixedVector<InboxEntry, kInboxEntriesMax>;

class DropFolders {
 public:
  explicit DropFolders(const PathText& drop_dir) : drop_dir_(drop_dir) {}

  /// Opens the folders anew, making those that are missing, and checks that they can be used. scanner_offline: the
  /// text names the folder and why.
  [[nodiscard]] Status open();

  /// What lies in the inbox. Entries whose name begins with `first` (when not empty) are listed before all others, so
  /// that a flood cannot hide an answer. scanner_offline when the folder cannot be read.
  [[nodiscard]] Status list_inbox(std::string_view first, InboxEntries& entries) const;

  /// Moves an inbox entry to stray/ under its own name or, when that is taken, with a number behind it.
  [[nodiscard]] bool set_aside(const char* name) const;

  /// Deletes the files that were moved to stray/ first until it holds at most `bytes_max`; folders there are left
  /// alone. False: there is more to delete than one call does. O(files * files deleted).
  [[nodiscard]] bool trim_stray(std::uint64_t bytes_max) const;

  /// Puts request/<name> in place by rename, so that nobody reads half of it.
  [[nodiscard]] Status post_request(const char* name, std::string_view text) const;
  void withdraw_request(const char* name) const;
  /// Requests of a process that died: nobody waits for their answers. How many there were.
  std::size_t withdraw_all_requests() const;

  [[nodiscard]] int inbox_fd() const { return inbox_.get(); }
  [[nodiscard]] const PathText& drop_dir() const { return drop_dir_; }

 private:
  PathText drop_dir_;
  Fd drop_;
  Fd request_;
  Fd inbox_;
  Fd stray_;
};

}  // namespace slabd::hal
