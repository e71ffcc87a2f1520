// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

/// Heap calls (malloc, calloc, realloc, the aligned ones, and so operator new) while a HeapCount lives, of the calling
/// thread or of every thread. The test program stands in for the C library's allocator, so calls from any library
/// count. One at a time in each thread, and only one of every thread.
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
