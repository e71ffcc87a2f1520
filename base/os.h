// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fcntl.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include "base/base.h"

/// Files and descriptors of the operating system.
namespace slabd {

/// Meaning of errno as a constant text (no heap, thread-safe).
[[nodiscard]] inline const char* errno_text(int error_number) {
  const char* text = strerrordesc_np(error_number);
  return text == nullptr ? "unknown error" : text;
}

/// Owner of one file descriptor; -1 if none. Errors of close are ignored because durable data is synced before.
class Fd {
 public:
  Fd() = default;
  explicit Fd(int fd) : fd_(fd) {}
  ~Fd() { reset(); }
  Fd(const Fd&) = delete;
  Fd& operator=(const Fd&) = delete;
  Fd(Fd&& other) noexcept : fd_(other.release()) {}
  Fd& operator=(Fd&& other) noexcept {
    if (this != &other) {
      reset();
      fd_ = other.release();
    }
    return *this;
  }

  [[nodiscard]] int get() const { return fd_; }
  [[nodiscard]] bool is_open() const { return fd_ >= 0; }
  [[nodiscard]] int release() { return std::exchange(fd_, -1); }
  void reset() {
    if (fd_ >= 0) close(fd_);
    fd_ = -1;
  }

 private:
  int fd_ = -1;
};

/// Writes all bytes, also if the system accepts them in pieces. False: errno contains the reason.
[[nodiscard]] inline bool write_all(int fd, const void* from, std::size_t bytes) {
  for (const char* at = static_cast<const char*>(from); bytes > 0;) {
    const ssize_t n = ::write(fd, at, bytes);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return false;
    at += n;
    bytes -= static_cast<std::size_t>(n);
  }
  return true;
}

/// Current state of a file.
struct FileState {
  bool known = false;  ///< false if the file does not exist or its state cannot be read
  mode_t mode = 0;
  dev_t device = 0;
  ino_t inode = 0;
  std::int64_t bytes = 0;
  std::int64_t changed_ns = 0;  ///< mtime
  std::int64_t status_ns = 0;   ///< ctime: last write, rename or move, by the file system's clock

  [[nodiscard]] bool same_content(const FileState& other) const {
    return known && other.known && device == other.device && inode == other.inode && bytes == other.bytes &&
           changed_ns == other.changed_ns;
  }
};

/// State of a folder's entry, links not followed; with an empty name, of the open file itself. On a network share the
/// kernel may answer stat() from its cache for a minute, depending on the mount; this call queries the server. On a
/// local disk it costs no more than stat().
[[nodiscard]] inline FileState file_state(int fd, const char* name) {
  struct statx status {};
  constexpr int kAnew = AT_STATX_FORCE_SYNC | AT_SYMLINK_NOFOLLOW | AT_EMPTY_PATH | AT_NO_AUTOMOUNT;
  constexpr unsigned kWanted = STATX_TYPE | STATX_MODE | STATX_INO | STATX_SIZE | STATX_MTIME | STATX_CTIME;
  if (statx(fd, name, kAnew, kWanted, &status) != 0) return {};
  FileState state;
  state.known = true;
  state.mode = status.stx_mode;
  state.device = makedev(status.stx_dev_major, status.stx_dev_minor);
  state.inode = status.stx_ino;
  state.bytes = static_cast<std::int64_t>(status.stx_size);
  state.changed_ns = status.stx_mtime.tv_sec * kNsPerS + status.stx_mtime.tv_nsec;
  state.status_ns = status.stx_ctime.tv_sec * kNsPerS + status.stx_ctime.tv_nsec;
  return state;
}

}  // namespace slabd
