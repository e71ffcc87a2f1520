// SPDX-License-Identifier: Apache-2.0
//
// The system calls are defined here, in the executable, so that the dynamic linker also uses them for libsqlite3 and
// libstdc++. Each forwards directly to the kernel. Memory-mapped writes are not recorded: only SQLite's wal-index is
// written that way, and it is rebuilt after a power cut.
#include "tests/storage/crash_disk.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdarg>
#include <cstdlib>
#include <filesystem>
#include <fstream>

namespace slabd::storage {
namespace {

using Kind = DiskChange::Kind;

struct Fault {
  bool armed = false;
  bool kills = false;
  bool with_reads = false;
  bool full = false;  ///< fails every call that would grow a file, instead of counted calls
  std::string root;
  std::uint64_t first = 0;
  std::uint64_t last = 0;
  std::uint64_t calls = 0;
  int error_number = 0;
  bool hit = false;
};

struct Watch {
  bool on = false;
  std::string root;
  DiskLog log;
  std::map<std::string, int> file_of_name;
  int files = 0;
};

/// Calls may precede the construction of this file's objects, from libraries that start earlier.
constinit bool g_in_use = false;
Watch g_watch;
Fault g_fault;
std::map<int, std::string> g_path_of_fd;  ///< for both, below any root
std::map<int, int> g_file_of_fd;

bool lies_in(const std::string& path, const std::string& root) {
  return path.size() > root.size() && path.starts_with(root) && path[root.size()] == '/';
}

bool is_watched(const std::string& path) {
  return g_watch.on && (lies_in(path, g_watch.root) || path == g_watch.root);
}

std::string below(const std::string& path) {
  return path == g_watch.root ? "" : path.substr(g_watch.root.size() + 1);
}

/// The wal-index does not have to survive.
bool is_index(const std::string& path) {
  return path.ends_with("-shm");
}

/// True if the call must fail; errno is set.
bool hits(const char* name, bool reads = false) {
  if (!g_in_use || !g_fault.armed) return false;
  const std::string path(name);
  if (!lies_in(path, g_fault.root) || (reads && !g_fault.with_reads)) return false;
  ++g_fault.calls;
  if (g_fault.full || g_fault.calls < g_fault.first || g_fault.calls > g_fault.last) return false;
  g_fault.hit = true;
  if (g_fault.kills) kill(getpid(), SIGKILL);
  errno = g_fault.error_number;
  return true;
}

bool hits_fd(int fd, bool reads = false) {
  if (!g_in_use || !g_fault.armed) return false;
  const auto at = g_path_of_fd.find(fd);
  return at != g_path_of_fd.end() && hits(at->second.c_str(), reads);
}

bool has_no_room(int fd, std::int64_t end) {
  if (!g_in_use || !g_fault.armed || !g_fault.full) return false;
  const auto at = g_path_of_fd.find(fd);
  if (at == g_path_of_fd.end() || !lies_in(at->second, g_fault.root) || is_index(at->second)) return false;
  struct stat there {};
  if (syscall(SYS_fstat, fd, &there) != 0 || end <= there.st_size) return false;
  g_fault.hit = true;
  errno = ENOSPC;
  return true;
}

void note(DiskChange change) {
  g_watch.log.changes.push_back(std::move(change));
}

DiskChange named(Kind kind, const std::string& path) {
  DiskChange change;
  change.kind = kind;
  change.path = below(path);
  return change;
}

void note_open(const char* path, int flags, int fd, bool existed) {
  const bool wanted = is_watched(path) || (g_fault.armed && lies_in(path, g_fault.root));
  if (!wanted) return;
  g_path_of_fd[fd] = path;
  if (!is_watched(path) || is_index(path)) return;
  auto at = g_watch.file_of_name.find(below(path));
  if (!existed && at == g_watch.file_of_name.end()) {
    at = g_watch.file_of_name.emplace(below(path), g_watch.files++).first;
    DiskChange change = named(Kind::create, path);
    change.file = at->second;
    note(std::move(change));
  }
  if (at == g_watch.file_of_name.end()) return;  // a folder
  g_file_of_fd[fd] = at->second;
  if ((flags & O_TRUNC) != 0 && existed) note({Kind::resize, at->second, 0, {}, {}, {}});
}

int open_call(const char* path, int flags, mode_t mode) {
  if (!g_in_use) return static_cast<int>(syscall(SYS_openat, AT_FDCWD, path, flags, mode));
  struct stat there {};
  const bool existed = syscall(SYS_newfstatat, AT_FDCWD, path, &there, 0) == 0;
  if (hits(path, (flags & O_CREAT) == 0 || existed)) return -1;
  const int fd = static_cast<int>(syscall(SYS_openat, AT_FDCWD, path, flags, mode));
  if (fd >= 0) note_open(path, flags, fd, existed);
  return fd;
}

void note_write(int fd, const void* bytes, ssize_t done, std::int64_t offset) {
  if (!g_in_use || !g_watch.on || done <= 0) return;
  const auto at = g_file_of_fd.find(fd);
  if (at == g_file_of_fd.end()) return;
  note({Kind::write,
        at->second,
        offset,
        std::string(static_cast<const char*>(bytes), static_cast<std::size_t>(done)),
        {},
        {}});
}

void note_sync(int fd) {
  if (!g_in_use || !g_watch.on) return;
  if (const auto at = g_file_of_fd.find(fd); at != g_file_of_fd.end()) {
    note({Kind::sync, at->second, 0, {}, {}, {}});
  } else if (const auto folder = g_path_of_fd.find(fd); folder != g_path_of_fd.end() && is_watched(folder->second)) {
    if (!is_index(folder->second)) note(named(Kind::sync_folder, folder->second));
  }
}

int name_call(const char* path, Kind kind, long result) {
  if (result == 0 && g_in_use && is_watched(path) && !is_index(path)) {
    note(named(kind, path));
    if (kind == Kind::unlink) g_watch.file_of_name.erase(below(path));
  }
  return static_cast<int>(result);
}

// ---- images ------------------------------------------------------------------------------------------------------

constexpr std::size_t kSector = 512;

struct FileState {
  std::string durable;
  std::vector<const DiskChange*> pending;
};

void put(std::string& content, std::size_t offset, const char* bytes, std::size_t size) {
  if (content.size() < offset + size) content.resize(offset + size, '\0');
  std::copy_n(bytes, size, content.begin() + static_cast<std::ptrdiff_t>(offset));
}

void carry_out(std::string& content, const DiskChange& change) {
  if (change.kind == Kind::resize) {
    content.resize(static_cast<std::size_t>(change.offset), '\0');
  } else {
    put(content, static_cast<std::size_t>(change.offset), change.bytes.data(), change.bytes.size());
  }
}

/// Applies some sectors of an unsynced write.
void carry_out_torn(std::string& content, const DiskChange& change, double kept, Prng& prng) {
  if (change.kind == Kind::resize) {
    if (prng.uniform() < kept) carry_out(content, change);
    return;
  }
  const auto begin = static_cast<std::size_t>(change.offset);
  const std::size_t end = begin + change.bytes.size();
  if (prng.below(4) == 0 && content.size() < end) content.resize(end, '\0');  // the length without the content
  for (std::size_t at = begin; at < end;) {
    const std::size_t next = std::min(end, (at / kSector + 1) * kSector);
    if (prng.uniform() < kept) {
      put(content, at, change.bytes.data() + (at - begin), next - at);
      if (prng.below(64) == 0)
        for (std::size_t i = at; i < next; ++i) content[i] = static_cast<char>(prng.next());
    }
    at = next;
  }
}

std::string folder_of(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  return slash == std::string::npos ? "" : path.substr(0, slash);
}

struct Names {
  std::map<std::string, int> files;
  std::set<std::string> folders;

