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
  FileState state;

  [[nodiscard]] bool same_content(const InboxEntry& other) const { return state.same_content(other.state); }
};

/// Entries looked at together. An orderly inbox holds one; of a flood the rest is looked at once these are gone.
inline constexpr std::size_t kInboxEntriesMax = 32;
using InboxEntries = FixedVector<InboxEntry, kInboxEntriesMax>;

class DropFolders {
 public:
  /// `owner`: see ScanDropSettings.
  explicit DropFolders(const PathText& drop_dir, const LockOwner& owner = {})
      : drop_dir_(drop_dir), is_locked_(!owner.empty()), lock_(owner) {}

  /// Opens the folders anew, making those below drop_dir that are missing, and checks that they can be used, by this
  /// process alone. scanner_offline: the text names the folder and why.
  [[nodiscard]] Status open();
  /// Of the last open(): ours also if folders are not locked.
  [[nodiscard]] FolderLock::State lock_state() const { return lock_state_; }
  /// Of a lock that is `cannot` or `anothers`.
  [[nodiscard]] const ScannerText& lock_text() const { return lock_.text(); }

  /// Makes drop_dir in a folder that is there. What goes wrong, open() says.
  void make_drop_dir() const;

  /// Of open(): another computer may write there, and what the kernel remembers of files may be seconds old.
  [[nodiscard]] bool on_network() const { return on_network_; }

  /// What lies in the inbox. Entries whose name begins with `first` (when not empty) are listed before all others, so
  /// that a flood cannot hide an answer. scanner_offline when the folder cannot be read.
  [[nodiscard]] Status list_inbox(std::string_view first, InboxEntries& entries);
  /// More lay there at the last list_inbox() than it listed.
  [[nodiscard]] bool is_crowded() const { return is_crowded_; }
  /// Calls `use(name)` for everything in the inbox until it returns false. Entries may be moved away by `use`.
  void for_each_in_inbox(const std::function<bool(const char*)>& use) const;
  /// The file system's own time, to which FileState.status_ns is compared; nullopt if it cannot be had.
  [[nodiscard]] std::optional<std::int64_t> time_ns() const;

  /// Moves an inbox entry to stray/ under its own name or, when that is taken, with a number behind it.
  [[nodiscard]] bool set_aside(const char* name);

  /// What may lie in stray/: files, and folders with all that is in them.
  struct StrayLimits {
    std::uint64_t bytes = 0;
    std::size_t entries = 1'000;
  };
  struct Trimmed {
    bool deleted = false;
    NameText name;
    std::uint64_t bytes = 0;  ///< of the file, or of what the folder held
    std::uint64_t held = 0;   ///< in stray/, before
    int error_number = 0;     ///< why it could not be deleted
  };
  static constexpr std::size_t kTrimmedAtOnce = 64;
  using TrimmedOnes = FixedVector<Trimmed, kTrimmedAtOnce>;
  /// Deletes what was moved to stray/ first, as much as is too much there, up to kTrimmedAtOnce; those that could not
  /// be deleted are told and passed over. Looks at a few thousand names, so that a flood that was collected over weeks
  /// keeps nobody waiting: then of those the first. True: there is more to be deleted.
  [[nodiscard]] bool trim_stray(const StrayLimits& limits, TrimmedOnes& trimmed) const;

  /// Puts request/<name> in place by rename, so that nobody reads half of it.
  [[nodiscard]] Status post_request(const char* name, std::string_view text) const;
  void withdraw_request(const char* name) const;
  /// Takes a request back and leaves a word that its answer may still come, for the next process too.
  void leave_unanswered(const char* name) const;
  void forget_unanswered() const;
  /// The word's name: no scanner software takes it for a request.
  static constexpr const char* kUnanswered = ".unanswered";
  /// Requests of a process that ended, and its word: nobody waits for their answers. How many there were.
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
  int next_number_ = 1;  ///< behind the next name that is taken
};

/// Since when each inbox entry has not changed: the only sign of "finished" that a program without a naming rule
/// gives. Names that vanish are forgotten. No heap; O(entries^2) of at most 32.
class QuietWatch {
 public:
  struct Watched {
    InboxEntry entry;
    std::int64_t since_ns = 0;  ///< seen first in its present state
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
