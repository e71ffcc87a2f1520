// SPDX-License-Identifier: Apache-2.0
#include "daemon/seal.h"

#include <malloc.h>
#include <pthread.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <string>

namespace slabd::daemon {
namespace {

/// Mappings made after the lock: SQLite's cache, answers on the control socket, the thread that opens the database.
constexpr std::uint64_t kLaterBytes = 20'000'000;
#if defined(__OPTIMIZE__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
constexpr bool kFramesAreSmall = true;
#else
constexpr bool kFramesAreSmall = false;
#endif

/// Mapped memory of this process in bytes; 0 if /proc does not report it.
std::uint64_t mapped_bytes() {
  std::ifstream statm("/proc/self/statm");
  std::uint64_t pages = 0;
  statm >> pages;
  return pages * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
}

/// True with CAP_IPC_LOCK: RLIMIT_MEMLOCK does not apply.
bool may_lock_anything() {
  constexpr unsigned kCapIpcLock = 14;
  std::ifstream status("/proc/self/status");
  std::string line;
  while (std::getline(status, line))
    if (line.starts_with("CapEff:")) return (std::strtoull(line.c_str() + 7, nullptr, 16) >> kCapIpcLock & 1U) != 0;
  return false;
}

[[gnu::noinline]] void touch_the_stack() {
  [[maybe_unused]] volatile char stack[kMainStackBytes];
  for (std::size_t i = 0; i < kMainStackBytes; i += 1024) stack[i] = 0;
}

}  // namespace

void use_one_heap() {
  ::mallopt(M_ARENA_MAX, 1);
  ::mallopt(M_TRIM_THRESHOLD, -1);
  pthread_attr_t attributes;
  if (!kFramesAreSmall || ::pthread_attr_init(&attributes) != 0) return;
  if (::pthread_attr_setstacksize(&attributes, kThreadStackBytes) == 0) (void)::pthread_setattr_default_np(&attributes);
  ::pthread_attr_destroy(&attributes);
}

Status lock_memory() {
  touch_the_stack();
  const std::uint64_t needed = mapped_bytes() + kLaterBytes;
  rlimit limit{};
  ::getrlimit(RLIMIT_MEMLOCK, &limit);
  // If later mappings exceed the limit, allocations fail, which the process does not survive.
  const bool enough = limit.rlim_cur == RLIM_INFINITY || limit.rlim_cur >= needed || may_lock_anything();
  if (enough && ::mlockall(MCL_CURRENT | MCL_FUTURE) == 0) return success();
  const int why = enough ? errno : EPERM;
  (void)::munlockall();
  return error(Code::internal, "memory cannot be locked: %s (%.0f MB are needed, LimitMEMLOCK allows %.0f MB)",
               std::strerror(why), static_cast<double>(needed) / 1e6, static_cast<double>(limit.rlim_cur) / 1e6);
}

}  // namespace slabd::daemon
