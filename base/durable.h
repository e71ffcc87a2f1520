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

/// Files that are there whole or not at all: written beside under a name of their own, then renamed. What must also
/// outlast a computer that stops is synced, and its folder. Errors name the file; where nothing else is said they are
/// journal_write.
namespace slabd::cli {

/// Every symbolic link on the way to `path`, its last name included, may be followed: its owner is the caller or root,
/// or only they can write to the folder that contains it. In every other folder (/tmp with its sticky bit, a home of
/// another user) another user can put a link there that leads to the caller's own files. config: the sentence names the
/// link and its owner.
[[nodiscard]] Status check_links(const std::string& path);

/// A file that appears whole or not at all, whoever stops the program (Ctrl-C, a time limit) and whoever else writes
/// the same file: the last one to finish has it. "-" is standard output. A symbolic link stays, and the file that it
/// means is replaced, unless another user may have put the link there (check_links); a pipe or a character device is no
/// file that could be replaced: it is written into.
class OutFile {
 public:
  struct Kind {
    bool synced = false;     ///< on the disk when `close` returns
    bool rewritten = false;  ///< `write_at_start` will be called: a pipe, or what this program's own output goes
                             ///< to, is refused at once
    bool of_slabd = false;   ///< what stands under the name is replaced whatever it is: a link that somebody
                             ///< laid into a shared folder must not lead a file of slabd's own elsewhere
    std::optional<mode_t> mode = std::nullopt;  ///< whatever the umask; else 0666 less the umask
  };
  explicit OutFile(std::string path) : OutFile(std::move(path), Kind{}) {}
  OutFile(std::string path, Kind kind);
  ~OutFile();
  OutFile(const OutFile&) = delete;
  OutFile& operator=(const OutFile&) = delete;

  void write(std::string_view text) { write(text.data(), text.size()); }
  void write(const void* bytes, std::size_t count);
  /// Overwrites what was written first; the rest stays.
  void write_at_start(std::string_view text);
  /// Everything was written until now; if not, `close` says why.
  [[nodiscard]] bool good() const { return error_number_ == 0; }
  /// `code`: it could not be opened, or not all of it was written; nothing is left then.
  [[nodiscard]] Status close(Code code = Code::config);

 private:
  void open_part();
  void finish();

  std::string path_;  ///< as the user said it
  Kind kind_;
  std::string target_;  ///< the file that `path_` means, links followed
  std::string part_;    ///< beside it; empty: written into what is there
  std::FILE* file_ = nullptr;
  int error_number_ = 0;
  std::string refusal_;  ///< a link that is not followed
};

/// Replaces a file of slabd's own by `text`, or leaves it as it was. What a user names (--out) is an OutFile.
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
  /// False: somebody else holds it, or the file cannot be made.
  [[nodiscard]] bool take(const std::string& path);

 private:
  Fd fd_;
};

}  // namespace slabd::cli
