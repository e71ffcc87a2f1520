// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "base/result.h"

struct sqlite3_file;

/// Making a write-ahead log durable that an earlier connection or process has left.
namespace slabd::storage {

/// After this, every byte of `db_path`-wal is on the disk, whatever failed before: a commit may be put behind it.
/// Without a log it does nothing. A reader may have the log open meanwhile: it always reads the same bytes. The
/// writer's lock must be held, no connection of this process be open. Needs the log's size (16 MB at most in normal
/// life) of free space for a moment, and five syncs.
/// journal_write, store_full, internal (no memory): the database must not be used until another call succeeds.
[[nodiscard]] Status make_log_durable(const std::string& db_path);

/// Such a call is under way, or was cut short and the next start of slabd has to end it: a reader must not open the
/// database, for it might take a log that a power cut has spoilt for the whole one, and the writer would believe it.
[[nodiscard]] bool log_is_in_doubt(const std::string& db_path);

/// The copy's name, which belongs to the database as its log does.
inline constexpr const char* kLogCopy = "-log-copy";

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