  void carry_out(const DiskChange& change) {
    switch (change.kind) {
      case Kind::create:
      case Kind::link: files[change.path] = change.file; break;
      case Kind::unlink:
        files.erase(change.path);
        folders.erase(change.path);
        break;
      case Kind::make_folder: folders.insert(change.path); break;
      case Kind::rename:
        if (const auto at = files.find(change.path); at != files.end()) {
          files[change.other] = at->second;
          files.erase(change.path);
        } else if (folders.erase(change.path) != 0) {
          folders.insert(change.other);
        }
        break;
      default: break;
    }
  }
};

bool is_about_names(Kind kind) {
  return kind == Kind::create || kind == Kind::unlink || kind == Kind::rename || kind == Kind::link ||
         kind == Kind::make_folder;
}

bool is_in_folder(const DiskChange& change, const std::string& folder) {
  return folder_of(change.path) == folder || (change.kind == Kind::rename && folder_of(change.other) == folder);
}

class PowerCut {
 public:
  PowerCut(const DiskLog& log, NameModel model) : model_(model) {
    for (const auto& [name, content] : log.base.files) {
      const int file = static_cast<int>(files_.size());
      files_.emplace_back().durable = content;
      names_.files[name] = file;
    }
    names_.folders = log.base.folders;
    base_files_ = static_cast<int>(files_.size());
  }

