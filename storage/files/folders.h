// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "base/os.h"
#include "base/result.h"

/// Folders, free space, and the lock that keeps a second writer away. Plain POSIX; no SQLite here.
namespace slabd::storage {

/// Makes `path` and its parents. Folders made here get mode 2750: the group may read and keeps its name on new files;
/// each is on the disk when this returns. What root makes belongs to the owner of the folder that it lies in.
[[nodiscard]] Status make_folder(const std::string& path);
/// Files can be made in an existing folder: rights, and a file system that this process may write to.
[[nodiscard]] Status check_writable(const std::string& path);

/// Creates an empty file of mode 0640 unless it exists. SQLite gives its side files the same mode and owner, so that
/// the group can read while the daemon writes. Its name is on the disk when this returns. An existing file is not even
/// opened: closing it again would drop the POSIX locks of a connection this process may have on it.
[[nodiscard]] Status create_file(const std::string& path);

/// Takes away what group and others may do beyond reading, from a file of this process's user: one that was copied here
/// may have let them write. Its content is not touched and it is not opened.
void close_to_writers(const std::string& path);

/// What was written to this file or folder is on the disk when it returns. An empty path is the working folder.
[[nodiscard]] Status sync_file(const std::string& path);

/// Gives a file another name on the same disk, and takes that from what has it. Not yet on the disk.
[[nodiscard]] Status rename_file(const std::string& from, const std::string& to);

/// The same file by a path without links in its folders, for SQLITE_OPEN_NOFOLLOW, which refuses a link anywhere. The
/// last name stays as it is.
[[nodiscard]] std::string in_real_folder(const std::string& path);

/// Bytes a normal user may still write on the disk that holds `path`.
[[nodiscard]] Result<std::uint64_t> free_bytes(const std::string& path);

/// Whether what is written below one folder is missing below the other. True where nobody can tell.
[[nodiscard]] bool share_a_disk(const std::string& folder, const std::string& other);

/// store_full, with the figures, unless `bytes` more may be written in `folder`. An empty folder is the working folder.
/// `what` needs them: the beginning of a sentence.
[[nodiscard]] Status check_room(const std::string& folder, std::uint64_t bytes, const char* what);

/// Size of a regular file, 0 when there is none (links are not followed).
[[nodiscard]] std::int64_t file_bytes(const std::string& path);

/// Which file it is, whatever its name: the same as long as nobody puts another in its place.
struct FileId {
  std::uint64_t device = 0;
  std::uint64_t inode = 0;
  bool operator==(const FileId&) const = default;
};
/// Nothing when there is no regular file (links are not followed).
[[nodiscard]] std::optional<FileId> file_id(const std::string& path);

/// True when `path` names something below `folder` and climbs nowhere (no "..", no ".").
[[nodiscard]] bool lies_below(const std::string& path, const std::string& folder);

/// Held while the database is open for writing; the kernel drops it when the process dies.
class WriterLock {
 public:
  /// Locks `db_path`.writer; journal_write when another process has it.
  [[nodiscard]] Status take(const std::string& db_path);

 private:
  Fd fd_;
};

// The name of the process that keeps a writer out of a database. SQLite says "database is locked" and no more.

/// Asks the kernel for the locks that SQLite takes (fcntl, on the database and on the index of its log). The two files
/// are opened once and stay open to the end of the process: to close a file drops the locks of every connection that
/// the process has on it. One thread.
class LockProbe {
 public:
  /// "sqlite3 (process 1234)"; "process 1234" where its name may not be read; empty: no other process holds a lock that
  /// a writer waits for. No heap for the probe itself.
  [[nodiscard]] std::string holder(const std::string& db_path);

 private:
  struct Probed {
    int fd = -1;
    std::optional<FileId> file;
  };
  /// Process that holds a lock on bytes `first`..`last`; 0: none does.
  [[nodiscard]] static std::int64_t owner_of(Probed& probed, const std::string& path, std::int64_t first,
                                             std::int64_t last);
  std::array<Probed, 2> probed_;  ///< database, index of its log
};

/// "sqlite3 (process 1234)", as LockProbe says it.
[[nodiscard]] std::string process_words(std::int64_t pid);

}  // namespace slabd::storage
