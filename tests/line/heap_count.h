// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

/// Counts heap calls (malloc, calloc, realloc, the aligned ones, and so operator new) during its lifetime, of the
/// calling thread or of every thread. The test program replaces the C library's allocator, so calls from any library
/// count. At most one object in each thread, and only one for all threads.
class HeapCount {
 public:
  enum class Of { this_thread, every_thread };
  explicit HeapCount(Of of = Of::this_thread);
  ~HeapCount();
  HeapCount(const HeapCount&) = delete;
  HeapCount& operator=(const HeapCount&) = delete;
  [[nodiscard]] std::uint64_t calls() const;

 private:
  Of of_;
};
