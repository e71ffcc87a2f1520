// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "base/os.h"
#include "base/result.h"

/// Folders, free space, and the lock against a second writer. Plain POSIX without SQLite.
namespace slabd::storage {

/// Creates `path` and its parents, each durable on return. New folders get mode 2750: the group may read and is
/// inherited by new files. A folder created by root gets the owner of its parent.
[[nodiscard]] Status make_folder(const std::string& path);
/// Checks that files can be created in an existing folder: permissions, and a file system writable for this process.
[[nodiscard]] Status check_writable(const std::string& path);

/// Creates an empty file of mode 0640 unless it exists; its name is durable on return. SQLite gives its side files the
/// same mode and owner, so that the group can read while the daemon writes. An existing file is not opened, because
/// closing it would drop the POSIX locks of this process's connections to it.
[[nodiscard]] Status create_file(const std::string& path);

/// Removes write permissions of group and others from a file of this process's user; a file copied here may have them.
/// The file is neither modified nor opened.
void close_to_writers(const std::string& path);

/// Syncs a file or a folder. An empty path is the working folder.
[[nodiscard]] Status sync_file(const std::string& path);

/// Renames a file on the same disk and replaces an existing one. Not durable yet.
[[nodiscard]] Status rename_file(const std::string& from, const std::string& to);

/// Path of the same file without links in its folders, for SQLITE_OPEN_NOFOLLOW, which rejects all links. The last name
/// is unchanged.
[[nodiscard]] std::string in_real_folder(const std::string& path);

/// Bytes that a normal user may still write on the disk of `path`.
[[nodiscard]] Result<std::uint64_t> free_bytes(const std::string& path);

/// True if both folders use the same free space, or if that cannot be determined.
[[nodiscard]] bool share_a_disk(const std::string& folder, const std::string& other);

/// store_full, with the figures, unless `bytes` more can be written in `folder` (empty: the working folder). `what` is
/// the beginning of the sentence.
[[nodiscard]] Status check_room(const std::string& folder, std::uint64_t bytes, const char* what);

/// Size of a regular file; 0 if there is none (links are not followed).
[[nodiscard]] std::int64_t file_bytes(const std::string& path);

/// Identity of a file, independent of its name; changes if another file replaces it.
struct FileId {
  std::uint64_t device = 0;
  std::uint64_t inode = 0;
  bool operator==(const FileId&) const = default;
};
/// nullopt if it is not a regular file (links are not followed).
[[nodiscard]] std::optional<FileId> file_id(const std::string& path);

/// True if `path` is below `folder` and contains neither ".." nor ".".
[[nodiscard]] bool lies_below(const std::string& path, const std::string& folder);

/// Lock held while the database is open for writing; the kernel releases it when the process dies.
class WriterLock {
 public:
  /// Locks `db_path`.writer; journal_write if another process has it.
  [[nodiscard]] Status take(const std::string& db_path);

 private:
  Fd fd_;
};

// Name of the process that blocks the writer of a database. SQLite reports only "database is locked".

/// Queries the kernel for SQLite's locks (fcntl, on the database and on the index of its log). The two files are opened
/// once and stay open until the process ends, because closing them would drop all locks of this process on them. One
/// thread.
class LockProbe {
 public:
  /// "sqlite3 (process 1234)"; "process 1234" if its name may not be read; empty if no other process holds a lock that
  /// blocks a writer. The probe itself uses no heap.
  [[nodiscard]] std::string holder(const std::string& db_path);

 private:
  struct Probed {
    int fd = -1;
    std::optional<FileId> file;
  };
  /// Process that holds a lock on bytes `first`..`last`; 0 if none.
  [[nodiscard]] static std::int64_t owner_of(Probed& probed, const std::string& path, std::int64_t first,
                                             std::int64_t last);
  std::array<Probed, 2> probed_;  ///< database, index of its log
};

/// Name of a process, as returned by LockProbe: "sqlite3 (process 1234)".
[[nodiscard]] std::string process_words(std::int64_t pid);

}  // namespace slabd::storage
