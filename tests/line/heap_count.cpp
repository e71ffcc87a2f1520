// SPDX-License-Identifier: Apache-2.0
#include "heap_count.h"

#include <atomic>
#include <cerrno>
#include <cstddef>

extern "C" {
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* old, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);
void __libc_free(void* old);
}

namespace {
thread_local bool g_counting = false;
thread_local std::uint64_t g_calls = 0;
std::atomic<bool> g_counting_all = false;
std::atomic<std::uint64_t> g_calls_of_all = 0;
void note() {
  if (g_counting) ++g_calls;
  if (g_counting_all.load(std::memory_order_relaxed)) g_calls_of_all.fetch_add(1, std::memory_order_relaxed);
}
}  // namespace

extern "C" {
void* malloc(std::size_t size) {
  note();
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  note();
  return __libc_calloc(count, size);
}
void* realloc(void* old, std::size_t size) {
  note();
  return __libc_realloc(old, size);
}
void* memalign(std::size_t alignment, std::size_t size) {
  note();
  return __libc_memalign(alignment, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  note();
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** out, std::size_t alignment, std::size_t size) {
  note();
  *out = __libc_memalign(alignment, size);
  return *out == nullptr ? ENOMEM : 0;
}
void free(void* old) {
  __libc_free(old);
}
}

HeapCount::HeapCount(Of of) : of_(of) {
  if (of_ == Of::every_thread) {
    g_calls_of_all = 0;
    g_counting_all = true;
  } else {
    g_calls = 0;
    g_counting = true;
  }
}
HeapCount::~HeapCount() {
  if (of_ == Of::every_thread) {
    g_counting_all = false;
  } else {
    g_counting = false;
  }
}
std::uint64_t HeapCount::calls() const {
  return of_ == Of::every_thread ? g_calls_of_all.load() : g_calls;
}
