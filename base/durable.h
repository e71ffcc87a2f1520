// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <string>
#include <string_view>

#include "base/os.h"
#include "base/result.h"

/// Files that appear completely or not at all: written under a temporary name in the same folder, then renamed. A file
/// that must survive a power failure is synced together with its folder. Error texts name the file; the default code is
/// journal_write.
namespace slabd {

/// Checks that every symbolic link in `path`, including the last name, may be followed. Its owner must be the caller or
/// root, or no other user may write to its folder. In any other folder (/tmp with its sticky bit, another user's home)
/// another user can place a link to the caller's own files. Error config: the text names the link and its owner.
[[nodiscard]] Status check_links(const std::string& path);

/// A file that appears completely or not at all, even if a signal (Ctrl-C, a time limit) stops the program. If several
/// programs write the same file, the last one to finish wins. "-" is standard output. A symbolic link is kept and its
/// target is replaced, unless another user may have placed the link (check_links). A pipe or a character device cannot
/// be replaced and is written directly.
class OutFile {
 public:
  struct Kind {
    bool synced = false;  ///< synced to disk when `close` returns
    /// `write_at_start` will be called: a pipe and this program's own output are rejected at once
    bool rewritten = false;
    bool of_slabd = false;  ///< a link under this name is replaced, not followed: a link in a shared folder must not
                            ///< redirect slabd's own files
    std::optional<mode_t> mode = std::nullopt;  ///< exact mode, independent of the umask; nullopt: 0666 less the umask
  };
  explicit OutFile(std::string path) : OutFile(std::move(path), Kind{}) {}
  OutFile(std::string path, Kind kind);
  ~OutFile();
  OutFile(const OutFile&) = delete;
  OutFile& operator=(const OutFile&) = delete;

  void write(std::string_view text) { write(text.data(), text.size()); }
  void write(const void* bytes, std::size_t count);
  /// Overwrites the beginning of the file; the rest is kept.
  void write_at_start(std::string_view text);
  /// True if all writes succeeded so far; if not, `close` returns the reason.
  [[nodiscard]] bool good() const { return error_number_ == 0; }
  /// Returns `code` if the file could not be opened or not written completely; no file remains then.
  [[nodiscard]] Status close(Code code = Code::config);

 private:
  void open_part();
  void finish();

  std::string path_;  ///< path as given by the user
  Kind kind_;
  std::string target_;  ///< the file at `path_`, with links resolved
  std::string part_;    ///< temporary file in the same folder; empty if the target is written directly
  std::FILE* file_ = nullptr;
  int error_number_ = 0;
  std::string refusal_;  ///< reason why a link is not followed
};

/// Replaces a file of slabd's own with `text`, or leaves it unchanged. A file named by the user (--out) is an OutFile.
[[nodiscard]] Status write_durably(const std::string& path, std::string_view text, mode_t mode = 0664);

/// Copies a file into a new file and syncs it; the caller syncs the folder. Shares blocks if the file system supports
/// it.
[[nodiscard]] Status copy_synced(const std::string& from, const std::string& to);

/// Renames a finished folder or file to its final name in the same folder, and syncs that folder. `to` must not exist,
/// or be an empty folder.
[[nodiscard]] Status rename_durably(const std::string& from, const std::string& to);

[[nodiscard]] Status sync_folder(const std::string& path);

struct FileDigest {
  std::uint64_t bytes = 0;
  std::string sha256;  ///< hex
};
/// Size and SHA-256 of the file's content.
[[nodiscard]] Result<FileDigest> digest_of(const std::string& path);

/// Exclusive lock on a file, held until destruction. The kernel releases it when the process dies.
class FileLock {
 public:
  /// False if another process holds the lock, or if the file cannot be created.
  [[nodiscard]] bool take(const std::string& path);

 private:
  Fd fd_;
};

}  // namespace slabd
