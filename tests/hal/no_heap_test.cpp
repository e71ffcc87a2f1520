// SPDX-License-Identifier: Apache-2.0
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <malloc.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <memory>
#include <slabd/flange_pose_t.hpp>
#include <thread>
#include <vector>

#include "base/os.h"
#include "hal/hal.h"
#include "hal/plc/plc_map.h"
#include "tests/hal/temporary_folder.h"
#include "tests/places/ports.h"
#include "tests/places/wait.h"

// The ports must not use the heap once they are made. Here every allocation of a watched thread is counted, including
// those of libmodbus and the C library.
namespace {
thread_local bool watched = false;
std::atomic<int> allocations = 0;

void count() {
  if (watched) ++allocations;
}
}  // namespace

extern "C" {
void* __libc_malloc(std::size_t bytes);
void* __libc_calloc(std::size_t count, std::size_t bytes);
void* __libc_realloc(void* old, std::size_t bytes);
void* __libc_memalign(std::size_t alignment, std::size_t bytes);

void* malloc(std::size_t bytes) {
  count();
  return __libc_malloc(bytes);
}
void* calloc(std::size_t number, std::size_t bytes) {
  count();
  return __libc_calloc(number, bytes);
}
void* realloc(void* old, std::size_t bytes) {
  count();
  return __libc_realloc(old, bytes);
}
void* aligned_alloc(std::size_t alignment, std::size_t bytes) {
  count();
  return __libc_memalign(alignment, bytes);
}
}

