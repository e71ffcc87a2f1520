// SPDX-License-Identifier: Apache-2.0
//
// The order of the steps matters. The database gets its second name in the quarantine, the note atomically replaces the
// first name, and only then the log is moved. A database is never left without its log, because SQLite would open it
// without an error, but the newest results would be missing.
#include "storage/files/quarantine.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <fstream>

#include "storage/files/folders.h"
#include "storage/files/log_copy.h"
#include "storage/files/retention.h"

namespace slabd::storage {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kFirstLine = "slabd quarantine\n";
constexpr std::array kSideFiles = {"-wal", "-journal", kLogCopy};
constexpr int kFoldersMax = 1000;

Error trouble(const char* doing, const std::string& path) {
  return error(Code::journal_write, "%s %s: %s", doing, path.c_str(), std::strerror(errno));
}

std::string folder_of(const std::string& path) {
  return fs::path(path).parent_path().string();
}

Result<std::string> new_folder(const std::string& path) {
  std::array<char, 32> time{};
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&now, &utc);
  std::strftime(time.data(), time.size(), "%Y%m%dT%H%M%SZ", &utc);
  for (int i = 1; i <= kFoldersMax; ++i) {
    const std::string name = path + ".quarantine-" + time.data() + (i == 1 ? "" : "-" + std::to_string(i));
    struct stat there {};
    if (lstat(name.c_str(), &there) == 0) continue;
    if (Status status = make_folder(name); !status.ok()) return status.error();
    return name;
  }
  return error(Code::journal_write, "%s has %d quarantine folders already", path.c_str(), kFoldersMax);
}

Status write_note(const std::string& path, const std::string& folder, const std::string& why) {
  std::error_code ec;
  fs::remove(path, ec);
  if (Status status = create_file(path); !status.ok()) return status;
  const Fd file(open(path.c_str(), O_WRONLY | O_CLOEXEC));
  if (!file.is_open()) return trouble("cannot open", path);
  const std::string text =
      std::string(kFirstLine) + folder + "\n" + why +
      "\nThe database that was here is now in that folder, unchanged. slabd begins "
      "no new history by itself.\nPut a backup here with `slabctl db restore`, or start again with "
      "`slabctl db restore --fresh`.\n";
  if (!write_all(file.get(), text.data(), text.size()) || fsync(file.get()) != 0) return trouble("cannot write", path);
  return success();
}

/// Slab key of a folder of the spool; 0 if it is not a slab's folder.
std::int64_t key_of(const fs::path& folder) {
  const std::string name = folder.filename().string();
  if (name.empty() || name.size() > 18 || name.find_first_not_of("0123456789") != std::string::npos) return 0;
  return static_cast<std::int64_t>(std::stoll(name));
}

/// Second line of the note.
std::string folder_in(const std::string& note) {
  const std::size_t begin = kFirstLine.size();
  return note.substr(begin, note.find('\n', begin) - begin);
}

}  // namespace

std::optional<std::string> quarantine_note(const std::string& path) {
  std::error_code fault;
  if (!fs::is_regular_file(path, fault)) return std::nullopt;  // opening a FIFO would block
  std::ifstream in(path, std::ios::binary);
  std::string text(4096, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(in.gcount()));
  if (!text.starts_with(kFirstLine)) return std::nullopt;
  return text;
}

Result<std::string> quarantine(const std::string& path, const std::string& why) {
  Result<std::string> folder = new_folder(path);
  if (!folder.ok()) return folder.error();
  const std::string name = fs::path(path).filename().string();
  const std::string kept = folder.value() + "/" + name;
  const std::string part = path + ".note-part";
  if (Status status = write_note(part, folder.value(), why); !status.ok()) return status.error();
  if (link(path.c_str(), kept.c_str()) != 0) return trouble("cannot give a second name to", path);
  if (Status status = sync_file(folder.value()); !status.ok()) return status.error();
  if (rename(part.c_str(), path.c_str()) != 0) return trouble("cannot replace", path);
  if (Status status = sync_file(folder_of(path)); !status.ok()) return status.error();
  if (Status status = finish_quarantine(path); !status.ok()) return status.error();
  return folder;
}

std::string replaced_in_quarantine(const std::string& path) {
  const std::optional<std::string> note = quarantine_note(path);
  if (!note) return {};
  const std::string folder = folder_in(*note);
  if (note->compare(kFirstLine.size() + folder.size(), std::strlen(kReplaced) + 2,
                    '\n' + std::string(kReplaced) + '\n') != 0)
    return {};
  return folder + "/" + fs::path(path).filename().string();
}

