// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <functional>
#include <optional>
#include <string_view>

#include "base/base.h"
#include "base/os.h"
#include "hal/hal.h"

/// The three folders of a drop directory. request/ holds slabd's requests to the scanner software, inbox/ the
/// software's answers. stray/ holds all other files found in inbox/. Folders are held by descriptor, so a name is used
/// in the folder in which it was read; links below drop_dir are never followed. No heap.
namespace slabd::hal {

/// Longest file name of Linux file systems.
using NameText = FixedString<255>;

/// An entry of the inbox. Two samples of it are equal if the file was not changed between them.
struct InboxEntry {
  NameText name;
  bool regular = false;
  FileState state;

  [[nodiscard]] bool same_content(const InboxEntry& other) const { return state.same_content(other.state); }
};

/// Entries listed together. Normally the inbox holds one; in a flood the others are listed after these are gone.
inline constexpr std::size_t kInboxEntriesMax = 32;
using InboxEntries = FixedVector<InboxEntry, kInboxEntriesMax>;

class DropFolders {
 public:
  /// `owner`: see ScanDropSettings.
  explicit DropFolders(const PathText& drop_dir, const LockOwner& owner = {})
      : drop_dir_(drop_dir), is_locked_(!owner.empty()), lock_(owner) {}

  /// Opens the folders again, makes those below drop_dir that are missing, and checks that only this process uses them.
  /// scanner_offline: the text names the folder and the reason.
  [[nodiscard]] Status open();
  /// Result of the last open(); `ours` also if folders are not locked.
  [[nodiscard]] FolderLock::State lock_state() const { return lock_state_; }
  /// Text for a lock that is `cannot` or `anothers`.
  [[nodiscard]] const ScannerText& lock_text() const { return lock_.text(); }

  /// Makes drop_dir if its parent exists. Errors are reported by open().
  void make_drop_dir() const;

  /// Set by open(): another computer may write there, and the kernel's cache of the files may be seconds old.
  [[nodiscard]] bool on_network() const { return on_network_; }

  /// Lists the inbox. Entries whose name begins with `first` (if not empty) are listed before all others, so that a
  /// flood cannot hide an answer. scanner_offline if the folder cannot be read.
  [[nodiscard]] Status list_inbox(std::string_view first, InboxEntries& entries);
  /// True if the inbox held more entries than the last list_inbox() returned.
  [[nodiscard]] bool is_crowded() const { return is_crowded_; }
  /// Calls `use(name)` for each entry of the inbox until it returns false. `use` may move entries away.
  void for_each_in_inbox(const std::function<bool(const char*)>& use) const;
  /// Time of the file system's own clock, for comparison with FileState.status_ns; nullopt if it cannot be read.
  [[nodiscard]] std::optional<std::int64_t> time_ns() const;

  /// Moves an inbox entry to stray/ under its own name. If that name exists, a number is appended.
  [[nodiscard]] bool set_aside(const char* name);

  /// Limits of stray/: files, and folders with their contents.
  struct StrayLimits {
    std::uint64_t bytes = 0;
    std::size_t entries = 1'000;
  };
  struct Trimmed {
    bool deleted = false;
    NameText name;
    std::uint64_t bytes = 0;  ///< of the file, or of the folder's contents
    std::uint64_t held = 0;   ///< in stray/, before deletion
    int error_number = 0;     ///< reason why it could not be deleted
  };
  static constexpr std::size_t kTrimmedAtOnce = 64;
  using TrimmedOnes = FixedVector<Trimmed, kTrimmedAtOnce>;
  /// Deletes the oldest entries of stray/ while it exceeds the limits, at most kTrimmedAtOnce. Entries that cannot be
  /// deleted are reported and skipped. Examines a few thousand names, so that a flood collected over weeks blocks no
  /// thread; then the oldest of those are deleted. True if more must be deleted.
  [[nodiscard]] bool trim_stray(const StrayLimits& limits, TrimmedOnes& trimmed) const;

  /// Writes request/<name> by rename, so that no program reads a partial file.
  [[nodiscard]] Status post_request(const char* name, std::string_view text) const;
  void withdraw_request(const char* name) const;
  /// Withdraws a request and leaves a marker that its answer may still come, also for the next process.
  void leave_unanswered(const char* name) const;
  void forget_unanswered() const;
  /// Name of the marker; scanner software does not recognise it as a request.
  static constexpr const char* kUnanswered = ".unanswered";
  /// Withdraws the requests of a process that ended, and its marker: their answers are not expected. Returns their
  /// number.
  std::size_t withdraw_all_requests() const;

  [[nodiscard]] int inbox_fd() const { return inbox_.get(); }
  [[nodiscard]] const PathText& drop_dir() const { return drop_dir_; }

 private:
  PathText drop_dir_;
  bool on_network_ = false;
  bool is_crowded_ = false;
  bool is_locked_;
  FolderLock lock_;
  FolderLock::State lock_state_ = FolderLock::State::ours;
  Fd drop_;
  Fd request_;
  Fd inbox_;
  Fd stray_;
  int next_number_ = 1;  ///< appended to the next name that exists already
};

/// Time since which each inbox entry has not changed: the only sign of completion for a program without a naming rule.
/// Forgets names that disappear. No heap; O(entries^2) of at most 32.
class UnchangedTimes {
 public:
  struct Watched {
    InboxEntry entry;
    std::int64_t since_ns = 0;  ///< first seen in its present state
  };

  void look(std::int64_t now_ns, const InboxEntries& entries) {
    FixedVector<Watched, kInboxEntriesMax> present;
    for (const InboxEntry& entry : entries) {
      const Watched* before = find(entry.name.view());
      const bool unchanged = before != nullptr && before->entry.same_content(entry);
      static_cast<void>(present.push({entry, unchanged ? before->since_ns : now_ns}));
    }
    watched_ = present;
  }
  [[nodiscard]] const FixedVector<Watched, kInboxEntriesMax>& watched() const { return watched_; }

 private:
  [[nodiscard]] const Watched* find(std::string_view name) const {
    for (const Watched& watched : watched_)
      if (watched.entry.name == name) return &watched;
    return nullptr;
  }

  FixedVector<Watched, kInboxEntriesMax> watched_;
};

}  // namespace slabd::hal
