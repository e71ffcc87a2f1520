// SPDX-License-Identifier: Apache-2.0
//
// Problem: SQLite's own check covers the structure of pages. It does not detect a flipped bit in a stored number, in
// unused space or in a length beyond the last page.
// Idea: a line of fixed length and form after the last page. It is compared as a whole text, which also detects changes
// in the line itself.
// Invariant: a file that ends with the exact line for its bytes is proven. A file whose length is exactly that of its
// pages has no line. Any other slabd database is damaged: a byte of the line was changed, or a part was cut off.
#include "storage/files/file_checksum.h"

#include <fcntl.h>
#include <sha256.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string_view>

#include "storage/files/folders.h"

namespace slabd::storage {
namespace {

constexpr std::size_t kPiece = 65'536;
constexpr std::string_view kBegin = "\nslabd backup, checksum 1: ";
/// SQLite's file format, section 1.3: page size at byte 16 (1 means 65536), number of pages at 28, change counter at
/// 24. The counter for which the number of pages is valid is at 92, kBackupMark at 48.
constexpr std::size_t kHeaderBytes = 100;

Error trouble(const char* doing, const std::string& path) {
  return error(errno == ENOSPC || errno == EDQUOT ? Code::store_full : Code::journal_write, "%s %s: %s", doing,
               path.c_str(), std::strerror(errno));
}

Fd open_to_read(const std::string& path) {
  return Fd(open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
}

/// Reads up to `count` bytes at `at`, fewer only at the end of the file; -1 and errno on failure.
ssize_t read_at(int fd, std::uint64_t at, char* to, std::size_t count) {
  std::size_t done = 0;
  while (done < count) {
    const ssize_t n = pread64(fd, to + done, count - done, static_cast<off64_t>(at + done));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return -1;
    if (n == 0) break;
    done += static_cast<std::size_t>(n);
  }
  return static_cast<ssize_t>(done);
}

std::string line_for(std::uint64_t bytes, std::string_view sha256) {
  std::string number = std::to_string(bytes);
  number.insert(0, 20 - number.size(), '0');
  std::string line = std::string(kBegin) + number + " bytes " + std::string(sha256);
  line.resize(kChecksumLineBytes - 1, ' ');
  return line + "\n";
}
static_assert(kBegin.size() + 20 + 7 + 64 < kChecksumLineBytes, "the line holds length and checksum");

std::uint32_t big_endian(const char* at, std::size_t count) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < count; ++i) value = value << 8U | static_cast<unsigned char>(at[i]);
  return value;
}

/// Length of the database according to its header; 0 if the header does not contain it.
std::uint64_t bytes_of_pages(const std::array<char, kHeaderBytes>& header) {
  static constexpr std::string_view kMagic("SQLite format 3\0", 16);
  if (std::string_view(header.data(), kMagic.size()) != kMagic) return 0;
  if (std::memcmp(header.data() + 24, header.data() + 92, 4) != 0) return 0;
  const std::uint32_t page = big_endian(header.data() + 16, 2);
  return std::uint64_t{page == 1 ? 65'536U : page} * big_endian(header.data() + 28, 4);
}

/// The end of a file, and the length given in its header.
struct Ends {
  std::uint64_t size = 0;
  std::uint64_t pages = 0;   ///< bytes according to the header; 0 if it does not contain them
  std::uint64_t before = 0;  ///< bytes before the line
  bool marked = false;       ///< the header contains kBackupMark
  std::array<char, kChecksumLineBytes> last{};
  [[nodiscard]] std::string_view line() const {
    return size < last.size() ? "" : std::string_view(last.data(), last.size());
  }
};

Status read_ends(int fd, const std::string& path, Ends& ends) {
  struct stat info {};
  if (fstat(fd, &info) != 0) return trouble("cannot look at", path);
  if (!S_ISREG(info.st_mode))
    return error(Code::config, "%s is %s, not a database file", path.c_str(),
                 S_ISFIFO(info.st_mode) ? "a FIFO" : "no regular file");
  ends.size = static_cast<std::uint64_t>(info.st_size);
  std::array<char, kHeaderBytes> header{};
  if (read_at(fd, 0, header.data(), header.size()) < 0) return trouble("cannot read", path);
  ends.pages = bytes_of_pages(header);
  ends.marked = big_endian(header.data() + 48, 4) == kBackupMark;
  if (ends.size < ends.last.size()) return success();
  ends.before = ends.size - ends.last.size();
  if (read_at(fd, ends.before, ends.last.data(), ends.last.size()) < 0) return trouble("cannot read", path);
  return success();
}

}  // namespace

struct ChecksumWriter::Sum {
  SHA256_CTX context{};
};

ChecksumWriter::ChecksumWriter(std::string path)
    : path_(std::move(path)), sum_(std::make_unique<Sum>()), piece_(kPiece) {
  SHA256Init(&sum_->context);
}

ChecksumWriter::~ChecksumWriter() = default;

Status ChecksumWriter::step(std::uint64_t bytes, bool& done) {
  done = false;
  if (!fd_.is_open()) fd_ = Fd(open(path_.c_str(), O_RDWR | O_CLOEXEC | O_NOFOLLOW));
  if (!fd_.is_open()) return trouble("cannot open", path_);
  for (std::uint64_t taken = 0; taken < bytes;) {
    const ssize_t n = read_at(fd_.get(), read_, piece_.data(), std::min<std::uint64_t>(kPiece, bytes - taken));
    if (n < 0) return trouble("cannot read", path_);
    if (n == 0) {
      std::array<char, SHA256_DIGEST_STRING_LENGTH> hex{};
      SHA256End(&sum_->context, hex.data());
      const std::string line = line_for(read_, hex.data());
      for (std::size_t written = 0; written < line.size();) {
        const ssize_t more =
            pwrite64(fd_.get(), line.data() + written, line.size() - written, static_cast<off64_t>(read_ + written));
        if (more < 0 && errno == EINTR) continue;
        if (more <= 0) return trouble("cannot write the checksum of", path_);
        written += static_cast<std::size_t>(more);
      }
      done = true;
      return sync_file(path_);
    }
    SHA256Update(&sum_->context, reinterpret_cast<const std::uint8_t*>(piece_.data()), static_cast<std::size_t>(n));
    read_ += static_cast<std::uint64_t>(n);
    taken += static_cast<std::uint64_t>(n);
  }
  return success();
}

Status remove_checksum(const std::string& path) {
  Ends ends;
  {
    const Fd file = open_to_read(path);
    if (!file.is_open()) return trouble("cannot open", path);
    if (Status status = read_ends(file.get(), path, ends); !status.ok()) return status;
  }
  if (ends.pages == 0 || ends.pages != ends.before || !ends.line().starts_with(kBegin)) return success();
  const Fd file(open(path.c_str(), O_WRONLY | O_CLOEXEC | O_NOFOLLOW));
  if (!file.is_open()) return trouble("cannot open", path);
  return ftruncate64(file.get(), static_cast<off64_t>(ends.before)) == 0 ? success() : trouble("cannot cut", path);
}

Result<FileChecksum> check_checksum(const std::string& path) {
  FileChecksum found;
  const Fd file = open_to_read(path);
  if (!file.is_open()) return trouble("cannot open", path);
  Ends ends;
  if (Status status = read_ends(file.get(), path, ends); !status.ok()) return status.error();
  const auto& [size, pages, before, marked, last] = ends;
  // The line starts at its place; or its start is damaged, but the pages end where a line would start.
  found.present = ends.line().starts_with(kBegin) || (size >= last.size() && pages == before);
  if (!found.present) {
    if (pages != 0 && size == pages && marked)
      found.trouble = "it is a backup, and its checksum was cut off";
    else if (pages != 0 && size < pages)
      found.trouble = "it has " + std::to_string(size) + " bytes, and its header counts " + std::to_string(pages);
    else if (pages != 0 && size > pages)
      found.trouble = "behind its last page are " + std::to_string(size - pages) + " bytes that are not its checksum";
    return found;
  }
  SHA256_CTX context{};
  SHA256Init(&context);
  std::vector<char> piece(kPiece);
  for (std::uint64_t at = 0; at < before;) {
    const ssize_t n = read_at(file.get(), at, piece.data(), std::min<std::uint64_t>(kPiece, before - at));
    if (n < 0) return trouble("cannot read", path);
    if (n == 0) break;
    SHA256Update(&context, reinterpret_cast<const std::uint8_t*>(piece.data()), static_cast<std::size_t>(n));
    at += static_cast<std::uint64_t>(n);
  }
  std::array<char, SHA256_DIGEST_STRING_LENGTH> hex{};
  SHA256End(&context, hex.data());
  if (ends.line() != line_for(before, hex.data()))
    found.trouble = "it is not what was written: its checksum or its length differs";
  return found;
}

}  // namespace slabd::storage
