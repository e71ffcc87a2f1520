// SPDX-License-Identifier: Apache-2.0
#include "storage/files/raw_file.h"

#include <sqlite3.h>

#include <algorithm>
#include <vector>

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

}  // namespace slabd::storage