Status finish_quarantine(const std::string& path) {
  const std::optional<std::string> note = quarantine_note(path);
  if (!note) return success();
  const std::string folder = folder_in(*note);
  const std::string name = fs::path(path).filename().string();
  bool moved = false;
  for (const char* side : kSideFiles) {
    struct stat there {};
    if (lstat((path + side).c_str(), &there) != 0) continue;
    if (Status status = make_folder(folder); !status.ok()) return status;
    if (rename((path + side).c_str(), (folder + "/" + name + side).c_str()) != 0)
      return trouble("cannot move", path + side);
    moved = true;
  }
  unlink((path + "-shm").c_str());  // has no meaning without the log
  if (!moved) return success();
  if (Status status = sync_file(folder); !status.ok()) return status;
  return sync_file(folder_of(path));
}

std::int64_t newest_key_in_spool(const std::string& spool_dir) {
  std::int64_t newest = 0;
  std::error_code ec;
  for (fs::directory_iterator entry(spool_dir, ec), end; !ec && entry != end; entry.increment(ec)) {
    newest = std::max(newest, key_of(entry->path()));
  }
  return newest;
}

namespace {

std::uint32_t big_endian(const unsigned char* bytes) {
  return std::uint32_t{bytes[0]} << 24U | std::uint32_t{bytes[1]} << 16U | std::uint32_t{bytes[2]} << 8U |
         std::uint32_t{bytes[3]};
}

/// True if a write-ahead log contains a whole transaction, or cannot be read. SQLite's file format, section 4: a header
/// of 32 bytes with the page size at 8, then frames of 24 bytes and a page. Bytes 4 to 7 of a frame are not 0 if it
/// ends a transaction. Its salt (8 to 15) equals the header's (16 to 23).
bool may_hold_transaction(const std::string& log_path) {
  constexpr off_t kHeader = 32;
  constexpr off_t kFrame = 24;
  const off_t bytes = file_bytes(log_path);
  if (bytes < kHeader) return false;
  const Fd log(open(log_path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!log.is_open()) return true;
  std::array<unsigned char, kHeader> header{};
  std::array<unsigned char, kFrame> frame{};
  bool readable = pread(log.get(), header.data(), header.size(), 0) == kHeader;
  bool found = false;
  const off_t page = big_endian(&header[8]);
  if (page >= 512 && page <= 65'536)
    for (off_t at = kHeader; readable && !found && at + kFrame + page <= bytes; at += kFrame + page) {
      readable = pread(log.get(), frame.data(), frame.size(), at) == kFrame;
      if (!std::equal(&frame[8], &frame[16], &header[16])) break;
      found = big_endian(&frame[4]) != 0;
    }
  return found || !readable;
}

/// A slab's folder that is not empty; empty text if there is none.
std::string scans_in(const std::string& spool_dir) {
  std::error_code ec;
  for (fs::directory_iterator entry(spool_dir, ec), end; !ec && entry != end; entry.increment(ec)) {
    if (key_of(entry->path()) == 0) continue;
    std::error_code inside;
    if (fs::directory_iterator(entry->path(), inside) != fs::directory_iterator() && !inside)
      return entry->path().string();
  }
  return {};
}

/// True if a folder contains a file with the name of a scan; other folders named by digits do not count.
bool has_scan(const fs::path& folder) {
  std::error_code ec;
  for (fs::directory_iterator entry(folder, ec), end; !ec && entry != end; entry.increment(ec))
    if (is_scan_name(entry->path().filename().string())) return true;
  return false;
}

}  // namespace

std::string scans_above(const std::string& spool_dir, std::int64_t known_key) {
  std::string found;
  std::error_code ec;
  for (fs::directory_iterator entry(spool_dir, ec), end; !ec && entry != end; entry.increment(ec)) {
    const std::int64_t key = key_of(entry->path());
    if (key <= known_key || !has_scan(entry->path())) continue;
    known_key = key;
    found = entry->path().string();
  }
  return found;
}

std::string traces_of_a_lost_database(const std::string& path, const std::string& spool_dir) {
  std::error_code ec;
  if (file_bytes(path) > 0) return {};
  // A log without a transaction is left by an interrupted creation; it never contained data.
  if (may_hold_transaction(path + "-wal")) return path + "-wal";
  // An interrupted restore: a new history must not be begun before it is completed.
  for (const char* side : {"", ".part"})
    if (file_bytes(path + kRestored + side) > 0) return path + kRestored + side;
  const std::string name = fs::path(path).filename().string();
  const std::string folder = folder_of(path).empty() ? "." : folder_of(path);
  for (fs::directory_iterator entry(folder, ec), end; !ec && entry != end; entry.increment(ec)) {
    const std::string other = entry->path().filename().string();
    const bool ours = other.starts_with(name + ".quarantine-") ||
                      (other.starts_with(name + ".v") && other.find("-backup") != std::string::npos);
    if (ours && !other.ends_with(".part")) return entry->path().string();
  }
  ec.clear();
  for (fs::directory_iterator entry(folder + "/backups", ec), end; !ec && entry != end; entry.increment(ec))
    if (entry->path().extension() == ".db") return entry->path().string();
  return scans_in(spool_dir);
}

}  // namespace slabd::storage
