// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>

#include "base/os.h"
#include "hal/hal.h"

// Problem: two daemons with one drop folder or one spool take each other's scans and delete each other's files, and
// each of them looks healthy. Idea: an advisory lock on a file in the folder, which the kernel releases when the
// process ends. Invariant: the file's content was written by the last holder of the lock.
namespace slabd::hal {
namespace {

constexpr const char* kLockName = ".slabd.lock";

/// True if the name still refers to the open file. A lock on a deleted file, or in a folder that was replaced, has no
/// effect.
bool is_the_named_one(int file, int folder) {
  struct stat opened {};
  struct stat named {};
  return fstat(file, &opened) == 0 && fstatat(folder, kLockName, &named, AT_SYMLINK_NOFOLLOW) == 0 &&
         opened.st_dev == named.st_dev && opened.st_ino == named.st_ino;
}

/// The first line of the lock file.
FixedString<200> read_owner(int file) {
  std::array<char, 200> bytes{};
  const ssize_t n = pread(file, bytes.data(), bytes.size(), 0);
  const std::string_view text(bytes.data(), n > 0 ? static_cast<std::size_t>(n) : 0);
  FixedString<200> owner;
  for (const char c : text.substr(0, text.find('\n'))) {
    const char visible = c >= ' ' && c <= '~' ? c : '?';
    owner.append({&visible, 1});
  }
  if (owner.empty()) owner = "unknown: its lock file is empty";
  return owner;
}

void write_owner(int file, const LockOwner& owner) {
  LockOwner line = owner;
  line.append("\n");
  const std::string_view text = line.view();
  // On a full disk the owner's name is lost, but the lock is held.
  if (ftruncate(file, 0) != 0 || pwrite(file, text.data(), text.size(), 0) < 0) return;
}

}  // namespace

LockOwner lock_owner_of_this_process(std::string_view config_path) {
  std::array<char, 65> host{};
  if (gethostname(host.data(), host.size() - 1) != 0) host[0] = '?';
  LockOwner owner;
  owner.printf("slabd, process %ld on %s, configuration %.*s", static_cast<long>(getpid()), host.data(),
               static_cast<int>(std::min<std::size_t>(config_path.size(), 100)), config_path.data());
  return owner;
}

FolderLock::~FolderLock() {
  if (file_ >= 0) close(file_);
}

FolderLock::State FolderLock::take(int folder_fd) {
  text_.clear();
  if (file_ >= 0) {
    if (is_the_named_one(file_, folder_fd)) return State::ours;
    close(file_);
    file_ = -1;
  }
  constexpr mode_t kReadableByAll = 0644;
  constexpr int kSafely = O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC;
  Fd file(openat(folder_fd, kLockName, O_RDWR | O_CREAT | kSafely, kReadableByAll));
  // The file of another user's daemon: most file systems allow locking a file that can be read.
  if (!file.is_open()) file = Fd(openat(folder_fd, kLockName, O_RDONLY | kSafely));
  if (!file.is_open()) {
    text_.printf("%s cannot be opened: %s", kLockName, errno_text(errno));
    return State::cannot;
  }
  if (flock(file.get(), LOCK_EX | LOCK_NB) != 0) {
    if (errno == EWOULDBLOCK) {
      text_.printf("%s", read_owner(file.get()).c_str());
      return State::anothers;
    }
    text_.printf("%s cannot be locked: %s", kLockName, errno_text(errno));
    return State::cannot;
  }
  // Deleted between opening and locking: the next call locks the new file.
  if (!is_the_named_one(file.get(), folder_fd)) {
    text_.printf("%s was replaced while it was locked", kLockName);
    return State::cannot;
  }
  write_owner(file.get(), owner_);
  file_ = file.release();
  return State::ours;
}

FolderLock::State FolderLock::take(const char* folder) {
  const Fd fd(open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (fd.is_open()) return take(fd.get());
  text_.printf("%s: %s", folder, errno_text(errno));
  return State::cannot;
}

}  // namespace slabd::hal