  void add(const DiskChange& change) {
    if (change.kind == Kind::sync) {
      FileState& file = files_.at(static_cast<std::size_t>(change.file));
      for (const DiskChange* pending : file.pending) carry_out(file.durable, *pending);
      file.pending.clear();
      if (model_ == NameModel::ordered) settle([](const DiskChange&) { return true; });
    } else if (change.kind == Kind::sync_folder) {
      settle([&](const DiskChange& name) { return model_ == NameModel::ordered || is_in_folder(name, change.path); });
    } else if (change.kind == Kind::write || change.kind == Kind::resize) {
      files_.at(static_cast<std::size_t>(change.file)).pending.push_back(&change);
    } else if (is_about_names(change.kind)) {
      if (change.kind == Kind::create) {
        while (static_cast<int>(files_.size()) <= change.file) files_.emplace_back();
      }
      pending_names_.push_back(&change);
    }
  }

  DiskImage all() {
    for (const DiskChange* change : pending_names_) names_.carry_out(*change);
    for (FileState& file : files_)
      for (const DiskChange* change : file.pending) carry_out(file.durable, *change);
    return image();
  }

  DiskImage torn(Prng& prng) {
    static constexpr double kShares[] = {0.0, 0.1, 0.5, 0.9, 1.0};
    const double kept = kShares[prng.below(5)];
    if (model_ == NameModel::ordered) {
      pending_names_.resize(prng.below(pending_names_.size() + 1));
      for (const DiskChange* change : pending_names_) names_.carry_out(*change);
    } else {
      for (const DiskChange* change : pending_names_)
        if (prng.below(2) == 0) names_.carry_out(*change);
    }
    for (FileState& file : files_)
      for (const DiskChange* change : file.pending) carry_out_torn(file.durable, *change, kept, prng);
    return image();
  }

 private:
  template <typename Which>
  void settle(const Which& which) {
    std::vector<const DiskChange*> left;
    for (const DiskChange* change : pending_names_) {
      if (which(*change)) {
        names_.carry_out(*change);
      } else {
        left.push_back(change);
      }
    }
    pending_names_ = std::move(left);
  }

  /// True if all folders of the file exist.
  [[nodiscard]] bool is_reachable(const std::string& path) const {
    for (std::string folder = folder_of(path); !folder.empty(); folder = folder_of(folder))
      if (!names_.folders.contains(folder)) return false;
    return true;
  }

  DiskImage image() const {
    DiskImage image;
    for (const std::string& folder : names_.folders)
      if (is_reachable(folder)) image.folders.insert(folder);
    for (const auto& [name, file] : names_.files)
      if (is_reachable(name)) image.files[name] = files_.at(static_cast<std::size_t>(file)).durable;
    return image;
  }

