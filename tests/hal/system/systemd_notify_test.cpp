// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <sys/un.h>

#include <cstring>

#include "base/os.h"
#include "hal/hal.h"
#include "tests/hal/temporary_folder.h"

namespace slabd::hal {
namespace {

/// Both ends of the protocol: the service manager's and slabd's.
struct Manager {
  Manager() {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::memcpy(address.sun_path, path.c_str(), path.size());
    EXPECT_EQ(bind(socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    setenv("NOTIFY_SOCKET", path.c_str(), 1);
    notify = make_systemd_notify();
    unsetenv("NOTIFY_SOCKET");
  }
  [[nodiscard]] std::string next_message() const {
    std::array<char, 1024> text{};
    const ssize_t n = recv(socket.get(), text.data(), text.size(), MSG_DONTWAIT);
    return std::string(text.data(), n > 0 ? static_cast<std::size_t>(n) : 0);
  }
  test::TemporaryFolder folder;
  std::string path = folder / "notify";
  Fd socket{::socket(AF_UNIX, SOCK_DGRAM, 0)};
  std::unique_ptr<ServiceNotify> notify;
};

TEST(SystemdNotify, messages_are_those_of_the_protocol) {
  const Manager manager;
  manager.notify->ready();
  EXPECT_EQ(manager.next_message(), "READY=1");
  manager.notify->watchdog();
  EXPECT_EQ(manager.next_message(), "WATCHDOG=1");
  manager.notify->status("idle, slab S-1\nREADY=0");
  EXPECT_EQ(manager.next_message(), "STATUS=idle, slab S-1");
  manager.notify->stopping();
  EXPECT_EQ(manager.next_message(), "STOPPING=1");
  make_systemd_notify()->ready();
  EXPECT_EQ(manager.next_message(), "") << "silent without a service manager";
}

TEST(SystemdNotify, does_not_block_on_a_manager_that_does_not_read) {
  const Manager manager;
  for (int i = 0; i < 2'000; ++i) manager.notify->status("full");
  manager.notify->ready();  // finds no space, and is repeated
  while (!manager.next_message().empty()) continue;
  manager.notify->watchdog();
  EXPECT_EQ(manager.next_message(), "READY=1");
}

TEST(SystemClock, runs_forward_and_returns_the_current_year) {
  const auto clock = make_system_clock();
  const std::int64_t first = clock->mono_ns();
  EXPECT_LE(first, clock->mono_ns());
  EXPECT_GT(clock->utime_us(), 1'600'000'000'000'000);
}

}  // namespace
}  // namespace slabd::hal
