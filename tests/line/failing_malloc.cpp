// SPDX-License-Identifier: Apache-2.0
//
// Loaded before the C library (LD_PRELOAD): after the process is sealed, every N-th allocation of any code fails.
// SLABD_FAIL_EVERY is N.
#include <sys/resource.h>

#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstdlib>

extern "C" {
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* old, std::size_t size);
}

namespace {

std::atomic<bool> g_sealed{false};
std::atomic<std::uint64_t> g_asked{0};

bool sealed() {
  if (g_sealed.load(std::memory_order_relaxed)) return true;
  rlimit limit{};
  if (::getrlimit(RLIMIT_AS, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY) g_sealed = true;
  return false;
}

bool fails() {
  static const std::uint64_t every = [] {
    const char* text = std::getenv("SLABD_FAIL_EVERY");
    return text == nullptr ? 0 : std::strtoull(text, nullptr, 10);
  }();
  if (every == 0 || !sealed() || (g_asked.fetch_add(1) + 1) % every != 0) return false;
  errno = ENOMEM;
  return true;
}

}  // namespace

extern "C" {
void* malloc(std::size_t size) {
  return fails() ? nullptr : __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  return fails() ? nullptr : __libc_calloc(count, size);
}
void* realloc(void* old, std::size_t size) {
  return fails() ? nullptr : __libc_realloc(old, size);
}
}
