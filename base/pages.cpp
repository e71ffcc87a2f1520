// SPDX-License-Identifier: Apache-2.0
#include "base/pages.h"

#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <new>

#if defined(__SANITIZE_ADDRESS__)
#include <sanitizer/asan_interface.h>
#endif

// Problem: the kernel uses transparent huge pages only for whole, aligned 2-MiB ranges, and only on request (the
// setting "madvise"). Idea: map one such range more than needed and unmap the parts before the first and after the last
// byte. Then request huge pages and write to every page. The end is not rounded up to 2 MiB: its last part uses
// ordinary pages, and the resident size is the requested size.
namespace slabd {
namespace {

constexpr std::size_t kHugePage = std::size_t{2} << 20U;

constexpr std::size_t rounded_up(std::size_t bytes, std::size_t to) {
  return (bytes + to - 1) / to * to;
}

std::byte* map_aligned(std::size_t bytes) {
  void* const mapped = mmap(nullptr, bytes + kHugePage, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (mapped == MAP_FAILED) throw std::bad_alloc();
  auto* const begin = static_cast<std::byte*>(mapped);
  const std::size_t before =
      rounded_up(reinterpret_cast<std::uintptr_t>(begin), kHugePage) - reinterpret_cast<std::uintptr_t>(begin);
  if (before != 0) munmap(begin, before);
  if (before != kHugePage) munmap(begin + before + bytes, kHugePage - before);
  return begin + before;
}

/// AddressSanitizer does not check arrays inside one mapping, so a poisoned gap separates them.
#if defined(__SANITIZE_ADDRESS__)
constexpr std::size_t kGuard = 4'096;
void forbid(const std::byte* begin, std::size_t bytes) {
  __asan_poison_memory_region(begin, bytes);
}
void allow(const std::byte* begin, std::size_t bytes) {
  __asan_unpoison_memory_region(begin, bytes);
}
constexpr std::size_t kGuards = 64;
#else
constexpr std::size_t kGuard = 0;
void forbid(const std::byte*, std::size_t) {}
void allow(const std::byte*, std::size_t) {}
constexpr std::size_t kGuards = 0;
#endif

}  // namespace

Pages::Pages(std::size_t bytes)
    : bytes_(rounded_up(bytes + kGuards * kGuard, static_cast<std::size_t>(sysconf(_SC_PAGESIZE)))), limit_(bytes) {
  begin_ = map_aligned(bytes_);
  // Fails on kernels without huge pages; ordinary pages also work, slightly slower.
  static_cast<void>(madvise(begin_, bytes_, MADV_HUGEPAGE));
  const auto page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  for (std::size_t at = 0; at < bytes_; at += page) *static_cast<volatile std::byte*>(begin_ + at) = std::byte{0};
  forbid(begin_, bytes_);
}

Pages::~Pages() {
  allow(begin_, bytes_);
  munmap(begin_, bytes_);
}

void* Pages::take_bytes(std::size_t bytes) {
  if (bytes > limit_) {
    std::fputs("slabd: an array does not fit the memory that base/limits.h reckons with\n", stderr);
    std::abort();
  }
  limit_ -= bytes;
  std::byte* const begin = begin_ + taken_;
  taken_ += bytes + kGuard;
  allow(begin, bytes);
  return begin;
}

}  // namespace slabd