  NameModel model_;
  std::vector<FileState> files_;
  Names names_;
  std::vector<const DiskChange*> pending_names_;
  int base_files_ = 0;
};

PowerCut replay(const DiskLog& log, std::size_t end, NameModel model) {
  PowerCut cut(log, model);
  for (std::size_t i = 0; i < end; ++i) cut.add(log.changes[i]);
  return cut;
}

}  // namespace

std::size_t DiskLog::marks_before(std::size_t end) const {
  std::size_t marks = 0;
  for (std::size_t i = 0; i < end; ++i)
    if (changes[i].kind == Kind::mark) ++marks;
  return marks;
}

DiskImage image_after(const DiskLog& log, std::size_t end, NameModel model, Prng& prng) {
  return replay(log, end, model).torn(prng);
}

DiskImage image_of_all(const DiskLog& log, std::size_t end) {
  return replay(log, end, NameModel::ordered).all();
}

void DiskImage::write_to(const std::string& root) const {
  std::filesystem::create_directories(root);
  for (const std::string& folder : folders) std::filesystem::create_directories(root + "/" + folder);
  for (const auto& [name, content] : files) {
    std::ofstream out(root + "/" + name, std::ios::binary);
    out.write(content.data(), static_cast<std::streamsize>(content.size()));
  }
}

DiskImage DiskImage::read_from(const std::string& root) {
  DiskImage image;
  if (!std::filesystem::is_directory(root)) return image;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(root)) {
    const std::string name = entry.path().string().substr(root.size() + 1);
    if (entry.is_directory()) {
      image.folders.insert(name);
    } else if (!is_index(name)) {
      std::ifstream in(entry.path(), std::ios::binary);
      image.files[name] = {std::istreambuf_iterator<char>(in), {}};
    }
  }
  return image;
}

namespace crash_disk {

void watch(const std::string& root) {
  g_in_use = true;
  g_watch = {};
  g_path_of_fd.clear();
  g_file_of_fd.clear();
  g_watch.root = root;
  g_watch.log.base = DiskImage::read_from(root);
  for (const auto& [name, content] : g_watch.log.base.files) g_watch.file_of_name[name] = g_watch.files++;
  g_watch.on = true;
}

void mark() {
  if (g_watch.on) note({Kind::mark, -1, 0, {}, {}, {}});
}

DiskLog stop() {
  g_watch.on = false;
  return std::move(g_watch.log);
}

void fail(const std::string& root, std::uint64_t first, std::uint64_t count, int error_number, bool with_reads) {
  g_in_use = true;
  g_fault = {};
  g_fault.armed = true;
  g_fault.root = root;
  g_fault.first = first;
  g_fault.last = first + count - 1;
  g_fault.error_number = error_number;
  g_fault.with_reads = with_reads;
}

void fill(const std::string& root) {
  fail(root, 1, 1, ENOSPC, false);
  g_fault.full = true;
}

void kill_at(const std::string& root, std::uint64_t first) {
  fail(root, first, 1, 0, false);
  g_fault.kills = true;
}

std::uint64_t heal() {
  g_fault.armed = false;
  return g_fault.calls;
}

bool has_hit() {
  return g_fault.hit;
}

}  // namespace crash_disk
}  // namespace slabd::storage

// ---- the calls ---------------------------------------------------------------------------------------------------

using namespace slabd::storage;  // NOLINT(google-build-using-namespace): the calls below have C's names

