// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "base/result.h"

struct sqlite3_file;

/// Makes a write-ahead log durable that an earlier connection or process has left.
namespace slabd::storage {

/// Makes every byte of `db_path`-wal durable, whatever failed before, so that commits may be appended. Does nothing
/// without a log. A reader may have the log open: it always reads the same bytes. The writer's lock must be held, and
/// this process must have no open connection. Temporarily requires free space of the log's size (normally at most 16
/// MB), and five syncs. journal_write, store_full, internal (no memory): the database must not be used until another
/// call succeeds.
[[nodiscard]] Status make_log_durable(const std::string& db_path);

/// True if such a call is in progress, or was interrupted and the next start of slabd must finish it. A reader must not
/// open the database then. It might accept a log damaged by a power cut as complete and pass that on to the writer.
[[nodiscard]] bool log_is_in_doubt(const std::string& db_path);

/// Suffix of the copy's name; the copy belongs to the database as its log does.
inline constexpr const char* kLogCopy = "-log-copy";

/// A file accessed through SQLite's file layer, below any connection. All members throw SqlFailure.
class RawFile {
 public:
  enum class Kind : std::uint8_t { database, log };

  /// Opens an existing file.
  RawFile(const std::string& path, Kind kind);
  ~RawFile();
  RawFile(const RawFile&) = delete;
  RawFile& operator=(const RawFile&) = delete;

  [[nodiscard]] static bool exists(const std::string& path);
  /// Deletes the name; it is durable only after a sync of the folder.
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

/// Reads a whole file to verify that it is readable.
void read_through(const std::string& path, RawFile::Kind kind);

}  // namespace slabd::storage
