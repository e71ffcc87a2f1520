// SPDX-License-Identifier: Apache-2.0
//
// Problem: after a failed sync of the log, Linux treats the unwritten pages as written. They can be read, but no later
// sync writes them, although it succeeds. The next process would find commits that are not on the disk and append its
// own, and a power cut would lose all of them. The process with the failed sync may have been killed, so a later one
// cannot detect this. Therefore every process makes the log durable before its first commit.
//
// Idea: writing the same bytes again makes them durable. A power cut during that may damage sectors that were safe, so
// a copy is made first. A checkpoint is not an alternative. It would write pages whose log is not on the disk, and a
// power cut could leave only some of them.
//
//   1. Copy the log to `-log-copy.part` and sync it.
//   2. Rename it to `-log-copy` and sync the folder.
//   3. Write the log in place from the copy and sync it.
//   4. Clear the copy's first sector and sync it, then delete its name and sync the folder.
//
// Invariants: a file named `-log-copy` with the magic words is complete and durable, and no commit was made since it
// was copied. A process that finds one continues at step 3. A name that reappears after a power cut, without the magic
// words, is ignored.
#include "storage/files/log_copy.h"

#include <sqlite3.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <exception>
#include <filesystem>
#include <vector>

#include "storage/files/folders.h"
#include "storage/files/sqlite.h"

