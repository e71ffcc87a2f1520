// SPDX-License-Identifier: Apache-2.0
#include "cli/durable.h"

#include <fcntl.h>
#include <sha256.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <vector>

namespace slabd::cli {
namespace {

class File {
 public:
  File(const std::string& path, int flags, mode_t mode = 0) : fd_(::open(path.c_str(), flags | O_CLOEXEC, mode)) {}
  ~File() {
    if (fd_ >= 0) ::close(fd_);
  }
  File(const File&) = delete;
  File& operator=(const File&) = delete;
  [[nodiscard]] int fd() const { return fd_; }
  [[nodiscard]] bool open() const { return fd_ >= 0; }
  /// The one close whose answer matters.
  [[nodiscard]] bool close() {
    const int fd = fd_;
    fd_ = -1;
    return ::close(fd) == 0;
  }

 private:
  int fd_;
};

Error cannot(const char* what, const std::string& path) {
  return error(Code::journal_write, "cannot %s %s: %s", what, path.c_str(), std::strerror(errno));
}

bool write_all(int fd, const char* data, std::size_t size) {
  for (std::size_t done = 0; done < size;) {
    const ssize_t n = ::write(fd, data + done, size - done);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    done += static_cast<std::size_t>(n);
  }
  return true;
}

std::string folder_of(const std::string& path) {
  const std::string folder = std::filesystem::path(path).parent_path().string();
  return folder.empty() ? "." : folder;
}

}  // namespace

Status sync_folder(const std::string& path) {
  const File folder(path, O_RDONLY | O_DIRECTORY);
  if (!folder.open() || ::fsync(folder.fd()) != 0) return cannot("sync the folder", path);
  return success();
}

Status rename_durably(const std::string& from, const std::string& to) {
  if (std::rename(from.c_str(), to.c_str()) != 0) return cannot("make", to);
  return sync_folder(folder_of(to));
}

Status write_durably(const std::string& path, std::string_view text, mode_t mode) {
  const std::string part = path + ".part";
  ::unlink(part.c_str());
  {
    File file(part, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW, mode);
    // fchmod: the umask would take the group's right to write away.
    const bool good = file.open() && ::fchmod(file.fd(), mode) == 0 && write_all(file.fd(), text.data(), text.size()) &&
                      ::fsync(file.fd()) == 0 && file.close();
    if (!good) {
      const Error why = cannot("write", part);
      ::unlink(part.c_str());
      return why;
    }
  }
  return rename_durably(part, path);
}

Status copy_synced(const std::string& from, const std::string& to) {
  const File source(from, O_RDONLY);
  if (!source.open()) return cannot("read", from);
  struct stat info {};
  if (::fstat(source.fd(), &info) != 0 || !S_ISREG(info.st_mode))
    return error(Code::journal_write, "%s is not a file", from.c_str());
  File target(to, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW, 0664);
  if (!target.open()) return cannot("write", to);
  for (;;) {
    const ssize_t n = ::copy_file_range(source.fd(), nullptr, target.fd(), nullptr, std::size_t{1} << 26U, 0);
    if (n == 0) break;
    if (n > 0 || errno == EINTR) continue;
    if (errno != EXDEV && errno != EINVAL && errno != ENOSYS && errno != EOPNOTSUPP) return cannot("write", to);
    // Two file systems that cannot do it between them: by hand, from where it stopped.
    std::vector<char> piece(std::size_t{1} << 20U);
    for (ssize_t got = 0; (got = ::read(source.fd(), piece.data(), piece.size())) != 0;) {
      if (got < 0 && errno == EINTR) continue;
      if (got < 0) return cannot("read", from);
      if (!write_all(target.fd(), piece.data(), static_cast<std::size_t>(got))) return cannot("write", to);
    }
    break;
  }
  if (::fsync(target.fd()) != 0 || !target.close()) return cannot("write", to);
  return success();
}

Result<FileDigest> digest_of(const std::string& path) {
  std::array<char, SHA256_DIGEST_STRING_LENGTH> hex{};
  struct stat info {};
  if (::stat(path.c_str(), &info) != 0 || SHA256File(path.c_str(), hex.data()) == nullptr) return cannot("read", path);
  return FileDigest{static_cast<std::uint64_t>(info.st_size), hex.data()};
}

FolderLock::~FolderLock() {
  if (fd_ >= 0) ::close(fd_);
}

bool FolderLock::take(const std::string& path) {
  fd_ = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0664);
  if (fd_ < 0) return false;
  static_cast<void>(::fchmod(fd_, 0664));  // for the group, whatever the umask; only its owner can
  if (::flock(fd_, LOCK_EX | LOCK_NB) == 0) return true;
  ::close(fd_);
  fd_ = -1;
  return false;
}

}  // namespace slabd::cli
