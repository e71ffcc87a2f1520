// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string_view>

#include "base/base.h"
#include "base/os.h"

namespace slabd::hal {

/// Makes the open file `fd`, known as `name` in the folder `from_folder`, durable at `path`: syncs it, makes missing
/// folders, moves it there (copies it when `path` is on another file system, or it has other names), syncs the folders.
/// When it returns the file survives a power cut. store_full: the disk is full; journal_write: anything else;
/// frame_incomplete: `name` is no longer the file that `fd` is. What lies at `path` already stays (journal_write).
/// After an error nothing of this scan is left at `path`. No heap.
[[nodiscard]] Status spool_file(int fd, int from_folder, const char* name, const PathText& path);

/// A scan that is written into the spool while it comes: under a working name beside its place until finish(). No
/// heap. store_full: the disk is full; journal_write: anything else, a file that lies there already included.
class SpoolWriter {
 public:
  SpoolWriter() = default;
  ~SpoolWriter() { abandon(); }
  SpoolWriter(const SpoolWriter&) = delete;
  SpoolWriter& operator=(const SpoolWriter&) = delete;

  /// Makes missing folders and the working file; one that is open is abandoned.
  [[nodiscard]] Status begin(const PathText& path);
  [[nodiscard]] Status write(std::span<const std::byte> bytes);
  [[nodiscard]] Status write(std::string_view text) { return write(std::as_bytes(std::span(text))); }
  /// Syncs, moves to the path, syncs the folder: then it survives a power cut. After an error nothing is left.
  [[nodiscard]] Status finish();
  /// Takes the working file away.
  void abandon();
  [[nodiscard]] bool is_open() const { return fd_.is_open(); }

 private:
  PathText path_;
  Fd fd_;
};

}  // namespace slabd::hal
