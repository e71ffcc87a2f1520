// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "base/os.h"
#include "base/result.h"

/// Proof that a backup is byte for byte as written. One line of text after its last page contains the length and the
/// SHA-256 of everything before it. The line is part of the file, so it survives a copy. SQLite reads only the pages
/// counted in its header and ignores the line.
namespace slabd::storage {

/// Length of the line. It is constant, so the end of a file is enough to find the line.
inline constexpr std::size_t kChecksumLineBytes = 128;

/// `PRAGMA default_cache_size` of a backup, a number in the header that is not used otherwise (pages of cache for other
/// programs). It proves that a file without a line had one.
inline constexpr std::uint32_t kBackupMark = 1021;

/// Computes a file's checksum in pieces and appends the line.
class ChecksumWriter {
 public:
  explicit ChecksumWriter(std::string path);
  ~ChecksumWriter();
  ChecksumWriter(const ChecksumWriter&) = delete;
  ChecksumWriter& operator=(const ChecksumWriter&) = delete;

  /// Reads up to `bytes` more. At the end of the file it appends the line, syncs the file and sets `done`. Codes:
  /// journal_write, store_full.
  [[nodiscard]] Status step(std::uint64_t bytes, bool& done);
  /// Bytes read up to now.
  [[nodiscard]] std::uint64_t bytes_read() const { return read_; }

 private:
  struct Sum;
  std::string path_;
  Fd fd_;
  std::unique_ptr<Sum> sum_;
  std::vector<char> piece_;
  std::uint64_t read_ = 0;
};

/// Removes the line from a backup that was copied to the place of a database, so that the file consists of pages only.
/// Does nothing to other files. No connection of this process may be open.
[[nodiscard]] Status remove_checksum(const std::string& path);

struct FileChecksum {
  bool present = false;  ///< false: the file has no line (a live database, or another program's copy)
  std::string trouble;   ///< difference between the file and its line; empty if none
};
/// Compares a file with its line, and its length with the length in SQLite's header. Reads the whole file only if it
/// has a line. Does not open the file as a database. journal_write: the file cannot be read.
[[nodiscard]] Result<FileChecksum> check_checksum(const std::string& path);

}  // namespace slabd::storage
