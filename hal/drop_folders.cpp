// SPDX-License-Identifier: Apache-2.0
#include "hal/drop_folders.h"

#include <dirent.h>
#include <fcntl.h>
#include <stdio.h>
#include <sys/stat.h>
#include <sys/vfs.h>

#include <algorithm>
#include <array>
#include <cerrno>

namespace slabd::hal {
namespace {

/// Calls `use(name)` for each entry but "." and ".." until it returns false. opendir() would allocate.
template <typename Use>
bool for_each_name(int folder, Use use) {
  if (lseek(folder, 0, SEEK_SET) < 0) return false;
  alignas(dirent64) std::array<char, 8192> buffer;
  for (;;) {
    const ssize_t filled = getdents64(folder, buffer.data(), buffer.size());
    if (filled <= 0) return filled == 0;
    for (ssize_t at = 0; at < filled;) {
      const auto* entry = reinterpret_cast<const dirent64*>(&buffer[static_cast<std::size_t>(at)]);
      const std::string_view name(entry->d_name);
      if (name != "." && name != ".." && !use(entry->d_name)) return true;
      at += entry->d_reclen;
    }
  }
}

Error offline(const PathText& drop_dir, const char* folder, int error_number) {
  return error(Code::scanner_offline, "%s/%s: %s", drop_dir.c_str(), folder, errno_text(error_number));
}

/// File systems whose files another computer may change. FUSE is among them: most of what is mounted so comes over a
/// network, and what does not loses a second and a half.
bool is_network(int folder) {
  constexpr std::array<std::uint32_t, 9> kNetwork = {
      0x6969,                  // NFS
      0x517B,     0xFE534D42,  // SMB: smbfs, cifs since 3.0
      0xFF534D42,              // cifs
      0x65735546,              // FUSE: sshfs, ...
      0x01021997,              // 9p, virtio shares
      0x00C36400,              // Ceph
      0x5346414F, 0x6B414653,  // AFS
  };
  struct statfs status {};
  if (fstatfs(folder, &status) != 0) return true;
  const auto type = static_cast<std::uint32_t>(status.f_type);
  return std::find(kNetwork.begin(), kNetwork.end(), type) != kNetwork.end();
}

constexpr mode_t kOursAndOurGroups = 02770;

/// Opens a folder below `parent`; one that is missing is made, for us and our group (the scanner software's user).
Status open_folder(const PathText& drop_dir, int parent, const char* name, Fd& fd) {
  const bool made = mkdirat(parent, name, 0770) == 0;
  if (!made && errno != EEXIST) return offline(drop_dir, name, errno);
  fd = Fd(openat(parent, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
  if (!fd.is_open()) return offline(drop_dir, name, errno);
  if (made && fchmod(fd.get(), kOursAndOurGroups) != 0 && !is_network(fd.get())) return offline(drop_dir, name, errno);
  if (faccessat(parent, name, R_OK | W_OK | X_OK, AT_EACCESS) != 0) return offline(drop_dir, name, errno);
  return success();
}

bool describe_entry(int folder, const char* name, InboxEntry& entry) {
  entry.state = file_state(folder, name);
  if (!entry.state.known) return false;  // gone since it was listed
  entry.name.assign(name);
  entry.regular = S_ISREG(entry.state.mode);
  return true;
}

/// A file renamed while the folder is read can show under both names.
bool listed(const InboxEntries& entries, const InboxEntry& entry) {
  for (const InboxEntry& other : entries)
    if (other.state.device == entry.state.device && other.state.inode == entry.state.inode) return true;
  return false;
}

/// rename() that never replaces. File systems without that (some network shares) get a look before the leap.
bool move_new(int from, const char* name, int to, const char* new_name) {
  if (renameat2(from, name, to, new_name, RENAME_NOREPLACE) == 0) return true;
  if (errno != EINVAL && errno != ENOSYS) return false;
  struct stat status {};
  if (fstatat(to, new_name, &status, AT_SYMLINK_NOFOLLOW) == 0) {
    errno = EEXIST;
    return false;
  }
  return renameat(from, name, to, new_name) == 0;
}

bool write_text(int fd, std::string_view text) {
  return write(fd, text.data(), text.size()) == static_cast<ssize_t>(text.size());
}

}  // namespace

void DropFolders::make_drop_dir() const {
  mkdir(drop_dir_.c_str(), kOursAndOurGroups);
}

Status DropFolders::open() {
  drop_ = Fd(::open(drop_dir_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!drop_.is_open())
    return error(Code::scanner_offline, "%s: %s%s", drop_dir_.c_str(), errno_text(errno),
                 errno == ENOENT ? " (the drop folder must exist)" : "");
  if (Status status = open_folder(drop_dir_, drop_.get(), "request", request_); !status) return status;
  if (Status status = open_folder(drop_dir_, drop_.get(), "inbox", inbox_); !status) return status;
  on_network_ = is_network(inbox_.get());
  return open_folder(drop_dir_, drop_.get(), "stray", stray_);
}

Status DropFolders::list_inbox(std::string_view first, InboxEntries& entries) const {
  entries.clear();
  // A share's kernel lists a folder as it remembers it, unless it knows that it has changed: asking makes it know.
  if (on_network_ && !file_state(inbox_.get(), "").known) return offline(drop_dir_, "inbox", errno);
  const auto collect = [&](bool wanted_first) {
    return for_each_name(inbox_.get(), [&](const char* name) {
      const bool is_first = !first.empty() && std::string_view(name).substr(0, first.size()) == first;
      InboxEntry entry;
      if (is_first != wanted_first || !describe_entry(inbox_.get(), name, entry) || listed(entries, entry)) return true;
      return entries.push(entry);
    });
  };
  if (!first.empty() && !collect(true)) return offline(drop_dir_, "inbox", errno);
  if (!collect(false)) return offline(drop_dir_, "inbox", errno);
  return success();
}

bool DropFolders::set_aside(const char* name) const {
  constexpr int kNamesTried = 10'000;
  if (move_new(inbox_.get(), name, stray_.get(), name)) return true;
  for (int number = 1; errno == EEXIST && number <= kNamesTried; ++number) {
    NameText other;
    other.printf("%.240s.%d", name, number);
    if (move_new(inbox_.get(), name, stray_.get(), other.c_str())) return true;
  }
  return false;
}

DropFolders::Trimmed DropFolders::trim_stray(std::uint64_t bytes_max) const {
  Trimmed oldest;
  timespec oldest_moved{};
  const bool listed_all = for_each_name(stray_.get(), [&](const char* name) {
    struct stat status {};
    if (fstatat(stray_.get(), name, &status, AT_SYMLINK_NOFOLLOW) != 0 || S_ISDIR(status.st_mode)) return true;
    oldest.held += static_cast<std::uint64_t>(status.st_size);
    // The change time is when it was moved here, by the file system's own clock; what the scanner's computer wrote
    // into the file's time does not matter.
    const timespec moved = status.st_ctim;
    if (oldest.name.empty() || moved.tv_sec < oldest_moved.tv_sec ||
        (moved.tv_sec == oldest_moved.tv_sec && moved.tv_nsec < oldest_moved.tv_nsec)) {
      oldest.name.assign(name);
      oldest.bytes = static_cast<std::uint64_t>(status.st_size);
      oldest_moved = moved;
    }
    return true;
  });
  if (!listed_all || oldest.held <= bytes_max || oldest.name.empty()) return oldest;
  const bool deleted = unlinkat(stray_.get(), oldest.name.c_str(), 0) == 0;
  oldest.what = deleted ? Trimmed::What::deleted : Trimmed::What::failed;
  if (!deleted) oldest.error_number = errno;
  return oldest;
}

Status DropFolders::post_request(const char* name, std::string_view text) const {
  constexpr mode_t kReadableByScanner = 0664;
  NameText temporary;
  temporary.printf(".%s.tmp", name);
  Fd fd(openat(request_.get(), temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW | O_CLOEXEC, 0664));
  // On a share its server says who may read what, and some refuse to be told.
  const bool readable = fd.is_open() && (fchmod(fd.get(), kReadableByScanner) == 0 || on_network_);
  if (readable && write_text(fd.get(), text) && renameat(request_.get(), temporary.c_str(), request_.get(), name) == 0)
    return success();
  const int why = errno;
  if (fd.is_open()) unlinkat(request_.get(), temporary.c_str(), 0);
  if (why == ENOSPC || why == EDQUOT)
    return error(Code::store_full, "%s/request/%s: %s", drop_dir_.c_str(), name, errno_text(why));
  return offline(drop_dir_, "request", why);
}

void DropFolders::withdraw_request(const char* name) const {
  unlinkat(request_.get(), name, 0);
}

std::size_t DropFolders::withdraw_all_requests() const {
  std::size_t count = 0;
  for_each_name(request_.get(), [&](const char* name) {
    if (unlinkat(request_.get(), name, 0) == 0) ++count;
    return true;
  });
  return count;
}

}  // namespace slabd::hal
