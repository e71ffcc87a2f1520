// SPDX-License-Identifier: Apache-2.0
//
// A long export that is stopped (Ctrl-C, a time limit) leaves nothing behind: neither a partial file under the final
// name nor a temporary file of hundreds of megabytes.
#include "base/durable.h"

#include <fcntl.h>
#include <pwd.h>
#include <sha256.h>
#include <signal.h>
#include <stdio_ext.h>
#include <sys/file.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <vector>

namespace slabd {
namespace {

Error cannot(const char* what, const std::string& path) {
  return error(Code::journal_write, "cannot %s %s: %s", what, path.c_str(), std::strerror(errno));
}

std::string folder_of(const std::string& path) {
  const std::string folder = std::filesystem::path(path).parent_path().string();
  return folder.empty() ? "." : folder;
}

/// Path of the temporary file, for the signal handler; empty if there is none. Only one file at a time is tracked; a
/// second one is not.
std::array<char, 4096> under_way{};

constexpr std::array kStops = {SIGINT, SIGTERM, SIGHUP};

void stopped(int number) {
  if (under_way[0] != '\0') ::unlink(under_way.data());
  // SA_RESETHAND has restored the default action, so the signal now ends the process.
  ::raise(number);
}

void note_under_way(const std::string& part) {
  if (part.size() >= under_way.size() || under_way[0] != '\0') return;
  std::memcpy(under_way.data() + 1, part.c_str() + 1, part.size());
  under_way[0] = part[0];  // last, so that a handler in between sees either an empty or a complete path
  for (const int number : kStops) {
    struct sigaction now {};
    // An ignored signal (nohup) stays ignored.
    if (::sigaction(number, nullptr, &now) != 0 || now.sa_handler != SIG_DFL) continue;
    struct sigaction once {};
    once.sa_handler = stopped;
    once.sa_flags = static_cast<int>(SA_RESETHAND);
    ::sigaction(number, &once, nullptr);
  }
}

/// Ignores SIGXFSZ, so that a file size limit (ulimit -f) is reported by write() like a full disk instead of ending the
/// process.
void be_told_of_size_limits() {
  struct sigaction now {};
  if (::sigaction(SIGXFSZ, nullptr, &now) == 0 && now.sa_handler == SIG_DFL) ::signal(SIGXFSZ, SIG_IGN);
}

void no_longer_under_way(const std::string& part) {
  if (part == under_way.data()) under_way[0] = '\0';
}

/// True for the caller and root: links of root are not checked.
bool is_trusted(uid_t owner) {
  return owner == 0 || owner == ::geteuid();
}

std::string name_of(uid_t uid) {
  const struct passwd* user = ::getpwuid(uid);
  return "user " + (user != nullptr ? std::string(user->pw_name) : std::to_string(uid));
}

/// Reason why the link `at`, owned by `owner`, must not be followed; empty if it may be.
std::string why_not_followed(const std::filesystem::path& at, uid_t owner) {
  if (is_trusted(owner)) return {};
  const std::string folder = at.has_parent_path() ? at.parent_path().string() : ".";
  struct stat there {};
  const bool known = ::stat(folder.c_str(), &there) == 0;
  if (known && is_trusted(there.st_uid) && (there.st_mode & (S_IWGRP | S_IWOTH)) == 0) return {};
  return "the link " + at.string() + " belongs to " + name_of(owner) +
         ", and others than you can write to its folder: " + "it is not followed";
}

/// Resolved target of a path.
struct Target {
  std::string path;     ///< path without links; also set if the file does not exist yet
  std::string refusal;  ///< reason why a link is not followed; `path` is empty then
  int error_number = 0;
};

/// Resolves `path` name by name, as the kernel does, and checks each link on the way.
Target target_of(const std::string& path) {
  namespace fs = std::filesystem;
  constexpr int kLinksMax = 40;  // the kernel's limit
  int links = 0;
  fs::path done;
  std::vector<fs::path> names;
  const auto push = [&names](const fs::path& more) {
    std::vector<fs::path> parts(more.begin(), more.end());
    names.insert(names.end(), parts.rbegin(), parts.rend());
  };
  push(path);
  while (!names.empty()) {
    const fs::path at = done / names.back();  // operator/ drops `done` if the name is absolute
    names.pop_back();
    struct stat there {};
    if (::lstat(at.c_str(), &there) != 0 || !S_ISLNK(there.st_mode)) {
      done = at;
      continue;
    }
    if (++links > kLinksMax) return {{}, {}, ELOOP};
    if (std::string why = why_not_followed(at, there.st_uid); !why.empty()) return {{}, std::move(why), EACCES};
    std::error_code fault;
    const fs::path next = fs::read_symlink(at, fault);
    if (fault) return {{}, {}, fault.value()};
    push(next);
  }
  return {done.string(), {}, 0};
}

bool same_file(const struct stat& a, const struct stat& b) {
  return a.st_dev == b.st_dev && a.st_ino == b.st_ino;
}

/// Descriptor of this program that refers to this very file, such as /dev/stdout after `> file`; -1 if none. Replacing
/// that file would detach the shell's output from it and lose what `>>` had kept.
int own_descriptor(const struct stat& there) {
  for (const int fd : {STDOUT_FILENO, STDERR_FILENO}) {
    struct stat mine {};
    if (::fstat(fd, &mine) == 0 && same_file(mine, there)) return fd;
  }
  return -1;
}

/// Returns a suffix such as "-k3x9qa". Collisions are unlikely, and O_EXCL rejects them.
std::string random_suffix() {
  constexpr std::string_view kLetters = "abcdefghijklmnopqrstuvwxyz0123456789";
  std::array<unsigned char, 6> bytes{};
  if (::getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) return {};
  std::string text = "-";
  for (const unsigned char byte : bytes) text += kLetters[byte % kLetters.size()];
  return text;
}

}  // namespace

OutFile::OutFile(std::string path, Kind kind) : path_(std::move(path)), kind_(kind) {
  if (!kind_.of_slabd && path_ != "-") {
    Target target = target_of(path_);
    error_number_ = target.error_number;
    refusal_ = std::move(target.refusal);
    target_ = std::move(target.path);
    if (error_number_ != 0) return;
  }
  bool is_shared = false;  // other processes write into it too, so its start must not be overwritten
  if (kind_.of_slabd) {
    open_part();
  } else if (path_ == "-") {
    file_ = stdout;
    is_shared = true;
  } else if (struct stat there{}; ::stat(path_.c_str(), &there) != 0) {
    if (errno == ENOENT)
      open_part();
    else
      error_number_ = errno;
  } else if (S_ISREG(there.st_mode)) {
    if (const int fd = own_descriptor(there); fd < 0) {
      open_part();
    } else {
      is_shared = true;
      const int copy = ::fcntl(fd, F_DUPFD_CLOEXEC, 0);
      file_ = copy < 0 ? nullptr : ::fdopen(copy, "wb");
      if (file_ == nullptr) error_number_ = errno;
    }
  } else if (S_ISFIFO(there.st_mode) || S_ISCHR(there.st_mode)) {
    const int fd = ::open(path_.c_str(), O_WRONLY | O_NOCTTY | O_CLOEXEC);
    file_ = fd < 0 ? nullptr : ::fdopen(fd, "wb");
    if (file_ == nullptr) error_number_ = errno;
  } else {
    error_number_ = S_ISDIR(there.st_mode) ? EISDIR : ENOTSUP;
  }
  if (error_number_ == 0 && kind_.rewritten && (is_shared || ::lseek(::fileno(file_), 0, SEEK_CUR) < 0))
    error_number_ = ESPIPE;
}

void OutFile::open_part() {
  if (kind_.of_slabd) target_ = path_;
  constexpr int kTriesMax = 100;
  int fd = -1;
  for (int i = 0; i < kTriesMax && fd < 0; ++i) {
    part_ = target_ + ".part" + random_suffix();
    fd = ::open(part_.c_str(), O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, kind_.mode.value_or(0666));
    if (fd < 0 && errno != EEXIST) break;
  }
  if (fd < 0) {
    error_number_ = errno;
    part_.clear();
    return;
  }
  note_under_way(part_);
  be_told_of_size_limits();
  // fchmod, because the umask would remove the group's write permission.
  if (kind_.mode && ::fchmod(fd, *kind_.mode) != 0) error_number_ = errno;
  file_ = ::fdopen(fd, "wb");
  if (file_ != nullptr) return;
  error_number_ = errno;
  ::close(fd);
}

OutFile::~OutFile() {
  if (file_ != nullptr && file_ != stdout) std::fclose(file_);
  if (part_.empty()) return;
  ::unlink(part_.c_str());
  no_longer_under_way(part_);
}

void OutFile::write(const void* bytes, std::size_t count) {
  if (error_number_ != 0) return;
  if (std::fwrite(bytes, 1, count, file_) != count) error_number_ = errno;
}

void OutFile::write_at_start(std::string_view text) {
  if (error_number_ == 0 && std::fseek(file_, 0, SEEK_SET) != 0) error_number_ = errno;
  write(text);
}

/// Flushes all data and moves the file to its final name.
void OutFile::finish() {
  const bool is_stdout = file_ == stdout;
  if (error_number_ == 0 && std::fflush(file_) != 0) error_number_ = errno;
  if (error_number_ == 0 && kind_.synced && !part_.empty() && ::fsync(::fileno(file_)) != 0) error_number_ = errno;
  if (file_ != nullptr && file_ != stdout && std::fclose(file_) != 0 && error_number_ == 0) error_number_ = errno;
  file_ = nullptr;
  if (is_stdout && std::ferror(stdout) != 0) {
    // `close` reports the error; the exit handler must not write the rest or report it again.
    ::__fpurge(stdout);
    std::clearerr(stdout);
  }
  if (part_.empty()) return;
  if (error_number_ == 0 && std::rename(part_.c_str(), target_.c_str()) != 0) error_number_ = errno;
  if (error_number_ != 0) ::unlink(part_.c_str());
  no_longer_under_way(part_);
  part_.clear();
}

Status OutFile::close(Code code) {
  const bool replaces = !part_.empty();
  if (file_ != nullptr || replaces) finish();
  if (kind_.rewritten && error_number_ == ESPIPE)
    return error(code, "%s cannot be written: it must be a separate file, because its head is written last",
                 path_ == "-" ? "standard output" : path_.c_str());
  if (!refusal_.empty()) return error(code, "%s cannot be written: %s", path_.c_str(), refusal_.c_str());
  if (error_number_ != 0) return error(code, "%s cannot be written: %s", path_.c_str(), std::strerror(error_number_));
  return replaces && kind_.synced ? sync_folder(folder_of(target_)) : success();
}

Status check_links(const std::string& path) {
  const Target target = target_of(path);
  if (!target.refusal.empty()) return error(Code::config, "%s: %s", path.c_str(), target.refusal.c_str());
  if (target.error_number != 0) return error(Code::config, "%s: %s", path.c_str(), std::strerror(target.error_number));
  return success();
}

Status sync_folder(const std::string& path) {
  const Fd folder(::open(path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!folder.is_open() || ::fsync(folder.get()) != 0) return cannot("sync the folder", path);
  return success();
}

Status rename_durably(const std::string& from, const std::string& to) {
  if (std::rename(from.c_str(), to.c_str()) != 0) return cannot("make", to);
  return sync_folder(folder_of(to));
}

Status write_durably(const std::string& path, std::string_view text, mode_t mode) {
  OutFile file(path, {.synced = true, .of_slabd = true, .mode = mode});
  file.write(text);
  return file.close(Code::journal_write);
}

Status copy_synced(const std::string& from, const std::string& to) {
  const Fd source(::open(from.c_str(), O_RDONLY | O_CLOEXEC));
  if (!source.is_open()) return cannot("read", from);
  struct stat info {};
  if (::fstat(source.get(), &info) != 0 || !S_ISREG(info.st_mode))
    return error(Code::journal_write, "%s is not a file", from.c_str());
  Fd target(::open(to.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0664));
  if (!target.is_open()) return cannot("write", to);
  for (;;) {
    const ssize_t n = ::copy_file_range(source.get(), nullptr, target.get(), nullptr, std::size_t{1} << 26U, 0);
    if (n == 0) break;
    if (n > 0 || errno == EINTR) continue;
    if (errno != EXDEV && errno != EINVAL && errno != ENOSYS && errno != EOPNOTSUPP) return cannot("write", to);
    // copy_file_range is not supported between these two file systems: copy the rest with read and write.
    std::vector<char> piece(std::size_t{1} << 20U);
    for (ssize_t got = 0; (got = ::read(source.get(), piece.data(), piece.size())) != 0;) {
      if (got < 0 && errno == EINTR) continue;
      if (got < 0) return cannot("read", from);
      if (!write_all(target.get(), piece.data(), static_cast<std::size_t>(got))) return cannot("write", to);
    }
    break;
  }
  if (::fsync(target.get()) != 0 || ::close(target.release()) != 0) return cannot("write", to);
  return success();
}

Result<FileDigest> digest_of(const std::string& path) {
  std::array<char, SHA256_DIGEST_STRING_LENGTH> hex{};
  struct stat info {};
  if (::stat(path.c_str(), &info) != 0 || SHA256File(path.c_str(), hex.data()) == nullptr) return cannot("read", path);
  return FileDigest{static_cast<std::uint64_t>(info.st_size), hex.data()};
}

bool FileLock::take(const std::string& path) {
  fd_ = Fd(::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0664));
  if (!fd_.is_open()) return false;
  // For the group, independent of the umask; only the owner can change the mode.
  static_cast<void>(::fchmod(fd_.get(), 0664));
  if (::flock(fd_.get(), LOCK_EX | LOCK_NB) == 0) return true;
  fd_.reset();
  return false;
}

}  // namespace slabd