extern "C" {

int open(const char* path, int flags, ...) {
  va_list list;
  va_start(list, flags);
  const mode_t mode = (flags & O_CREAT) != 0 ? va_arg(list, mode_t) : 0;
  va_end(list);
  return open_call(path, flags, mode);
}

int open64(const char* path, int flags, ...) {
  va_list list;
  va_start(list, flags);
  const mode_t mode = (flags & O_CREAT) != 0 ? va_arg(list, mode_t) : 0;
  va_end(list);
  return open_call(path, flags, mode);
}

int close(int fd) {
  if (g_in_use) {
    g_path_of_fd.erase(fd);
    g_file_of_fd.erase(fd);
  }
  return static_cast<int>(syscall(SYS_close, fd));
}

ssize_t write(int fd, const void* bytes, size_t size) {
  if (hits_fd(fd)) return -1;
  const std::int64_t offset =
      g_in_use && g_watch.on && g_file_of_fd.contains(fd) ? syscall(SYS_lseek, fd, 0, SEEK_CUR) : 0;
  const ssize_t done = syscall(SYS_write, fd, bytes, size);
  note_write(fd, bytes, done, offset);
  return done;
}

ssize_t pwrite64(int fd, const void* bytes, size_t size, off64_t offset) {
  if (hits_fd(fd) || has_no_room(fd, offset + static_cast<std::int64_t>(size))) return -1;
  const ssize_t done = syscall(SYS_pwrite64, fd, bytes, size, offset);
  note_write(fd, bytes, done, offset);
  return done;
}

ssize_t pread64(int fd, void* bytes, size_t size, off64_t offset) {
  if (hits_fd(fd, true)) return -1;
  return syscall(SYS_pread64, fd, bytes, size, offset);
}

int ftruncate64(int fd, off64_t size) noexcept {
  if (hits_fd(fd)) return -1;
  const long result = syscall(SYS_ftruncate, fd, size);
  if (result != 0 || !g_in_use || !g_watch.on) return static_cast<int>(result);
  if (const auto at = g_file_of_fd.find(fd); at != g_file_of_fd.end())
    note({Kind::resize, at->second, size, {}, {}, {}});
  return static_cast<int>(result);
}

int fsync(int fd) {
  if (hits_fd(fd)) return -1;
  const long result = syscall(SYS_fsync, fd);
  if (result == 0) note_sync(fd);
  return static_cast<int>(result);
}

int fdatasync(int fd) {
  if (hits_fd(fd)) return -1;
  const long result = syscall(SYS_fdatasync, fd);
  if (result == 0) note_sync(fd);
  return static_cast<int>(result);
}

int unlink(const char* path) noexcept {
  if (hits(path)) return -1;
  return name_call(path, Kind::unlink, syscall(SYS_unlink, path));
}

int rmdir(const char* path) noexcept {
  if (hits(path)) return -1;
  return name_call(path, Kind::unlink, syscall(SYS_rmdir, path));
}

int remove(const char* path) noexcept {
  if (hits(path)) return -1;
  struct stat there {};
  if (syscall(SYS_newfstatat, AT_FDCWD, path, &there, AT_SYMLINK_NOFOLLOW) != 0) return -1;
  const bool folder = S_ISDIR(there.st_mode);
  return name_call(path, Kind::unlink, folder ? syscall(SYS_rmdir, path) : syscall(SYS_unlink, path));
}

int mkdir(const char* path, mode_t mode) noexcept {
  if (hits(path)) return -1;
  return name_call(path, Kind::make_folder, syscall(SYS_mkdir, path, mode));
}

int rename(const char* from, const char* to) noexcept {
  if (hits(from)) return -1;
  const long result = syscall(SYS_rename, from, to);
  if (result == 0 && g_in_use && is_watched(from)) {
    DiskChange change = named(Kind::rename, from);
    change.other = below(to);
    const auto at = g_watch.file_of_name.find(change.path);
    if (at != g_watch.file_of_name.end()) {
      g_watch.file_of_name[change.other] = at->second;
      g_watch.file_of_name.erase(change.path);
    }
    note(std::move(change));
  }
  return static_cast<int>(result);
}

int link(const char* from, const char* to) noexcept {
  if (hits(from)) return -1;
  const long result = syscall(SYS_link, from, to);
  if (result == 0 && g_in_use && is_watched(to)) {
    DiskChange change = named(Kind::link, to);
    change.file = g_watch.file_of_name[below(from)];
    g_watch.file_of_name[change.path] = change.file;
    note(std::move(change));
  }
  return static_cast<int>(result);
}

}  // extern "C"
