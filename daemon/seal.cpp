// SPDX-License-Identifier: Apache-2.0
//
// Problem: a process that cannot grow must still never end, and C++ ends it when memory runs out at the wrong place (a
// JSON object asks for memory while it is taken down, and nobody can catch what fails there). Idea: the limit that
// holds is the soft one; the hard one lies a few megabytes above. An allocation that fails calls the new-handler, which
// moves the soft limit up; whatever is under way ends, and before the next answer on the control socket the limit is
// put back and no answer is begun until there is room for one. Invariants: the limit is never above what was said at
// the start plus the reserve; the inspection path asks for nothing, so it never comes here.
#include "daemon/seal.h"

#include <malloc.h>
#include <pthread.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <new>
#include <string>
#include <thread>

namespace slabd::daemon {
namespace {

/// The largest answer and everything on the way to it: a request of limits::kControlLineBytes as a JSON value.
constexpr std::size_t kAnswerBytes = 2'000'000;
#if defined(__OPTIMIZE__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
constexpr bool kFramesAreSmall = true;
#else
constexpr bool kFramesAreSmall = false;
#endif
/// With the reserve gone too, somebody may give something back: so many milliseconds are waited for that, and so often
/// it is tried again when small pieces can be had.
constexpr int kPatience = 50;
constexpr int kTries = 10'000;
constexpr std::size_t kSmallPiece = 256;

std::atomic<std::uint64_t> g_limit{0};  ///< 0: not sealed
std::atomic<bool> g_in_reserve{false};
std::atomic<int> g_patience{kPatience};
std::atomic<int> g_tries{kTries};
std::atomic<std::uint64_t> g_reserve_uses{0};

/// Of this process, in bytes; 0 when /proc does not say.
std::uint64_t mapped_bytes() {
  std::ifstream statm("/proc/self/statm");
  std::uint64_t pages = 0;
  statm >> pages;
  return pages * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
}

/// CAP_IPC_LOCK: RLIMIT_MEMLOCK does not count.
bool may_lock_anything() {
  constexpr unsigned kCapIpcLock = 14;
  std::ifstream status("/proc/self/status");
  std::string line;
  while (std::getline(status, line))
    if (line.starts_with("CapEff:")) return (std::strtoull(line.c_str() + 7, nullptr, 16) >> kCapIpcLock & 1U) != 0;
  return false;
}

bool set_limit(std::uint64_t bytes) {
  rlimit limit{};
  if (::getrlimit(RLIMIT_AS, &limit) != 0) return false;
  limit.rlim_cur = bytes;
  return ::setrlimit(RLIMIT_AS, &limit) == 0;
}

bool can_have(std::size_t bytes) {
  void* volatile piece = std::malloc(bytes);  // volatile: or the compiler knows better and asks nobody
  const bool there = piece != nullptr;
  std::free(piece);
  return there;
}

/// std::new_handler: returns when another try may succeed.
void take_the_reserve() {
  if (!g_in_reserve.exchange(true)) {
    g_reserve_uses.fetch_add(1);
    if (set_limit(g_limit + kReserveBytes)) return;
  }
  const bool some_is_left = can_have(kSmallPiece);
  if ((some_is_left ? g_tries : g_patience).fetch_sub(1) <= 0) throw std::bad_alloc();
  if (!some_is_left) std::this_thread::sleep_for(std::chrono::milliseconds(1));
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

Status lock_memory(std::uint64_t more_bytes) {
  const std::uint64_t needed = mapped_bytes() + more_bytes;
  rlimit limit{};
  ::getrlimit(RLIMIT_MEMLOCK, &limit);
  // A lock that takes in what is mapped now and not what comes later would be a seal of its own, without a reserve.
  const bool enough = limit.rlim_cur == RLIM_INFINITY || limit.rlim_cur >= needed || may_lock_anything();
  if (enough && ::mlockall(MCL_CURRENT | MCL_FUTURE) == 0) return success();
  const int why = enough ? errno : EPERM;
  (void)::munlockall();
  return error(Code::internal, "memory cannot be locked: %s (%.0f MB are needed, LimitMEMLOCK allows %.0f MB)",
               std::strerror(why), static_cast<double>(needed) / 1e6, static_cast<double>(limit.rlim_cur) / 1e6);
}

Status limit_address_space(std::uint64_t headroom_bytes) {
  touch_the_stack();
  const std::uint64_t mapped = mapped_bytes();
  if (mapped == 0)
    return error(Code::internal, "memory cannot be limited: /proc/self/statm does not say how much is used");
  const rlimit limit{mapped + headroom_bytes, mapped + headroom_bytes + kReserveBytes};
  if (::setrlimit(RLIMIT_AS, &limit) != 0)
    return error(Code::internal, "memory cannot be limited: %s", std::strerror(errno));
  g_limit = limit.rlim_cur;
  std::set_new_handler(take_the_reserve);
  return success();
}

void put_the_reserve_back() {
  if (g_limit == 0 || !g_in_reserve || !set_limit(g_limit)) return;
  g_patience = kPatience;
  g_tries = kTries;
  g_in_reserve = false;
}

bool has_room_for_an_answer() {
  if (g_limit == 0) return true;
  put_the_reserve_back();
  return can_have(kAnswerBytes);
}

std::uint64_t reserve_uses() {
  return g_reserve_uses;
}

}  // namespace slabd::daemon
