// SPDX-License-Identifier: Apache-2.0
#include "tests/sim/allocation.h"

#include <sqlite3.h>

#include <cstdlib>
#include <new>

#include "tests/sim/fiber.h"

namespace slabd::sim::heap {
namespace {

thread_local std::int64_t t_fail_in = 0;
thread_local bool t_failed = false;
thread_local bool t_watching = false;
thread_local std::uint64_t t_counted = 0;
thread_local int t_aside = 0;

sqlite3_mem_methods g_plain;

void* sqlite_malloc(int bytes) {
  if (t_aside == 0 && Fiber::inside() && t_fail_in > 0 && --t_fail_in == 0) {
    t_failed = true;
    return nullptr;
  }
  return g_plain.xMalloc(bytes);
}

}  // namespace

/// Counts one request of C++ code; true if it must fail.
bool refuses() {
  if (t_aside != 0 || !Fiber::inside()) return false;
  if (t_watching) ++t_counted;
  if (t_fail_in > 0 && --t_fail_in == 0) {
    t_failed = true;
    return true;
  }
  return false;
}

void take_over() {
  static bool done = false;
  if (done) return;
  done = true;
  if (sqlite3_config(SQLITE_CONFIG_GETMALLOC, &g_plain) != SQLITE_OK) std::abort();
  sqlite3_mem_methods ours = g_plain;
  ours.xMalloc = sqlite_malloc;
  // Only one thread at a time uses SQLite here, and its memory statistics are not needed.
  const bool taken = sqlite3_config(SQLITE_CONFIG_MALLOC, &ours) == SQLITE_OK &&
                     sqlite3_config(SQLITE_CONFIG_SINGLETHREAD) == SQLITE_OK &&
                     sqlite3_config(SQLITE_CONFIG_MEMSTATUS, 0) == SQLITE_OK;
  if (!taken) std::abort();
}

void fail_at(std::int64_t count) {
  t_fail_in = count;
  t_failed = false;
}
bool failed() {
  return t_failed;
}
void watch() {
  t_counted = 0;
  t_watching = true;
}
std::uint64_t stop() {
  t_watching = false;
  return t_counted;
}
Aside::Aside() {
  ++t_aside;
}
Aside::~Aside() {
  --t_aside;
}

}  // namespace slabd::sim::heap

void* operator new(std::size_t bytes) {
  void* at = slabd::sim::heap::refuses() ? nullptr : std::malloc(bytes == 0 ? 1 : bytes);
  if (at == nullptr) throw std::bad_alloc();
  return at;
}
void* operator new[](std::size_t bytes) {
  return operator new(bytes);
}
void* operator new(std::size_t bytes, const std::nothrow_t&) noexcept {
  return slabd::sim::heap::refuses() ? nullptr : std::malloc(bytes == 0 ? 1 : bytes);
}
void* operator new[](std::size_t bytes, const std::nothrow_t& tag) noexcept {
  return operator new(bytes, tag);
}
void operator delete(void* at) noexcept {
  std::free(at);
}
void operator delete[](void* at) noexcept {
  std::free(at);
}
void operator delete(void* at, std::size_t) noexcept {
  std::free(at);
}
void operator delete[](void* at, std::size_t) noexcept {
  std::free(at);
}
