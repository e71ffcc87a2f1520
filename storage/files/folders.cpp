// SPDX-License-Identifier: Apache-2.0
#include "storage/files/folders.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "storage/storage.h"

namespace slabd::storage {
namespace {

// The group may read; only the owner may write.
constexpr mode_t kFolderMode = 02750;
constexpr mode_t kFileMode = 0640;
// The lock file is not readable for the group: a process that can open a file can lock it, and slabd would not start.
constexpr mode_t kLockMode = 0600;

Status trouble(const char* doing, const std::string& path) {
  return error(errno == ENOSPC ? Code::store_full : Code::journal_write, "%s %s: %s", doing, path.c_str(),
               std::strerror(errno));
}

/// Gives a file created by root to the owner of its folder, so that slabd can write it later.
bool give_to_owner(int fd, const std::string& folder) {
  struct stat there {};
  if (geteuid() != 0) return true;
  if (stat(folder.empty() ? "." : folder.c_str(), &there) != 0) return false;
  return fchown(fd, there.st_uid, there.st_gid) == 0;
}

}  // namespace

Status make_folder(const std::string& path) {
  struct stat there {};
  if (stat(path.c_str(), &there) == 0) {
    if (S_ISDIR(there.st_mode)) return success();
    return error(Code::journal_write, "%s is not a folder", path.c_str());
  }
  const std::string parent = std::filesystem::path(path).parent_path().string();
  if (!parent.empty() && parent != path)
    if (Status status = make_folder(parent); !status.ok()) return status;
  if (mkdir(path.c_str(), kFolderMode) != 0 && errno != EEXIST) return trouble("cannot make folder", path);
  // mkdir applies the umask, and inherits the set-group-id bit only from the parent. A service that may not set that
  // bit (RestrictSUIDSGID) still has its group on new files.
  if (geteuid() == 0) {
    const Fd folder(open(path.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
    if (!folder.is_open() || !give_to_owner(folder.get(), parent))
      return trouble("cannot give to the owner of its parent", path);
  }
  const bool right = stat(path.c_str(), &there) == 0 && (there.st_mode & 07777U) == kFolderMode;
  if (!right && chmod(path.c_str(), kFolderMode) != 0 && chmod(path.c_str(), kFolderMode & 0777U) != 0)
    return trouble("cannot set mode 2750 of folder", path);
  // Files in this folder are durable only if the folder itself is.
  return sync_file(parent);
}

Status check_writable(const std::string& path) {
  if (faccessat(AT_FDCWD, path.c_str(), W_OK | X_OK, AT_EACCESS) == 0) return success();
  // A service may be restricted to other paths than the user who looks for the cause.
  const char* hint =
      errno == EROFS ? " (a service writes only to ReadWritePaths= of its unit; systemctl edit slabd)" : "";
  return error(Code::journal_write, "cannot write in %s: %s%s", path.c_str(), std::strerror(errno), hint);
}

Status create_file(const std::string& path) {
  const Fd file(open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, kFileMode));
  if (!file.is_open()) return errno == EEXIST ? success() : trouble("cannot create", path);
  const std::string folder = std::filesystem::path(path).parent_path().string();
  if (!give_to_owner(file.get(), folder) || fchmod(file.get(), kFileMode) != 0)
    return trouble("cannot set owner and mode 0640 of", path);
  return sync_file(folder);
}

void close_to_writers(const std::string& path) {
  constexpr mode_t kNotForOthers = 0027;
  struct stat there {};
  if (lstat(path.c_str(), &there) != 0 || !S_ISREG(there.st_mode) || (there.st_mode & kNotForOthers) == 0) return;
  if (there.st_uid == geteuid()) (void)chmod(path.c_str(), there.st_mode & 07777U & ~kNotForOthers);
}

Status sync_file(const std::string& path) {
  const Fd file(open(path.empty() ? "." : path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!file.is_open()) return trouble("cannot open", path);
  return fsync(file.get()) == 0 ? success() : trouble("cannot sync", path);
}

Status rename_file(const std::string& from, const std::string& to) {
  if (rename(from.c_str(), to.c_str()) == 0) return success();
  return trouble(("cannot rename " + from + " to").c_str(), to);
}

std::string in_real_folder(const std::string& path) {
  namespace fs = std::filesystem;
  const fs::path parent = fs::path(path).parent_path();
  std::error_code ec;
  const fs::path real = fs::canonical(parent.empty() ? fs::path(".") : parent, ec);
  if (ec || real == fs::absolute(parent.empty() ? fs::path(".") : parent, ec).lexically_normal()) return path;
  return (real / fs::path(path).filename()).string();
}

Result<std::uint64_t> free_bytes(const std::string& path) {
  struct statvfs disk {};
  if (statvfs(path.c_str(), &disk) != 0)
    return error(Code::journal_write, "cannot read the free space of %s: %s", path.c_str(), std::strerror(errno));
  return static_cast<std::uint64_t>(disk.f_bavail) * disk.f_frsize;
}

bool share_a_disk(const std::string& folder, const std::string& other) {
  struct stat a {};
  struct stat b {};
  struct statvfs room_a {};
  struct statvfs room_b {};
  if (stat(folder.c_str(), &a) != 0 || stat(other.c_str(), &b) != 0 || statvfs(folder.c_str(), &room_a) != 0 ||
      statvfs(other.c_str(), &room_b) != 0)
    return true;
  // Subvolumes have their own device numbers, but the same free-space figures.
  return a.st_dev == b.st_dev || (room_a.f_frsize == room_b.f_frsize && room_a.f_blocks == room_b.f_blocks);
}

Status check_room(const std::string& folder, std::uint64_t bytes, const char* what) {
  const std::string where = folder.empty() ? "." : folder;
  const Result<std::uint64_t> room = free_bytes(where);
  if (!room.ok()) return room.error();
  if (room.value() >= bytes) return success();
  return error(Code::store_full, "%s needs %.1f MB free, and %s has %.1f MB", what, static_cast<double>(bytes) / 1e6,
               where.c_str(), static_cast<double>(room.value()) / 1e6);
}

std::int64_t file_bytes(const std::string& path) {
  struct stat there {};
  if (lstat(path.c_str(), &there) != 0 || !S_ISREG(there.st_mode)) return 0;
  return there.st_size;
}

std::optional<FileId> file_id(const std::string& path) {
  struct stat there {};
  if (lstat(path.c_str(), &there) != 0 || !S_ISREG(there.st_mode)) return std::nullopt;
  return FileId{there.st_dev, there.st_ino};
}

bool lies_below(const std::string& path, const std::string& folder) {
  if (folder.empty() || !path.starts_with(folder)) return false;
  const std::string rest = path.substr(folder.size());
  if (folder.back() != '/' && !rest.starts_with('/')) return false;
  for (const auto& part : std::filesystem::path(rest))
    if (part == ".." || part == ".") return false;
  return rest.find_first_not_of('/') != std::string::npos;
}

Status WriterLock::take(const std::string& db_path) {
  const std::string path = db_path + ".writer";
  fd_ = Fd(open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, kLockMode));
  if (!fd_.is_open()) return trouble("cannot open", path);
  // A file created by root could not be opened by slabd; another user's file is unchanged.
  (void)give_to_owner(fd_.get(), std::filesystem::path(path).parent_path().string());
  (void)fchmod(fd_.get(), kLockMode);
  if (flock(fd_.get(), LOCK_EX | LOCK_NB) == 0) {
    // Stores the pid for the error message of the next process. A failure is ignored.
    const std::string self = std::to_string(getpid());
    if (ftruncate(fd_.get(), 0) == 0) (void)!pwrite(fd_.get(), self.data(), self.size(), 0);
    return success();
  }
  if (errno == EWOULDBLOCK) {
    std::array<char, 24> pid{};
    (void)!pread(fd_.get(), pid.data(), pid.size() - 1, 0);
    const std::int64_t owner = std::strtoll(pid.data(), nullptr, 10);
    return error(Code::journal_write, "%s is already open for writing by another process (%s%slock %s)",
                 db_path.c_str(), owner > 0 ? process_words(owner).c_str() : "", owner > 0 ? ", " : "", path.c_str());
  }
  return trouble("cannot lock", path);
}

bool is_written_elsewhere(const std::string& db_path) {
  const Fd file(open((db_path + ".writer").c_str(), O_RDWR | O_CLOEXEC));
  if (!file.is_open()) return false;  // the database has never been opened
  return flock(file.get(), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
}

// Problem: another program (sqlite3 in a terminal, a backup script) has a transaction open, and every commit fails.
// Idea: F_GETLK returns the process with a conflicting lock. /proc/locks contains it too, but is hidden from the
// service (ProcSubset=pid). The byte offsets are from SQLite's file formats: sqlite.org/fileformat2.html 3.2 and
// sqlite.org/walformat.html 2.3.

namespace {

/// Locks of the database file: PENDING, RESERVED, and the range of SHARED. A reader holds a shared lock, which does not
/// block a writer.
constexpr std::int64_t kPendingByte = 0x40000000;
constexpr std::int64_t kReservedByte = kPendingByte + 1;
/// Lock of the log's index: WAL_WRITE_LOCK.
constexpr std::int64_t kLogWriteByte = 120;

}  // namespace

std::string process_words(std::int64_t pid) {
  if (pid <= 0) return "a process that the kernel does not name";
  std::string name;
  std::ifstream comm("/proc/" + std::to_string(pid) + "/comm");
  std::getline(comm, name);
  for (char& c : name)
    if (c < ' ' || c > '~') c = '?';
  const std::string process = "process " + std::to_string(pid);
  return name.empty() ? process : name + " (" + process + ")";
}

std::int64_t LockProbe::owner_of(Probed& probed, const std::string& path, std::int64_t first, std::int64_t last) {
  const std::optional<FileId> now = file_id(path);
  if (!now) return 0;
  if (probed.fd < 0 || probed.file != now) {
    probed.fd = open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW);  // the previous one stays open, see the header
    probed.file = now;
  }
  if (probed.fd < 0) return 0;
  struct flock lock {};
  lock.l_type = F_RDLCK;  // conflicts only with write locks
  lock.l_whence = SEEK_SET;
  lock.l_start = first;
  lock.l_len = last - first + 1;
  if (fcntl(probed.fd, F_GETLK, &lock) != 0 || lock.l_type == F_UNLCK) return 0;
  return lock.l_pid > 0 ? lock.l_pid : -1;
}

std::string foreign_lock(const std::string& db_path) {
  static LockProbe probe;
  std::string holder = probe.holder(db_path);
  return holder.starts_with("slabd (") ? std::string() : holder;
}

std::string LockProbe::holder(const std::string& db_path) {
  // The range of SHARED follows RESERVED; an exclusive lock covers all of it.
  constexpr std::int64_t kSharedSize = 510;
  std::int64_t pid = owner_of(probed_[1], db_path + "-shm", kLogWriteByte, kLogWriteByte);
  if (pid == 0) pid = owner_of(probed_[0], db_path, kPendingByte, kReservedByte + kSharedSize);
  return pid == 0 ? std::string() : process_words(pid);
}

}  // namespace slabd::storage
