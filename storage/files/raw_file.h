// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

struct sqlite3_file;

namespace slabd::storage {

/// A file as SQLite's file layer reads and writes it, below any connection. Everything throws SqlFailure.
class RawFile {
 public:
  enum class Kind : std::uint8_t { database, log };

  /// Opens what exists.
  RawFile(const std::string& path, Kind kind);
  ~RawFile();
  RawFile(const RawFile&) = delete;
  RawFile& operator=(const RawFile&) = delete;

  [[nodiscard]] static bool exists(const std::string& path);
  /// The name is gone; whether it stays gone is for a sync of the folder.
  static void remove(const std::string& path);
  [[nodiscard]] std::int64_t size();
  void read(std::int64_t at, std::span<unsigned char> bytes);
  void write(std::int64_t at, std::span<const unsigned char> bytes);
  void sync();

 private:
  void must(int result, const char* doing) const;

  std::string path_;
  std::unique_ptr<std::max_align_t[]> memory_;
  sqlite3_file* file_ = nullptr;
};

/// Reads a file from its first byte to its last.
void read_through(const std::string& path, RawFile::Kind kind);

}  // namespace slabd::storage
