// SPDX-License-Identifier: Apache-2.0
#include "hal/system/spool.h"

#include <fcntl.h>
#include <stdio.h>
#include <sys/stat.h>

#include <array>
#include <cerrno>

#include "base/os.h"

// The order of operations matters: sync contents before names, a name before its folder, and new folders before their
// parents. Only then may the scan be reported as safe.
namespace slabd::hal {
namespace {

Error spool_error(const PathText& path, const char* what, int error_number) {
  if (error_number == EEXIST)
    return error(
        Code::journal_write,
        "%s: this scan exists already, and no scan is overwritten: did an older database replace the line's "
        "(OPERATING.md, slabctl db restore)? Otherwise slabd was ended while it stored this one: give SCAN again",
        path.c_str());
  const bool full = error_number == ENOSPC || error_number == EDQUOT;
  return error(full ? Code::store_full : Code::journal_write, "%s: %s: %s", path.c_str(), what,
               errno_text(error_number));
}

/// The folder part of a path; "." when it has none.
PathText folder_of(const PathText& path) {
  const std::size_t slash = path.view().rfind('/');
  if (slash == std::string_view::npos) return ".";
  return path.view().substr(0, slash == 0 ? 1 : slash);
}

/// As renameat(), but EEXIST if a file has that name. If this database replaced another one, that file may be the only
/// copy of an unknown scan.
int rename_to_new(int from_folder, const char* from, const char* path) {
  if (renameat2(from_folder, from, AT_FDCWD, path, RENAME_NOREPLACE) == 0) return 0;
  if (errno != EINVAL && errno != ENOSYS) return -1;
  // A file system without this flag (a share). Only this daemon writes into its spool, so checking first is sufficient.
  if (faccessat(AT_FDCWD, path, F_OK, AT_SYMLINK_NOFOLLOW) == 0) {
    errno = EEXIST;
    return -1;
  }
  return renameat(from_folder, from, AT_FDCWD, path);
}

bool sync_folder(const PathText& folder) {
  const Fd fd(open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  return fd.is_open() && fsync(fd.get()) == 0;
}

/// Creates every missing folder on the way to `path`, each durable before the next.
Status make_folders(const PathText& path) {
  const std::string_view whole = path.view();
  for (std::size_t slash = whole.find('/', 1); slash != std::string_view::npos; slash = whole.find('/', slash + 1)) {
    const PathText folder(whole.substr(0, slash));
    if (mkdir(folder.c_str(), 0750) == 0) {
      if (!sync_folder(folder_of(folder))) return spool_error(folder, "syncing its parent", errno);
    } else if (errno != EEXIST) {
      return spool_error(folder, "making the folder", errno);
    }
  }
  return success();
}

bool is_same_file(int fd, const PathText& path) {
  struct stat opened {};
  struct stat named {};
  return fstat(fd, &opened) == 0 && lstat(path.c_str(), &named) == 0 && opened.st_dev == named.st_dev &&
         opened.st_ino == named.st_ino;
}

enum class Copied : std::uint8_t { all, unreadable, unwritable };

Copied copy_bytes(int from, int to) {
  std::array<char, limits::kScanReadBytes> piece;
  off_t offset = 0;
  for (;;) {
    const ssize_t n = pread(from, piece.data(), piece.size(), offset);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return n == 0 ? Copied::all : Copied::unreadable;
    if (!write_all(to, piece.data(), static_cast<std::size_t>(n))) return Copied::unwritable;
    offset += n;
  }
}

/// Path of a scan while it is incomplete.
FixedString<limits::kPathBytes + 8> working_name(const PathText& path) {
  FixedString<limits::kPathBytes + 8> working(path.view());
  working.append(".part");
  return working;
}

/// Copies to another file system, or a file that has other names: a whole, synced copy under a working name first, then
/// the rename. The source file system may be a share: its own copy need not be durable, reading it can fail, and
/// another computer may write to it.
Status copy_across(int fd, int from_folder, const char* name, const PathText& path) {
  const auto working = working_name(path);
  {
    const FileState before = file_state(fd, "");
    const Fd copy(open(working.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW | O_CLOEXEC, 0640));
    if (!copy.is_open()) return spool_error(path, "creating", errno);
    const Copied copied = copy_bytes(fd, copy.get());
    if (copied == Copied::unreadable || !file_state(fd, "").same_content(before)) {
      const int why = errno;
      unlink(working.c_str());
      return error(Code::frame_incomplete, "%s: %s", name,
                   copied == Copied::unreadable ? errno_text(why) : "changed while it was copied");
    }
    if (copied != Copied::all || fsync(copy.get()) != 0 ||
        rename_to_new(AT_FDCWD, working.c_str(), path.c_str()) != 0) {
      const int why = errno;
      unlink(working.c_str());
      return spool_error(path, "copying", why);
    }
  }
  unlinkat(from_folder, name, 0);
  return success();
}

/// True if the file can be renamed into the folder. That requires one file system. A file with another name (a hard
/// link into the inbox) is copied. Otherwise a program could overwrite it in the spool with the next block's scan.
bool can_be_moved(int fd, const PathText& folder) {
  struct stat there {};
  struct stat here {};
  return fstat(fd, &there) == 0 && stat(folder.c_str(), &here) == 0 && there.st_dev == here.st_dev &&
         there.st_nlink <= 1;
}

Status move_file(int fd, int from_folder, const char* name, const PathText& path) {
  if (rename_to_new(from_folder, name, path.c_str()) != 0) {
    const int why = errno;
    if (why == EXDEV) return copy_across(fd, from_folder, name, path);
    if (why == ENOENT && faccessat(from_folder, name, F_OK, AT_SYMLINK_NOFOLLOW) != 0)
      return error(Code::frame_incomplete, "%s: was removed while it was read", name);
    return spool_error(path, "moving the scan", why);
  }
  if (is_same_file(fd, path)) return success();
  unlink(path.c_str());
  return error(Code::frame_incomplete, "%s: was replaced while it was read", name);
}

}  // namespace

Status spool_file(int fd, int from_folder, const char* name, const PathText& path) {
  if (Status status = make_folders(path); !status) return status;
  if (!can_be_moved(fd, folder_of(path))) {
    if (Status status = copy_across(fd, from_folder, name, path); !status) return status;
    if (sync_folder(folder_of(path))) return success();
    const int why = errno;
    unlink(path.c_str());
    return spool_error(path, "syncing the folder", why);
  }
  if (fsync(fd) != 0) return spool_error(path, "syncing the scan", errno);
  if (Status status = move_file(fd, from_folder, name, path); !status) return status;
  // The old name's folder is synced too; otherwise after a power cut the scan could appear under both names.
  const bool new_name_safe = sync_folder(folder_of(path));
  const bool old_name_gone = fsync(from_folder) == 0 || errno == EINVAL;  // EINVAL: a share without fsync
  if (!new_name_safe || !old_name_gone) {
    const int why = errno;
    unlink(path.c_str());
    return spool_error(path, "syncing the folder", why);
  }
  return success();
}

Status SpoolWriter::begin(const PathText& path) {
  abandon();
  if (Status status = make_folders(path); !status) return status;
  // finish() would fail too; failing here saves the transfer.
  if (faccessat(AT_FDCWD, path.c_str(), F_OK, AT_SYMLINK_NOFOLLOW) == 0) return spool_error(path, "creating", EEXIST);
  fd_ = Fd(open(working_name(path).c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW | O_CLOEXEC, 0640));
  if (!fd_.is_open()) return spool_error(path, "creating", errno);
  path_ = path;
  return success();
}

Status SpoolWriter::write(std::span<const std::byte> bytes) {
  if (write_all(fd_.get(), bytes.data(), bytes.size())) return success();
  return spool_error(path_, "writing the scan", errno);
}

Status SpoolWriter::finish() {
  const auto working = working_name(path_);
  if (fsync(fd_.get()) != 0 || rename_to_new(AT_FDCWD, working.c_str(), path_.c_str()) != 0) {
    const Error why = spool_error(path_, "syncing the scan", errno);
    abandon();
    return why;
  }
  fd_.reset();
  if (sync_folder(folder_of(path_))) return success();
  const Error why = spool_error(path_, "syncing the folder", errno);
  unlink(path_.c_str());
  return why;
}

void SpoolWriter::abandon() {
  if (!fd_.is_open()) return;
  fd_.reset();
  unlink(working_name(path_).c_str());
}

}  // namespace slabd::hal
