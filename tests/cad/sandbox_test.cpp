// SPDX-License-Identifier: Apache-2.0
#include "cad/sandbox.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <string>

namespace slabd::cad {
namespace {

/// Exit statuses of the confined child.
enum : int { kRefused = 0, kUnconfined = 10, kNotRefused = 11, kOtherError = 12 };

/// Runs `attempt` in a confined child of this process; it returns a negative number and errno if the kernel refused.
template <typename Attempt>
int confined(Attempt attempt) {
  const pid_t child = ::fork();
  if (child == 0) {
    if (!confine()) ::_exit(kUnconfined);
    errno = 0;
    if (attempt() >= 0) ::_exit(kNotRefused);
    ::_exit(errno == EPERM ? kRefused : kOtherError);
  }
  int status = 0;
  ::waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

bool may_confine() {
  return confined([] { return -1; }) != kUnconfined;
}

TEST(CadSandbox, forbids_files_for_writing_connections_and_programs) {
  if (!may_confine()) GTEST_SKIP() << "no filters of system calls: a sanitizer, or this kernel does not allow them";
  const std::string path = ::testing::TempDir() + "slabd-cad-" + std::to_string(::getpid());
  const char* const name = path.c_str();
  EXPECT_EQ(confined([&] { return ::open(name, O_WRONLY | O_CREAT, 0600); }), kRefused);
  EXPECT_EQ(confined([&] { return ::open("/dev/null", O_RDWR); }), kRefused);
  EXPECT_EQ(confined([] { return ::socket(AF_INET, SOCK_STREAM, 0); }), kRefused);
  EXPECT_EQ(confined([] { return ::socket(AF_UNIX, SOCK_DGRAM, 0); }), kRefused);
  EXPECT_EQ(confined([&] { return ::mkdir(name, 0700); }), kRefused);
  EXPECT_EQ(confined([&] { return ::rename("/dev/null", name); }), kRefused);
  EXPECT_EQ(confined([&] { return ::unlink(name); }), kRefused);
  EXPECT_EQ(confined([] { return ::kill(::getppid(), 0); }), kRefused);
  EXPECT_EQ(confined([] { return ::fork(); }), kRefused);
  EXPECT_EQ(confined([] { return ::setsid(); }), kRefused);
  EXPECT_EQ(confined([] { return ::fchmod(::open("/proc/self/maps", O_RDONLY), 0600); }), kRefused);
  EXPECT_EQ(confined([] { return ::execl("/bin/true", "true", nullptr); }), kRefused);
  EXPECT_NE(::access(name, F_OK), 0);
}

TEST(CadSandbox, allows_what_reading_needs) {
  if (!may_confine()) GTEST_SKIP() << "no filters of system calls: a sanitizer, or this kernel does not allow them";
  EXPECT_EQ(confined([] { return ::open("/proc/self/maps", O_RDONLY); }), kNotRefused);
}

}  // namespace
}  // namespace slabd::cad