namespace slabd::hal {
namespace {

/// Allocations of this thread while `work` runs.
template <typename Work>
int allocations_of(Work work) {
  allocations = 0;
  watched = true;
  work();
  watched = false;
  return allocations;
}

template <typename Address>
void connect_to(const Fd& fd, const Address& address) {
  ASSERT_EQ(connect(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0) << std::strerror(errno);
}

TEST(NoHeap, reports_an_allocation_under_the_guard) {
  EXPECT_EQ(allocations_of([] { free(malloc(1)); }), 1);
  int* volatile kept = nullptr;
  EXPECT_GE(allocations_of([&] { kept = new int(1); }), 1);
  delete kept;
}

TEST(NoHeap, serving_a_plc) {
  PlcSettings settings;
  settings.port = 0;
  auto server = make_modbus_server(settings);
  ASSERT_TRUE(server.ok());
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(server.value()->bound_port());
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  const Fd plc(socket(AF_INET, SOCK_STREAM, 0));
  connect_to(plc, address);
  // Write HR 39, read everything, a refused function, a read and write in one.
  const std::array<std::uint8_t, 12 + 12 + 8 + 19> requests = {
      0, 1, 0, 0, 0, 6, 1, 6, 0, 39, 0, 5,  0, 2,  0, 0,   0, 6,   1, 4,  0, 0, 0, 110, 0, 3,
      0, 0, 0, 2, 1, 7, 0, 4, 0, 0,  0, 13, 1, 23, 3, 232, 0, 110, 0, 10, 0, 1, 2, 0,   1};
  ASSERT_EQ(send(plc.get(), requests.data(), requests.size(), 0), static_cast<ssize_t>(requests.size()));
  int writes = 0;
  const int made = allocations_of([&] {
    std::array<pollfd, kPlcPollFds> fds{};
    PlcInputs inputs;
    for (int turn = 0; turn < 5 || (turn < 1'000 && writes < 2); ++turn) {
      poll(fds.data(), server.value()->poll_fds(fds), 60);
      while (server.value()->next(kNsPerS, inputs)) ++writes;
      server.value()->publish(PlcOutputs{});
    }
  });
  EXPECT_EQ(made, 0);
  EXPECT_EQ(writes, 2) << "it did serve";
}

TEST(NoHeap, receiving_poses) {
  flange_pose_t message{};
  message.quat[0] = 1.0;
  std::vector<std::byte> datagram(8 + 12 + 92);
  std::memcpy(datagram.data(), "LC02\0\0\0\1FLANGE_POSE", 20);
  message.encode(datagram.data() + 20, 0, 92);
  PoseSample sample;
  PoseLinkCounters counters;
  EXPECT_EQ(allocations_of([&] {
              for (int i = 0; i < 100; ++i)
                static_cast<void>(decode_pose_datagram(datagram, "FLANGE_POSE", sample, counters));
            }),
            0);
  EXPECT_EQ(counters.accepted, 100U);

  // The open port, including its once-a-second check of the interface.
  LcmSettings settings;
  settings.url.printf("udpm://239.255.76.68:%u?ttl=0", unsigned{places::own_port()});
  settings.interface = "127.0.0.1";
  auto port = make_lcm_pose_port(settings);
  ASSERT_TRUE(port.ok());
  static_cast<void>(port.value()->next(0, sample));
  ASSERT_TRUE(port.value()->trouble().empty()) << port.value()->trouble();
  EXPECT_EQ(allocations_of([&] {
              for (int s = 1; s < 5; ++s) static_cast<void>(port.value()->next(s * kNsPerS, sample));
            }),
            0);
}

TEST(NoHeap, acquiring_a_scan) {
  test::TemporaryFolder folder;
  const std::unique_ptr<Clock> clock = make_system_clock();
  ScanDropSettings settings;
  settings.drop_dir = PathText(folder.string());
  auto scanner = make_scan_drop(settings, *clock);
  ASSERT_TRUE(scanner.ok());
  scanner.value()->idle();
  std::vector<float> xyz(3 * limits::kScanPointsMin, 1.0F);
  ASSERT_TRUE(write_ply((folder / "inbox/1-1.part").c_str(), xyz, 0, 0).ok());
  ScanRequest request;
  request.session = 1;
  request.cmd_seq = 1;
  request.spool_path = PathText(folder / "spool/a/b");
  std::thread software([&] {
    const bool asked = places::wait_until([&] { return std::filesystem::exists(folder / "request/1-1.json"); });
    EXPECT_TRUE(asked) << "there is no request";
    std::filesystem::rename(folder / "inbox/1-1.part", folder / "inbox/1-1.ply");
  });
  const std::atomic<bool> cancel = false;
  bool acquired = false;
  const int made = allocations_of([&] {
    scanner.value()->idle();
    acquired = scanner.value()->acquire(request, xyz, cancel, [](const AcquiredScan&) {}).ok();
  });
  software.join();
  EXPECT_TRUE(acquired);
  EXPECT_EQ(made, 0);
}

TEST(NoHeap, reading_every_scan_format) {
  test::TemporaryFolder folder;
  std::vector<float> xyz(3 * limits::kScanPointsMin);
  Prng prng(7);
  for (float& v : xyz) v = static_cast<float>(prng.normal());
  std::vector<std::string> paths;
  for (const ScanFormat format : kScanFormats) {
    paths.push_back(folder / (std::string(name(format)) + "." + std::string(extension(format))));
    ASSERT_TRUE(write_scan(paths.back().c_str(), format, xyz, 0, 0).ok());
  }
  test::write_file(folder / "bad.ply", "ply\nformat ascii 1.0\nelement vertex x\n");
  test::write_file(folder / "bad.pcd", "VERSION 0.7\nFIELDS x y\n");
  test::write_file(folder / "bad.csv", "x;y;z\n1,5;2;3\n");
  const std::vector<std::string> bad = {folder / "bad.ply", folder / "bad.pcd", folder / "bad.csv", folder / "bad.stl"};
  std::vector<float> read(xyz.size());
  for (const std::string& path : paths) {
    std::fill(read.begin(), read.end(), 0.0F);
    bool good = false;
    EXPECT_EQ(allocations_of([&] { good = read_scan(path.c_str(), LengthUnit::mm, read).ok(); }), 0) << path;
    EXPECT_TRUE(good) << path;
    EXPECT_TRUE(read == xyz) << path;
  }
  for (const std::string& path : bad) {
    bool good = true;
    EXPECT_EQ(allocations_of([&] { good = read_scan(path.c_str(), LengthUnit::mm, read).ok(); }), 0) << path;
    EXPECT_FALSE(good) << path;
  }
}

TEST(NoHeap, answering_on_the_control_socket) {
  test::TemporaryFolder folder;
  const std::string path = folder / "control.sock";
  auto port = make_control_socket(path.c_str());
  ASSERT_TRUE(port.ok());
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, path.c_str(), path.size());
  const Fd client(socket(AF_UNIX, SOCK_STREAM, 0));
  connect_to(client, address);
  ASSERT_EQ(send(client.get(), "{}\n", 3, 0), 3);
  int lines = 0;
  EXPECT_EQ(allocations_of([&] {
              for (std::string_view line; port.value()->next(kNsPerS, line); ++lines) port.value()->reply("{}");
            }),
            0);
  EXPECT_EQ(lines, 1);
}

}  // namespace
}  // namespace slabd::hal
