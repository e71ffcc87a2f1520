// SPDX-License-Identifier: Apache-2.0
#include "daemon/seal.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

namespace slabd::daemon {
namespace {

/// Runs in a child process without the right to lock memory: exit status 0 if the text contains both sizes.
[[noreturn]] void lock_without_permission() {
  constexpr uid_t kOther = 65'534;
  const rlimit limit{3'000'000, 3'000'000};
  if (::setrlimit(RLIMIT_MEMLOCK, &limit) != 0) ::_exit(2);
  if (::geteuid() == 0 && ::setresuid(kOther, kOther, kOther) != 0) ::_exit(3);
  const Status locked = lock_memory();
  if (locked.ok()) ::_exit(4);
  const std::string_view text = locked.error().text.view();
  const bool named = text.find(" MB are needed, LimitMEMLOCK allows 3 MB)") != std::string_view::npos;
  ::_exit(named ? 0 : 5);
}

TEST(Seal, a_limit_that_is_too_small_is_an_error_with_the_required_size) {
  const pid_t child = ::fork();
  if (child == 0) lock_without_permission();
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 0) << "2: no limit, 3: no other user, 4: memory was locked, 5: another text";
}

}  // namespace
}  // namespace slabd::daemon
