// SPDX-License-Identifier: Apache-2.0
//
// Problem: a process that cannot grow must not end, but C++ ends it if memory runs out at the wrong place. For example,
// a JSON object allocates memory in its destructor, and an exception there cannot be caught. Idea: the effective limit
// is the soft one; the hard one is a few megabytes above. A failing allocation calls the new-handler, which raises the
// soft limit, so that the work in progress ends. Before the next answer on the control socket the limit is restored,
// and no answer is started until there is room for one. Invariants: the limit never exceeds the value set at the start
// plus the reserve; the inspection path does not allocate, so it never comes here.
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

/// The largest answer and all memory needed to make it: a request of limits::kControlLineBytes as a JSON value.
constexpr std::size_t kAnswerBytes = 2'000'000;
#if defined(__OPTIMIZE__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
constexpr bool kFramesAreSmall = true;
#else
constexpr bool kFramesAreSmall = false;
#endif
/// Limits after the reserve is used up too, because another thread may release memory: milliseconds to wait, and
/// retries while small pieces are available.
constexpr int kPatience = 50;
constexpr int kTries = 10'000;
constexpr std::size_t kSmallPiece = 256;

std::atomic<std::uint64_t> g_limit{0};  ///< 0: not sealed
std::atomic<bool> g_in_reserve{false};
std::atomic<int> g_patience{kPatience};
std::atomic<int> g_tries{kTries};
std::atomic<std::uint64_t> g_reserve_uses{0};

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

bool set_limit(std::uint64_t bytes) {
  rlimit limit{};
  if (::getrlimit(RLIMIT_AS, &limit) != 0) return false;
  limit.rlim_cur = bytes;
  return ::setrlimit(RLIMIT_AS, &limit) == 0;
}

bool can_have(std::size_t bytes) {
  void* volatile piece = std::malloc(bytes);  // volatile, or the compiler removes the call
  const bool there = piece != nullptr;
  std::free(piece);
  return there;
}

/// std::new_handler: returns if another try may succeed.
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
  // A lock of present mappings that later mappings exceed would be a limit too, but without a reserve.
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
