// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string_view>

#include "base/base.h"
#include "base/os.h"

namespace slabd::hal {

/// Makes the open file `fd`, with the name `name` in the folder `from_folder`, durable at `path`. Syncs it, makes
/// missing folders, moves it there and syncs the folders. Copies it if `path` is on another file system or the file has
/// other names. When it returns, the file survives a power cut. store_full: the disk is full; frame_incomplete: `name`
/// is no longer the file that `fd` refers to; journal_write: any other error. A file that exists at `path` stays
/// (journal_write). After an error nothing of this scan is left at `path`. No heap.
[[nodiscard]] Status spool_file(int fd, int from_folder, const char* name, const PathText& path);

/// A scan that is written into the spool while it arrives: under a working name next to its path until finish(). No
/// heap. store_full: the disk is full; journal_write: any other error, also if a file exists at the path.
class SpoolWriter {
 public:
  SpoolWriter() = default;
  ~SpoolWriter() { abandon(); }
  SpoolWriter(const SpoolWriter&) = delete;
  SpoolWriter& operator=(const SpoolWriter&) = delete;

  /// Makes missing folders and the working file; abandons a working file that is open.
  [[nodiscard]] Status begin(const PathText& path);
  [[nodiscard]] Status write(std::span<const std::byte> bytes);
  [[nodiscard]] Status write(std::string_view text) { return write(std::as_bytes(std::span(text))); }
  /// Syncs, moves to the path, syncs the folder: then it survives a power cut. After an error no file is left.
  [[nodiscard]] Status finish();
  /// Deletes the working file.
  void abandon();
  [[nodiscard]] bool is_open() const { return fd_.is_open(); }

 private:
  PathText path_;
  Fd fd_;
};

}  // namespace slabd::hal
