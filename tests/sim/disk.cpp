// SPDX-License-Identifier: Apache-2.0
#include "tests/sim/disk.h"

#include "tests/sim/allocation.h"

#include <fcntl.h>
#include <sqlite3.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cassert>
#include <cstring>

namespace slabd::sim {
namespace {

Disk* g_disk = nullptr;

using Content = std::vector<unsigned char>;

struct LayerFile {
  sqlite3_file base;
  std::string* path;
  std::shared_ptr<Content>* content;
  sqlite3_file* real;
};

LayerFile* layer(sqlite3_file* file) {
  return reinterpret_cast<LayerFile*>(file);
}
sqlite3_vfs* real_vfs(sqlite3_vfs* vfs) {
  return static_cast<sqlite3_vfs*>(vfs->pAppData);
}

std::int64_t size_of(const LayerFile& f) {
  return static_cast<std::int64_t>((*f.content)->size());
}

/// Content of a file that was just opened.
std::shared_ptr<Content> content_of(sqlite3_file* real, const std::string& path) {
  std::weak_ptr<Content>& known = g_disk->file(path).content;
  if (auto content = known.lock()) return content;
  sqlite3_int64 bytes = 0;
  real->pMethods->xFileSize(real, &bytes);
  auto content = std::make_shared<Content>(static_cast<std::size_t>(bytes));
  if (bytes > 0) {
    const int read = real->pMethods->xRead(real, content->data(), static_cast<int>(bytes), 0);
    assert(read == SQLITE_OK);
    (void)read;
  }
  known = content;
  return content;
}

/// Called before sectors change: stores the content that a loss of power may restore.
void keep_old(LayerFile& f, std::int64_t first_byte, std::int64_t end_byte) {
  const heap::Aside aside;
  Disk::File& log = g_disk->file(*f.path);
  constexpr std::int64_t kPage = 4096 / Disk::kSector;
  if (!log.unsynced.empty()) {
    // A page of the cache that is written again is completely dirty again.
    const std::int64_t end = (end_byte - 1) / Disk::kSector / kPage * kPage + kPage;
    for (auto at = log.unsynced.lower_bound(first_byte / Disk::kSector / kPage * kPage);
         at != log.unsynced.end() && at->first < end; ++at)
      at->second.doomed = false;
  }
  Disk::Run run;
  run.sector = first_byte / Disk::kSector;
  run.count = (end_byte - 1) / Disk::kSector - run.sector + 1;
  run.old_at = log.old.size();
  const std::int64_t existing =
      std::min(log.synced_bytes, (run.sector + run.count) * Disk::kSector) - run.sector * Disk::kSector;
  if (existing > 0) {
    run.old_bytes = static_cast<std::size_t>(existing);
    log.old.resize(run.old_at + run.old_bytes);
    const auto from = static_cast<std::size_t>(run.sector * Disk::kSector);
    if (from < (*f.content)->size())
      std::memcpy(&log.old[run.old_at], &(**f.content)[from], std::min(run.old_bytes, (*f.content)->size() - from));
  }
  log.runs.push_back(run);
}

int x_close(sqlite3_file* file) {
  LayerFile& f = *layer(file);
  const int result = f.real->pMethods->xClose(f.real);
  const heap::Aside aside;
  delete f.path;
  delete f.content;
  f.base.pMethods = nullptr;
  return result;
}
int x_read(sqlite3_file* file, void* out, int bytes, sqlite3_int64 at) {
  LayerFile& f = *layer(file);
  bool tear = false;
  if (const int result = g_disk->allow(Disk::Call::read, tear); result != SQLITE_OK) return result;
  const Content& content = **f.content;
  const auto wanted = static_cast<std::size_t>(bytes);
  const auto from = static_cast<std::size_t>(at);
  const std::size_t there = from < content.size() ? std::min(wanted, content.size() - from) : 0;
  if (there > 0) std::memcpy(out, &content[from], there);
  if (there == wanted) return SQLITE_OK;
  std::memset(static_cast<unsigned char*>(out) + there, 0, wanted - there);
  return SQLITE_IOERR_SHORT_READ;
}
int x_write(sqlite3_file* file, const void* in, int bytes, sqlite3_int64 at) {
  LayerFile& f = *layer(file);
  bool tear = false;
  const int result = g_disk->allow(Disk::Call::write, tear);
  if (result != SQLITE_OK && !tear) return result;
  const int written = tear ? bytes / 2 : bytes;
  if (written > 0) {
    keep_old(f, at, at + written);
    const int done = f.real->pMethods->xWrite(f.real, in, written, at);
    if (done != SQLITE_OK) return done;
    const heap::Aside aside;
    Content& content = **f.content;
    const auto end = static_cast<std::size_t>(at + written);
    if (content.size() < end) content.resize(end);
    std::memcpy(&content[static_cast<std::size_t>(at)], in, static_cast<std::size_t>(written));
  }
  return result;
}
int x_truncate(sqlite3_file* file, sqlite3_int64 bytes) {
  LayerFile& f = *layer(file);
  bool tear = false;
  if (const int result = g_disk->allow(Disk::Call::truncate, tear); result != SQLITE_OK) return result;
  if (size_of(f) > bytes) keep_old(f, bytes, size_of(f));
  const int done = f.real->pMethods->xTruncate(f.real, bytes);
  const heap::Aside aside;
  if (done == SQLITE_OK) (*f.content)->resize(static_cast<std::size_t>(bytes));
  return done;
}
int x_sync(sqlite3_file* file, int) {
  LayerFile& f = *layer(file);
  g_disk->sync_takes_time();
  bool tear = false;
  const int result = g_disk->allow(Disk::Call::sync, tear);
  if (!g_disk->believed()) return SQLITE_IOERR_FSYNC;
  const heap::Aside aside;
  Disk::File& log = g_disk->file(*f.path);
  if (result != SQLITE_OK) {
    log.fold(true);
    for (auto& [sector, old] : log.unsynced) old.doomed = true;
    return result;
  }
  if (!log.unsynced.empty()) log.fold(false);
  log.runs.clear();
  log.old.clear();
  for (auto at = log.unsynced.begin(); at != log.unsynced.end();)
    at = at->second.doomed ? std::next(at) : log.unsynced.erase(at);
  log.synced_bytes = size_of(f);
  return SQLITE_OK;
}
int x_size(sqlite3_file* file, sqlite3_int64* bytes) {
  *bytes = size_of(*layer(file));
  return SQLITE_OK;
}
int x_lock(sqlite3_file* file, int level) {
  return layer(file)->real->pMethods->xLock(layer(file)->real, level);
}
int x_unlock(sqlite3_file* file, int level) {
  return layer(file)->real->pMethods->xUnlock(layer(file)->real, level);
}
int x_reserved(sqlite3_file* file, int* out) {
  return layer(file)->real->pMethods->xCheckReservedLock(layer(file)->real, out);
}
int x_control(sqlite3_file* file, int op, void* arg) {
  // The size hint and chunks would change the file unnoticed by this layer.
  if (op == SQLITE_FCNTL_SIZE_HINT || op == SQLITE_FCNTL_CHUNK_SIZE) return SQLITE_OK;
  return layer(file)->real->pMethods->xFileControl(layer(file)->real, op, arg);
}
int x_sector(sqlite3_file* file) {
  return layer(file)->real->pMethods->xSectorSize(layer(file)->real);
}
int x_traits(sqlite3_file* file) {
  return layer(file)->real->pMethods->xDeviceCharacteristics(layer(file)->real);
}
int x_shm_map(sqlite3_file* file, int page, int size, int extend, void volatile** out) {
  return layer(file)->real->pMethods->xShmMap(layer(file)->real, page, size, extend, out);
}
int x_shm_lock(sqlite3_file* file, int offset, int n, int flags) {
  return layer(file)->real->pMethods->xShmLock(layer(file)->real, offset, n, flags);
}
void x_shm_barrier(sqlite3_file* file) {
  layer(file)->real->pMethods->xShmBarrier(layer(file)->real);
}
int x_shm_unmap(sqlite3_file* file, int remove) {
  return layer(file)->real->pMethods->xShmUnmap(layer(file)->real, remove);
}

const sqlite3_io_methods kMethods = {2,          x_close,       x_read,      x_write,   x_truncate, x_sync,   x_size,
                                     x_lock,     x_unlock,      x_reserved,  x_control, x_sector,   x_traits, x_shm_map,
                                     x_shm_lock, x_shm_barrier, x_shm_unmap, nullptr,   nullptr};

int x_open(sqlite3_vfs* vfs, const char* path, sqlite3_file* file, int flags, int* out) {
  LayerFile& f = *layer(file);
  f.base.pMethods = nullptr;
  if (g_disk != nullptr) {
    bool tear = false;
    if (g_disk->allow(Disk::Call::open, tear) != SQLITE_OK) return SQLITE_CANTOPEN;
  }
  f.real = reinterpret_cast<sqlite3_file*>(reinterpret_cast<char*>(file) + sizeof(LayerFile));
  const int result = real_vfs(vfs)->xOpen(real_vfs(vfs), path, f.real, flags, out);
  if (result != SQLITE_OK) return result;
  const heap::Aside aside;
  f.path = new std::string(path != nullptr ? path : "");
  f.content = new std::shared_ptr<Content>(g_disk != nullptr && path != nullptr ? content_of(f.real, *f.path)
                                                                                : std::make_shared<Content>());
  f.base.pMethods = &kMethods;
  return SQLITE_OK;
}
int x_delete(sqlite3_vfs* vfs, const char* path, int sync_folder) {
  bool tear = false;
  if (const int result = g_disk->allow(Disk::Call::remove, tear); result != SQLITE_OK) return SQLITE_IOERR_DELETE;
  const heap::Aside aside;
  g_disk->forget(path);
  return real_vfs(vfs)->xDelete(real_vfs(vfs), path, sync_folder);
}
int x_access(sqlite3_vfs* vfs, const char* path, int flags, int* out) {
  return real_vfs(vfs)->xAccess(real_vfs(vfs), path, flags, out);
}
/// Paths stay as given: relative ones, so that a trace does not depend on its folder.
int x_full(sqlite3_vfs*, const char* path, int bytes, char* out) {
  if (std::strlen(path) + 1 > static_cast<std::size_t>(bytes)) return SQLITE_CANTOPEN;
  std::strcpy(out, path);
  return SQLITE_OK;
}
int x_random(sqlite3_vfs*, int bytes, char* out) {
  std::memset(out, 0x5A, static_cast<std::size_t>(bytes));
  return bytes;
}
int x_sleep(sqlite3_vfs*, int us) {
  return us;
}
int x_time(sqlite3_vfs*, sqlite3_int64* ms) {
  *ms = 212'000'000'000'000;
  return SQLITE_OK;
}
int x_error(sqlite3_vfs* vfs, int bytes, char* text) {
  return real_vfs(vfs)->xGetLastError(real_vfs(vfs), bytes, text);
}

void register_layer() {
  static sqlite3_vfs vfs = *sqlite3_vfs_find(nullptr);
  static bool done = false;
  if (done) return;
  done = true;
  sqlite3_vfs* real = sqlite3_vfs_find(nullptr);
  vfs.szOsFile = static_cast<int>(sizeof(LayerFile)) + real->szOsFile;
  vfs.zName = "simulated-disk";
  vfs.pAppData = real;
  vfs.pNext = nullptr;
  vfs.iVersion = 2;
  vfs.xOpen = x_open;
  vfs.xDelete = x_delete;
  vfs.xAccess = x_access;
  vfs.xFullPathname = x_full;
  vfs.xRandomness = x_random;
  vfs.xSleep = x_sleep;
  vfs.xCurrentTimeInt64 = x_time;
  vfs.xGetLastError = x_error;
  sqlite3_vfs_register(&vfs, 1);
}

}  // namespace

void Disk::File::fold(bool doomed) {
  for (const Run& run : runs)
    for (std::int64_t i = 0; i < run.count; ++i) {
      const auto [at, added] = unsynced.try_emplace(run.sector + i);
      if (!added) continue;
      OldSector& sector = at->second;
      sector.doomed = doomed;
      const auto from = static_cast<std::size_t>(i * kSector);
      if (from >= run.old_bytes) continue;
      sector.existed = true;
      std::copy_n(old.begin() + static_cast<std::ptrdiff_t>(run.old_at + from),
                  std::min<std::size_t>(kSector, run.old_bytes - from), sector.bytes.begin());
    }
  runs.clear();
  old.clear();
}

void Disk::renamed(const std::string& from, const std::string& to) {
  files_.erase(to);
  if (auto known = files_.extract(from); !known.empty()) {
    known.key() = to;
    files_.insert(std::move(known));
  }
}

Disk::Disk(World& world) : world_(world), chance_(world.chance(1)) {
  heap::take_over();
  register_layer();
  assert(g_disk == nullptr);
  g_disk = this;
}

Disk::~Disk() {
  g_disk = nullptr;
}

void Disk::sync_takes_time() {
  if (!believed() || process_->current() == nullptr) return;
  const bool slow = world_.faulty(Fault::disk_slow);
  process_->sleep_for(slow ? between(chance_, 100 * kMs, 9'000 * kMs) : between(chance_, 1 * kMs, 12 * kMs));
}

std::uint64_t Disk::free_bytes() const {
  return world_.faulty(Fault::spool_full) || world_.faulty(Fault::disk_full) ? 0 : 500'000'000'000U;
}

int Disk::allow(Call call, bool& tear) {
  if (!believed()) return call == Call::read ? SQLITE_IOERR_READ : SQLITE_IOERR_WRITE;
  ++calls_;
  const bool changes = call != Call::read && call != Call::open;
  if (changes && kill_in_ > 0 && --kill_in_ == 0) {
    tear = kill_torn_ && call == Call::write;
    world_.trace.line(world_.now_ns, "disk: the process dies in call %llu%s", static_cast<unsigned long long>(calls_),
                      tear ? ", a write half done" : "");
    process_->die();
    return SQLITE_IOERR_WRITE;
  }
  if (world_.faulty(Fault::disk_eio) && happens(chance_, 0.05)) {
    switch (call) {
      case Call::read: return SQLITE_IOERR_READ;
      case Call::sync: return SQLITE_IOERR_FSYNC;
      case Call::open: return SQLITE_CANTOPEN;
      default: return SQLITE_IOERR_WRITE;
    }
  }
  if (call == Call::sync && world_.faulty(Fault::disk_fsync) && happens(chance_, 0.5)) return SQLITE_IOERR_FSYNC;
  if (call == Call::write && world_.faulty(Fault::disk_full)) return SQLITE_FULL;
  if (changes && call != Call::sync && world_.faulty(Fault::disk_read_only)) return SQLITE_IOERR_WRITE;
  return SQLITE_OK;
}

void Disk::lose_power() {
  const std::uint64_t mode = chance_.below(4);  // 0: all unsynced data are lost, 1..2: some, 3: none
  for (auto& [path, f] : files_) {
    f.fold(false);
    const int fd = ::open(path.c_str(), O_RDWR | O_CLOEXEC);
    if (fd < 0) continue;
    struct stat there {};
    fstat(fd, &there);
    std::int64_t end = std::min<std::int64_t>(f.synced_bytes, there.st_size);
    std::vector<std::int64_t> zeroed;
    for (const auto& [sector, old] : f.unsynced) {
      const bool lost = old.doomed || mode == 0 || (mode != 3 && happens(chance_, 0.5));
      const std::int64_t at = sector * kSector;
      if (!lost) {
        end = std::max(end, std::min<std::int64_t>(at + kSector, there.st_size));
      } else if (old.existed) {
        const ssize_t n = pwrite(fd, old.bytes.data(), kSector, at);
        assert(n == kSector);
        (void)n;
        end = std::max(end, std::min<std::int64_t>(at + kSector, f.synced_bytes));
      } else {
        zeroed.push_back(at);
      }
    }
    static constexpr std::array<unsigned char, kSector> kZero{};
    for (const std::int64_t at : zeroed)
      if (at < end) {
        const ssize_t n = pwrite(fd, kZero.data(), static_cast<std::size_t>(std::min(kSector, end - at)), at);
        (void)n;
      }
    const int cut = ftruncate(fd, end);
    assert(cut == 0);
    (void)cut;
    ::close(fd);
    f.unsynced.clear();
    f.synced_bytes = end;
    assert(f.content.expired());
  }
}

}  // namespace slabd::sim

/// Replaces the C library's function: the data about a file are kept under its new name.
extern "C" int rename(const char* from, const char* to) noexcept {
  const slabd::sim::heap::Aside aside;
  const long result = syscall(SYS_rename, from, to);
  if (result == 0 && slabd::sim::g_disk != nullptr) slabd::sim::g_disk->renamed(from, to);
  return static_cast<int>(result);
}

/// Replaces the C library's function: the free space of the spool is that of the simulated disk.
extern "C" int statvfs(const char*, struct statvfs* out) noexcept {
  *out = {};
  out->f_frsize = 4096;
  out->f_bavail = slabd::sim::g_disk != nullptr ? slabd::sim::g_disk->free_bytes() / 4096 : 1U << 30U;
  return 0;
}
