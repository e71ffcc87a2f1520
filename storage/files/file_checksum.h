// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "base/os.h"
#include "base/result.h"

/// Proof that a backup is byte for byte what was written: one line of text behind its last page, with the length and
/// the SHA-256 of everything before it. The line is part of the file, so it survives a copy. SQLite reads only the
/// pages that its header counts and ignores the line.
namespace slabd::storage {

/// Length of the line. It has always the same length, so the end of a file is enough to find it.
inline constexpr std::size_t kChecksumLineBytes = 128;

/// `PRAGMA default_cache_size` of a backup, a number in the header that nothing else here uses: pages of cache for
/// other programs. It shows that a file without a line had one.
inline constexpr std::uint32_t kBackupMark = 1021;

/// Computes a file's checksum piece by piece and appends the line.
class ChecksumWriter {
 public:
  explicit ChecksumWriter(std::string path);
  ~ChecksumWriter();
  ChecksumWriter(const ChecksumWriter&) = delete;
  ChecksumWriter& operator=(const ChecksumWriter&) = delete;

  /// Reads up to `bytes` more. When the end of the file is reached, appends the line and syncs the file; `done` is
  /// true then. Codes: journal_write, store_full.
  [[nodiscard]] Status step(std::uint64_t bytes, bool& done);

 private:
  struct Sum;
  std::string path_;
  Fd fd_;
  std::unique_ptr<Sum> sum_;
  std::vector<char> piece_;
  std::uint64_t read_ = 0;
};

/// Cuts the line off a backup that was copied into the place of a database, so that its pages are all of it again. Does
/// nothing to another file. No connection of this process may be open.
[[nodiscard]] Status remove_checksum(const std::string& path);

struct FileChecksum {
  bool present = false;  ///< false: the file has no line (a live database, or another program's copy)
  std::string trouble;   ///< how the file differs from what was written; empty: no difference was found
};
/// Compares a file with its line, and its length with the length that SQLite's header names. Reads the whole file only
/// when it has a line. Does not open the file as a database. journal_write: the file cannot be read.
[[nodiscard]] Result<FileChecksum> check_checksum(const std::string& path);

}  // namespace slabd::storage
