// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/drop_folders.h"

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

/// Calls `use(name)` for each entry except "." and ".." until it returns false. opendir() would allocate.
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

/// True for file systems whose files another computer may change. FUSE is included, because most FUSE mounts are
/// network file systems; a local one only loses a second and a half.
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

constexpr mode_t kOursAndTheScanners = 02770;

/// A service that may not set the set-group-id bit (RestrictSUIDSGID) inherits it from the parent folder.
bool open_to_the_group(int folder) {
  struct stat status {};
  if (fstat(folder, &status) == 0 && (status.st_mode & 07777U) == kOursAndTheScanners) return true;
  return fchmod(folder, kOursAndTheScanners) == 0;
}

/// Opens a folder below `parent`. Makes a missing one, for slabd and the group of the parent (slabd-scan, which
/// includes the scanner software's user).
Status open_folder(const PathText& drop_dir, int parent, const char* name, Fd& fd) {
  const bool made = mkdirat(parent, name, 0770) == 0;
  if (!made && errno != EEXIST) return offline(drop_dir, name, errno);
  fd = Fd(openat(parent, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
  if (!fd.is_open()) return offline(drop_dir, name, errno);
  if (made && !open_to_the_group(fd.get()) && !is_network(fd.get())) return offline(drop_dir, name, errno);
  if (faccessat(parent, name, R_OK | W_OK | X_OK, AT_EACCESS) != 0) return offline(drop_dir, name, errno);
  return success();
}

bool describe_entry(int folder, const char* name, InboxEntry& entry) {
  entry.state = file_state(folder, name);
  if (!entry.state.known) return false;  // removed since it was listed
  entry.name.assign(name);
  entry.regular = S_ISREG(entry.state.mode);
  return true;
}

/// A file renamed while the folder is read can be listed under both names.
bool listed(const InboxEntries& entries, const InboxEntry& entry) {
  for (const InboxEntry& other : entries)
    if (other.state.device == entry.state.device && other.state.inode == entry.state.inode) return true;
  return false;
}

/// rename() that never replaces a file. On file systems without that (some network shares) the target is checked first.
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

/// Limits of the number appended to a name: numbers tried one after the other, and the largest number.
constexpr int kNamesTried = 2'000;
constexpr int kNumberMax = 1'000'000;
/// Entries of stray/ examined in one call: 50 ms on a local disk, some seconds on a slow share.
constexpr int kEntriesLookedAt = 2'000;
/// Depth to which nested folders are counted and deleted.
constexpr int kFoldersDeep = 4;

struct Stray {
  NameText name;
  timespec moved{};
  std::uint64_t bytes = 0;
  bool folder = false;
};

/// The change time is the time of the move to stray/, by the file system's own clock. The file's modification time
/// comes from the scanner's computer and is not used.
bool came_before(const Stray& a, const Stray& b) {
  return a.moved.tv_sec != b.moved.tv_sec ? a.moved.tv_sec < b.moved.tv_sec : a.moved.tv_nsec < b.moved.tv_nsec;
}

Fd open_inside(int parent, const char* name) {
  return Fd(openat(parent, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
}

std::uint64_t bytes_in(int folder, int deep, int& looks) {
  std::uint64_t bytes = 0;
  static_cast<void>(for_each_name(folder, [&](const char* name) {
    struct stat status {};
    if (--looks <= 0) return false;
    if (fstatat(folder, name, &status, AT_SYMLINK_NOFOLLOW) != 0) return true;
    if (!S_ISDIR(status.st_mode)) {
      bytes += static_cast<std::uint64_t>(status.st_size);
    } else if (const Fd inner = open_inside(folder, name); inner.is_open() && deep > 0) {
      bytes += bytes_in(inner.get(), deep - 1, looks);
    }
    return true;
  }));
  return bytes;
}

bool look_at(int folder, const char* name, Stray& stray, int& looks) {
  struct stat status {};
  --looks;
  if (fstatat(folder, name, &status, AT_SYMLINK_NOFOLLOW) != 0) return false;
  stray.name.assign(name);
  stray.moved = status.st_ctim;
  stray.folder = S_ISDIR(status.st_mode);
  stray.bytes = static_cast<std::uint64_t>(status.st_size);
  if (!stray.folder) return true;
  const Fd inner = open_inside(folder, name);
  stray.bytes = inner.is_open() ? bytes_in(inner.get(), kFoldersDeep, looks) : 0;
  return true;
}

/// Deletes a folder with its contents; links are deleted, not followed. On failure errno holds the reason.
bool remove_folder(int parent, const char* name, int deep, int& left) {
  {
    const Fd folder = open_inside(parent, name);
    if (!folder.is_open()) return false;
    for (bool again = true; again;) {
      again = false;
      static_cast<void>(for_each_name(folder.get(), [&](const char* inner) {
        if (--left <= 0) return false;
        const bool gone = unlinkat(folder.get(), inner, 0) == 0 || ((errno == EISDIR || errno == EPERM) && deep > 0 &&
                                                                    remove_folder(folder.get(), inner, deep - 1, left));
        again = again || gone;
        return true;
      }));
      if (left <= 0) break;
    }
  }
  return unlinkat(parent, name, AT_REMOVEDIR) == 0;
}

bool write_text(int fd, std::string_view text) {
  return write(fd, text.data(), text.size()) == static_cast<ssize_t>(text.size());
}

}  // namespace

void DropFolders::make_drop_dir() const {
  mkdir(drop_dir_.c_str(), kOursAndTheScanners);
}

Status DropFolders::open() {
  lock_state_ = FolderLock::State::ours;
  drop_ = Fd(::open(drop_dir_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!drop_.is_open())
    return error(Code::scanner_offline, "%s: %s%s", drop_dir_.c_str(), errno_text(errno),
                 errno == ENOENT ? " (the drop folder must exist)" : "");
  lock_state_ = is_locked_ ? lock_.take(drop_.get()) : FolderLock::State::ours;
  if (lock_state_ == FolderLock::State::anothers)
    return error(Code::scanner_offline, "%s is used by another daemon (%s): one at a time may", drop_dir_.c_str(),
                 lock_.text().c_str());
  if (Status status = open_folder(drop_dir_, drop_.get(), "request", request_); !status) return status;
  if (Status status = open_folder(drop_dir_, drop_.get(), "inbox", inbox_); !status) return status;
  on_network_ = is_network(inbox_.get());
  return open_folder(drop_dir_, drop_.get(), "stray", stray_);
}

Status DropFolders::list_inbox(std::string_view first, InboxEntries& entries) {
  entries.clear();
  is_crowded_ = false;
  // The kernel lists a folder of a share from its cache until it learns of a change; this call updates the cache.
  if (on_network_ && !file_state(inbox_.get(), "").known) return offline(drop_dir_, "inbox", errno);
  const auto collect = [&](bool wanted_first) {
    return for_each_name(inbox_.get(), [&](const char* name) {
      const bool is_first = !first.empty() && std::string_view(name).substr(0, first.size()) == first;
      InboxEntry entry;
      if (is_first != wanted_first || !describe_entry(inbox_.get(), name, entry) || listed(entries, entry)) return true;
      if (entries.push(entry)) return true;
      is_crowded_ = true;
      return false;
    });
  };
  if (!first.empty() && !collect(true)) return offline(drop_dir_, "inbox", errno);
  if (!collect(false)) return offline(drop_dir_, "inbox", errno);
  return success();
}

void DropFolders::for_each_in_inbox(const std::function<bool(const char*)>& use) const {
  static_cast<void>(for_each_name(inbox_.get(), use));
}

std::optional<std::int64_t> DropFolders::time_ns() const {
  constexpr const char* kName = ".time.tmp";
  unlinkat(request_.get(), kName, 0);
  const Fd fd(openat(request_.get(), kName, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600));
  if (!fd.is_open()) return std::nullopt;
  const FileState state = file_state(fd.get(), "");
  unlinkat(request_.get(), kName, 0);
  if (!state.known) return std::nullopt;
  return state.status_ns;
}

bool DropFolders::set_aside(const char* name) {
  if (move_new(inbox_.get(), name, stray_.get(), name)) return true;
  // Numbers continue from the last one; otherwise a program that always writes the same name would need all of them
  // tried.
  for (int tried = 0; errno == EEXIST && tried < kNamesTried; ++tried) {
    NameText other;
    other.printf("%.240s.%d", name, next_number_);
    next_number_ = next_number_ % kNumberMax + 1;
    if (move_new(inbox_.get(), name, stray_.get(), other.c_str())) return true;
  }
  return false;
}

bool DropFolders::trim_stray(const StrayLimits& limits, TrimmedOnes& trimmed) const {
  trimmed.clear();
  std::array<Stray, kTrimmedAtOnce> first;  // a heap, the latest on top
  std::size_t found = 0;
  std::uint64_t held = 0;
  std::size_t entries = 0;
  int looks = kEntriesLookedAt;
  const bool listed = for_each_name(stray_.get(), [&](const char* name) {
    if (looks <= 0) return false;
    Stray stray;
    if (!look_at(stray_.get(), name, stray, looks)) return true;
    held += stray.bytes;
    ++entries;
    if (found == first.size() && !came_before(stray, first[0])) return true;
    if (found == first.size())
      std::pop_heap(first.begin(), first.begin() + static_cast<std::ptrdiff_t>(found--), came_before);
    first[found++] = stray;
    std::push_heap(first.begin(), first.begin() + static_cast<std::ptrdiff_t>(found), came_before);
    return true;
  });
  if (!listed) return false;
  const bool all_seen = looks > 0;
  std::sort(first.begin(), first.begin() + static_cast<std::ptrdiff_t>(found), came_before);
  const auto too_much = [&] { return held > limits.bytes || entries > limits.entries || !all_seen; };
  for (std::size_t i = 0; i < found && too_much(); ++i) {
    Trimmed one;
    one.name = first[i].name;
    one.bytes = first[i].bytes;
    one.held = held;
    int left = kEntriesLookedAt;
    one.deleted = first[i].folder ? remove_folder(stray_.get(), one.name.c_str(), kFoldersDeep, left)
                                  : unlinkat(stray_.get(), one.name.c_str(), 0) == 0;
    if (one.deleted) {
      held -= one.bytes;
      --entries;
    } else {
      one.error_number = errno;
    }
    static_cast<void>(trimmed.push(one));  // cannot be full: at most kTrimmedAtOnce were found
  }
  const bool any_went = std::any_of(trimmed.begin(), trimmed.end(), [](const Trimmed& t) { return t.deleted; });
  return any_went && too_much();
}

Status DropFolders::post_request(const char* name, std::string_view text) const {
  constexpr mode_t kReadableByScanner = 0664;
  NameText temporary;
  temporary.printf(".%s.tmp", name);
  // Removes a leftover first: opening a pipe would wait for its reader, possibly without end.
  unlinkat(request_.get(), temporary.c_str(), 0);
  Fd fd(openat(request_.get(), temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0664));
  // On a share the server sets the permissions, and some servers reject a change.
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

void DropFolders::leave_unanswered(const char* name) const {
  if (renameat(request_.get(), name, request_.get(), kUnanswered) != 0) withdraw_request(name);
}

void DropFolders::forget_unanswered() const {
  unlinkat(request_.get(), kUnanswered, 0);
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
