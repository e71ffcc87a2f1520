// SPDX-License-Identifier: Apache-2.0
//
// Problem: another program (sqlite3 in a terminal, a backup script) holds a transaction open, and every commit fails.
// Idea: F_GETLK names the process that holds a conflicting lock; /proc/locks would as well, but the service does not
// see it (ProcSubset=pid). The bytes are those of SQLite's file formats: sqlite.org/fileformat2.html 3.2 and
// sqlite.org/walformat.html 2.3.
#include "storage/files/lock_probe.h"

#include <fcntl.h>
#include <unistd.h>

#include <fstream>

#include "storage/storage.h"

namespace slabd::storage {
namespace {

/// Of the database file: PENDING, RESERVED, and the range of SHARED. A reader holds a shared lock, and keeps nobody
/// out.
constexpr std::int64_t kPendingByte = 0x40000000;
constexpr std::int64_t kReservedByte = kPendingByte + 1;
/// Of the index of the log: WAL_WRITE_LOCK.
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
    probed.fd = open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW);  // the one before stays open, see the header
    probed.file = now;
  }
  if (probed.fd < 0) return 0;
  struct flock lock {};
  lock.l_type = F_RDLCK;  // conflicts with write locks alone
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
  // SHARED's range follows RESERVED; an exclusive lock covers all of it.
  constexpr std::int64_t kSharedSize = 510;
  std::int64_t pid = owner_of(probed_[1], db_path + "-shm", kLogWriteByte, kLogWriteByte);
  if (pid == 0) pid = owner_of(probed_[0], db_path, kPendingByte, kReservedByte + kSharedSize);
  return pid == 0 ? std::string() : process_words(pid);
}

}  // namespace slabd::storage
