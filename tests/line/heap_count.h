// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

/// Heap calls (malloc, calloc, realloc, the aligned ones, and so operator new) of the calling thread while a
/// HeapCount lives. The test program stands in for the C library's allocator, so calls from any library count.
class HeapCount {
 public:
  HeapCount();
  ~HeapCount();
  HeapCount(const HeapCount&) = delete;
  HeapCount& operator=(const HeapCount&) = delete;
  [[nodiscard]] std::uint64_t calls() const;
};
