// SPDX-License-Identifier: Apache-2.0
#include "daemon/seal.h"

#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <functional>

namespace slabd::daemon {
namespace {

constexpr std::size_t kMegabyte = 1'000'000;
/// The allocators of the sanitizers end the process if memory runs out.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kMallocEndsTheProcess = true;
#else
constexpr bool kMallocEndsTheProcess = false;
#endif

/// Runs in a child process, because its limits cannot be reset.
bool holds_in_a_child(const std::function<bool()>& what) {
  const pid_t child = ::fork();
  if (child == 0) ::_exit(what() ? 0 : 1);
  int status = 0;
  return ::waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

bool can_map(std::size_t bytes) {
  void* got = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (got != MAP_FAILED) ::munmap(got, bytes);
  return got != MAP_FAILED;
}

TEST(Seal, denies_memory_above_the_reserve_and_grants_memory_below_it) {
  EXPECT_TRUE(can_map(64 * kMegabyte));
  EXPECT_TRUE(holds_in_a_child([] {
    use_one_heap();
    return limit_address_space(8 * kMegabyte).ok() && !can_map(64 * kMegabyte) && can_map(4 * kMegabyte) &&
           (kMallocEndsTheProcess || std::malloc(64 * kMegabyte) == nullptr);
  }));
}

TEST(Seal, memory_that_was_released_can_be_allocated_again) {
  EXPECT_TRUE(holds_in_a_child([] {
    use_one_heap();
    void* slots = ::mmap(nullptr, 64 * kMegabyte, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (slots == MAP_FAILED || !limit_address_space(kMegabyte).ok()) return false;
    ::munmap(slots, 64 * kMegabyte);
    return can_map(64 * kMegabyte);
  }));
}

}  // namespace
}  // namespace slabd::daemon