namespace slabd::storage {

namespace {

constexpr std::size_t kChunk = 65'536;

}  // namespace

RawFile::RawFile(const std::string& path, Kind kind) : path_(path) {
  sqlite3_vfs* vfs = sqlite3_vfs_find(nullptr);
  memory_ =
      std::make_unique<std::max_align_t[]>(static_cast<std::size_t>(vfs->szOsFile) / sizeof(std::max_align_t) + 1);
  void* place = memory_.get();
  file_ = static_cast<sqlite3_file*>(place);
  const int flags = SQLITE_OPEN_READWRITE | (kind == Kind::log ? SQLITE_OPEN_WAL : SQLITE_OPEN_MAIN_DB);
  const int result = vfs->xOpen(vfs, path_.c_str(), file_, flags, nullptr);
  if (result == SQLITE_OK) return;
  if (file_->pMethods != nullptr) file_->pMethods->xClose(file_);
  must(result, "open");
}

RawFile::~RawFile() {
  if (file_->pMethods != nullptr) file_->pMethods->xClose(file_);
}

bool RawFile::exists(const std::string& path) {
  sqlite3_vfs* vfs = sqlite3_vfs_find(nullptr);
  int found = 0;
  return vfs->xAccess(vfs, path.c_str(), SQLITE_ACCESS_EXISTS, &found) == SQLITE_OK && found != 0;
}

void RawFile::remove(const std::string& path) {
  sqlite3_vfs* vfs = sqlite3_vfs_find(nullptr);
  const int result = vfs->xDelete(vfs, path.c_str(), 0);
  if (result != SQLITE_OK)
    throw SqlFailure{result, "cannot remove " + path + " (SQLite " + std::to_string(result) + ")"};
}

std::int64_t RawFile::size() {
  sqlite3_int64 bytes = 0;
  must(file_->pMethods->xFileSize(file_, &bytes), "read the size of");
  return bytes;
}

void RawFile::read(std::int64_t at, std::span<unsigned char> bytes) {
  must(file_->pMethods->xRead(file_, bytes.data(), static_cast<int>(bytes.size()), at), "read");
}

void RawFile::write(std::int64_t at, std::span<const unsigned char> bytes) {
  must(file_->pMethods->xWrite(file_, bytes.data(), static_cast<int>(bytes.size()), at), "write");
}

void RawFile::sync() {
  must(file_->pMethods->xSync(file_, SQLITE_SYNC_FULL), "sync");
}

void RawFile::must(int result, const char* doing) const {
  if (result != SQLITE_OK)
    throw SqlFailure{result, std::string("cannot ") + doing + " " + path_ + " (SQLite " + std::to_string(result) + ")"};
}

void read_through(const std::string& path, RawFile::Kind kind) {
  RawFile file(path, kind);
  const std::int64_t bytes = file.size();
  std::vector<unsigned char> chunk(kChunk);
  for (std::int64_t at = 0; at < bytes; at += static_cast<std::int64_t>(kChunk))
    file.read(at, std::span(chunk).first(static_cast<std::size_t>(std::min<std::int64_t>(kChunk, bytes - at))));
}

namespace {

constexpr std::size_t kSector = 512;  ///< the copy's header has its own sector
constexpr std::int64_t kContentAt = kSector;
constexpr std::string_view kMagic = "slabd: a copy of the log";

// SQLite does not recognise the copy as a log by its name, so it is opened as a database.
using Header = std::array<unsigned char, kSector>;

std::string folder_of(const std::string& path) {
  return std::filesystem::path(path).parent_path().string();
}

void copy(RawFile& from, std::int64_t from_at, RawFile& to, std::int64_t to_at) {
  const std::int64_t end = from.size();
  std::vector<unsigned char> chunk(kChunk);
  for (std::int64_t at = from_at; at < end; at += static_cast<std::int64_t>(kChunk)) {
    const auto piece =
        std::span(chunk).first(static_cast<std::size_t>(std::min(end - at, static_cast<std::int64_t>(kChunk))));
    from.read(at, piece);
    to.write(to_at + at - from_at, piece);
  }
}

bool is_whole_copy(const std::string& path) {
  if (!RawFile::exists(path)) return false;
  RawFile file(path, RawFile::Kind::database);
  if (file.size() < kContentAt) return false;
  Header header{};
  file.read(0, header);
  return std::memcmp(header.data(), kMagic.data(), kMagic.size()) == 0;
}

void remove(const std::string& path) {
  RawFile::remove(path);
  must(sync_file(folder_of(path)));
}

/// Steps 1 and 2.
void take_copy(const std::string& log_path, const std::string& copy_path) {
  const std::string part = copy_path + ".part";
  if (RawFile::exists(part)) remove(part);
  must(create_file(part));
  {
    RawFile log(log_path, RawFile::Kind::log);
    RawFile file(part, RawFile::Kind::database);
    Header header{};
    std::copy(kMagic.begin(), kMagic.end(), header.begin());
    file.write(0, header);
    copy(log, 0, file, kContentAt);
    file.sync();
  }
  if (std::rename(part.c_str(), copy_path.c_str()) != 0)
    throw SqlFailure{SQLITE_IOERR, "cannot rename " + part + ": " + std::strerror(errno)};
  must(sync_file(folder_of(copy_path)));
}

/// Step 3.
void write_log(const std::string& log_path, const std::string& copy_path) {
  must(create_file(log_path));
  RawFile file(copy_path, RawFile::Kind::database);
  RawFile log(log_path, RawFile::Kind::log);
  copy(file, kContentAt, log, 0);
  log.sync();
}

/// Step 4.
void drop_copy(const std::string& copy_path) {
  {
    RawFile file(copy_path, RawFile::Kind::database);
    file.write(0, Header{});
    file.sync();
  }
  remove(copy_path);
}

}  // namespace

Status make_log_durable(const std::string& db_path) {
  const std::string log_path = db_path + "-wal";
  const std::string copy_path = db_path + kLogCopy;
  try {
    if (!is_whole_copy(copy_path)) {
      if (RawFile::exists(copy_path)) remove(copy_path);
      if (file_bytes(log_path) == 0) return success();
      take_copy(log_path, copy_path);
    }
    write_log(log_path, copy_path);
    drop_copy(copy_path);
    return success();
  } catch (const SqlFailure& failure) {
    return error((failure.result & 0xFF) == SQLITE_FULL ? Code::store_full : Code::journal_write,
                 "cannot use database %s: its log cannot be made durable: %s", db_path.c_str(), failure.text.c_str());
  } catch (const std::exception& e) {
    return error(Code::internal, "cannot use database %s: its log cannot be made durable: %s", db_path.c_str(),
                 e.what());
  }
}

bool log_is_in_doubt(const std::string& db_path) {
  return RawFile::exists(db_path + kLogCopy);
}

}  // namespace slabd::storage
