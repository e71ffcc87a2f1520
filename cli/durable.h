// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>

#include "base/result.h"

/// Files that are there whole or not at all, whatever stops the computer: written beside, synced, renamed, the folder
/// synced. Every error is journal_write and names the file.
namespace slabd::cli {

/// Replaces `path` by `text`, or leaves it as it was.
[[nodiscard]] Status write_durably(const std::string& path, std::string_view text, mode_t mode = 0664);

/// Copies a file's bytes into a new file and syncs it; the folder is the caller's. Shares blocks where the file system
/// can.
[[nodiscard]] Status copy_synced(const std::string& from, const std::string& to);

/// Gives a finished folder (or file) its final name, in the same folder, and syncs that. `to` must not exist, or be an
/// empty folder.
[[nodiscard]] Status rename_durably(const std::string& from, const std::string& to);

[[nodiscard]] Status sync_folder(const std::string& path);

struct FileDigest {
  std::uint64_t bytes = 0;
  std::string sha256;  ///< hex
};
/// Of the file's content.
[[nodiscard]] Result<FileDigest> digest_of(const std::string& path);

/// One writer at a time: holds a lock on a file until destroyed. The system lets go of it when the process dies.
class FolderLock {
 public:
  FolderLock() = default;
  ~FolderLock();
  FolderLock(FolderLock&& other) noexcept : fd_(other.fd_) { other.fd_ = -1; }
  FolderLock& operator=(FolderLock&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

  /// False: somebody else holds it, or the file cannot be made.
  [[nodiscard]] bool take(const std::string& path);

 private:
  int fd_ = -1;
};

}  // namespace slabd::cli
