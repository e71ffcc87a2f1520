// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <sys/un.h>

#include <cstring>

#include "hal/hal.h"
#include "hal/os.h"
#include "tests/hal/temporary_folder.h"

namespace slabd::hal {
namespace {

TEST(SystemdNotify, messages_are_those_of_the_protocol) {
  test::TemporaryFolder folder;
  const std::string path = folder / "notify";
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, path.c_str(), path.size());
  const Fd manager(socket(AF_UNIX, SOCK_DGRAM, 0));
  ASSERT_EQ(bind(manager.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  setenv("NOTIFY_SOCKET", path.c_str(), 1);
  const auto notify = make_systemd_notify();
  const auto next_message = [&] {
    std::array<char, 1024> text{};
    const ssize_t n = recv(manager.get(), text.data(), text.size(), MSG_DONTWAIT);
    return std::string(text.data(), n > 0 ? static_cast<std::size_t>(n) : 0);
  };
  notify->ready();
  EXPECT_EQ(next_message(), "READY=1");
  notify->watchdog();
  EXPECT_EQ(next_message(), "WATCHDOG=1");
  notify->status("idle, slab S-1\nREADY=0");
  EXPECT_EQ(next_message(), "STATUS=idle, slab S-1");
  notify->stopping();
  EXPECT_EQ(next_message(), "STOPPING=1");
  unsetenv("NOTIFY_SOCKET");
  make_systemd_notify()->ready();
  EXPECT_EQ(next_message(), "") << "silent without a service manager";
}

TEST(SystemdNotify, a_manager_that_reads_nothing_keeps_nobody_waiting) {
  test::TemporaryFolder folder;
  const std::string path = folder / "notify";
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, path.c_str(), path.size());
  const Fd manager(socket(AF_UNIX, SOCK_DGRAM, 0));
  ASSERT_EQ(bind(manager.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  setenv("NOTIFY_SOCKET", path.c_str(), 1);
  const auto notify = make_systemd_notify();
  unsetenv("NOTIFY_SOCKET");
  for (int i = 0; i < 2'000; ++i) notify->status("full");
  notify->ready();  // finds no room, and is said again
  std::array<char, 64> text{};
  while (recv(manager.get(), text.data(), text.size(), MSG_DONTWAIT) > 0) continue;
  notify->watchdog();
  const ssize_t n = recv(manager.get(), text.data(), text.size(), MSG_DONTWAIT);
  EXPECT_EQ(std::string(text.data(), n > 0 ? static_cast<std::size_t>(n) : 0), "READY=1");
}

TEST(SystemClock, runs_forward_and_knows_the_year) {
  const auto clock = make_system_clock();
  const std::int64_t first = clock->mono_ns();
  EXPECT_LE(first, clock->mono_ns());
  EXPECT_GT(clock->utime_us(), 1'600'000'000'000'000);
}

}  // namespace
}  // namespace slabd::hal
