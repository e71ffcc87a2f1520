// SPDX-License-Identifier: Apache-2.0
//
// A sync of the log fails: then Linux takes what it could not write for written. It can still be read, and no later
// sync writes it, though every later sync succeeds. Whoever opens the database next finds commits in the log that are
// not on the disk, puts its own behind them, and a power cut takes all of them. The process that saw the sync fail may
// have been killed, so no process can know: each one makes the log durable before its first commit.
//
// The same bytes written once more are written for good. But a power cut in the middle of that may spoil sectors that
// were safe, so a copy comes first. And it may not be moved into the database instead: a checkpoint writes pages whose
// log is not on the disk, and a power cut would leave half of them.
//
//   1. the log is copied into `-log-copy.part`, which is synced
//   2. that gets the name `-log-copy`, the folder is synced
//   3. the log is written from the copy, in place, and synced
//   4. the copy's first sector is wiped and synced, then its name removed and the folder synced
//
// Invariants: what bears the name `-log-copy` and the magic words is whole and on the disk, and no commit has been made
// since it was taken. So whoever finds one goes on at step 3, and a name that a power cut brings back says nothing.
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
  must(file_->pMethods->xFileSize(file_, &bytes), "ask for the size of");
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

constexpr std::size_t kSector = 512;  ///< the copy's header, alone in its sector
constexpr std::int64_t kContentAt = kSector;
constexpr std::string_view kMagic = "slabd: a copy of the log";

// By its name SQLite takes the copy for no log, so it is opened as a database.
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
