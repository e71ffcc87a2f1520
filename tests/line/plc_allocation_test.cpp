// SPDX-License-Identifier: Apache-2.0
//
// No role of the PLC's link uses the heap once it has a connection: server, client with its thread, serial line. The
// other end uses plain sockets here, so that every heap call of the process belongs to the link.
#include <arpa/inet.h>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdlib>

#include "base/os.h"
#include "hal/hal.h"
#include "hal/plc/modbus_codec.h"
#include "hal/plc/plc_map.h"
#include "heap_count.h"

namespace slabd::hal {
namespace {

using Adu = std::array<std::uint8_t, 300>;
constexpr int kExchanges = 200;

std::uint8_t high(unsigned word) {
  return static_cast<std::uint8_t>(word >> 8U);
}
std::uint8_t low(unsigned word) {
  return static_cast<std::uint8_t>(word & 0xFFU);
}

sockaddr_in loopback(std::uint16_t port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

/// One turn of the loop for the PLC port only.
void turn(PlcPort& port, const PlcOutputs& outputs, std::int64_t now_ns) {
  std::array<pollfd, kPlcPollFds> fds{};
  const std::size_t count = port.poll_fds(fds);
  poll(fds.data(), count, 20);
  PlcInputs inputs;
  port.publish(outputs);
  while (port.next(now_ns, inputs)) port.publish(outputs);
}

TEST(PlcAllocation, none_in_a_server_that_is_read_and_written) {
  PlcSettings settings;
  settings.port = 0;
  auto server = make_modbus_server(settings);
  ASSERT_TRUE(server.ok());
  const Fd plc(socket(AF_INET, SOCK_STREAM, 0));
  const sockaddr_in address = loopback(server.value()->bound_port());
  ASSERT_EQ(connect(plc.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  PlcOutputs outputs;
  std::int64_t now_ns = kNsPerS;
  const auto exchange = [&](std::uint16_t n) {
    const std::array<std::uint8_t, 12> read = {high(n), low(n), 0, 0, 0, 6, 1, 4, 0, 0, 0, 110};
    const std::array<std::uint8_t, 12> write = {high(n), low(n), 0, 0, 0, 6, 1, 6, 0, 0, high(n), low(n)};
    ++outputs.heartbeat;
    now_ns += 50 * kNsPerMs;
    std::size_t answered = 0;
    send(plc.get(), read.data(), read.size(), MSG_NOSIGNAL);
    send(plc.get(), write.data(), write.size(), MSG_NOSIGNAL);
    for (int i = 0; i < 20 && answered < 229 + 12; ++i) {
      turn(*server.value(), outputs, now_ns);
      Adu answer{};
      answered +=
          static_cast<std::size_t>(std::max<ssize_t>(0, recv(plc.get(), answer.data(), answer.size(), MSG_DONTWAIT)));
    }
    return answered == 229 + 12;
  };
  ASSERT_TRUE(exchange(1));
  const HeapCount count(HeapCount::Of::every_thread);
  bool all = true;
  for (std::uint16_t n = 2; n < kExchanges; ++n) all &= exchange(n);
  const std::uint64_t calls = count.calls();
  EXPECT_TRUE(all);
  EXPECT_EQ(calls, 0U);
}

TEST(PlcAllocation, none_in_a_client_and_its_thread) {
  const Fd listener(socket(AF_INET, SOCK_STREAM, 0));
  sockaddr_in address = loopback(0);
  socklen_t bytes = sizeof address;
  ASSERT_EQ(bind(listener.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  ASSERT_EQ(listen(listener.get(), 1), 0);
  ASSERT_EQ(getsockname(listener.get(), reinterpret_cast<sockaddr*>(&address), &bytes), 0);
  PlcSettings settings;
  settings.role = PlcRole::client;
  settings.port = ntohs(address.sin_port);
  settings.poll_ns = 2 * kNsPerMs;
  settings.timeout_ns = 20 * kNsPerS;
  auto client = make_plc_port(settings);
  ASSERT_TRUE(client.ok()) << client.error().text.c_str();
  const Fd slabd(accept(listener.get(), nullptr, nullptr));
  ASSERT_TRUE(slabd.is_open());
  PlcOutputs outputs;
  std::int64_t now_ns = kNsPerS;
  /// Answers one request as a PLC does; the memory changes with `n`.
  const auto exchange = [&](std::uint16_t n) {
    Adu request{};
    pollfd p{slabd.get(), POLLIN, 0};
    if (poll(&p, 1, 60'000) != 1 || recv(slabd.get(), request.data(), request.size(), 0) < 12) return false;
    Adu answer{};
    std::copy_n(request.begin(), 8, answer.begin());
    std::size_t size = 12;
    if (request[7] == 3) {
      const unsigned registers = request[11];
      answer[8] = low(2 * registers);
      answer[10] = low(n);  // PLC_HEARTBEAT
      size = 9 + 2 * registers;
    } else {
      std::copy_n(request.begin() + 8, 4, answer.begin() + 8);
    }
    answer[5] = low(static_cast<unsigned>(size - 6));
    if (send(slabd.get(), answer.data(), size, MSG_NOSIGNAL) != static_cast<ssize_t>(size)) return false;
    ++outputs.heartbeat;
    now_ns += 50 * kNsPerMs;
    turn(*client.value(), outputs, now_ns);
    return true;
  };
  for (std::uint16_t n = 1; n < 5; ++n) ASSERT_TRUE(exchange(n));
  const HeapCount count(HeapCount::Of::every_thread);
  bool all = true;
  for (std::uint16_t n = 5; n < kExchanges; ++n) all &= exchange(n);
  const std::uint64_t calls = count.calls();
  EXPECT_TRUE(all);
  EXPECT_EQ(client.value()->counters().connections, 1U);
  EXPECT_EQ(calls, 0U);
}

TEST(PlcAllocation, none_on_a_serial_line) {
  const Fd master(posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK));
  ASSERT_TRUE(master.is_open());
  ASSERT_EQ(grantpt(master.get()), 0);
  ASSERT_EQ(unlockpt(master.get()), 0);
  PlcSettings settings;
  settings.role = PlcRole::rtu;
  settings.unit_id = 17;
  settings.device = std::string_view(ptsname(master.get()));
  settings.parity = SerialParity::none;  // a pseudo-terminal has no parity
  auto line = make_plc_port(settings);
  ASSERT_TRUE(line.ok()) << line.error().text.c_str();
  PlcOutputs outputs;
  std::int64_t now_ns = kNsPerS;
  const auto exchange = [&](std::uint16_t n) {
    std::array<std::uint8_t, 8> request = {17, 4, 0, 0, 0, 110};
    const bool writes = n % 2 == 0;
    if (writes) request = {17, 6, 0, 0, high(n), low(n)};
    const std::uint16_t crc = crc16_of_bytes(std::span(request).first(6));
    request[6] = low(crc);
    request[7] = high(crc);
    if (write(master.get(), request.data(), request.size()) != static_cast<ssize_t>(request.size())) return false;
    const std::size_t wanted = writes ? 8 : 5 + 220;
    std::size_t answered = 0;
    ++outputs.heartbeat;
    for (int i = 0; i < 50 && answered < wanted; ++i) {
      now_ns += 10 * kNsPerMs;
      turn(*line.value(), outputs, now_ns);
      Adu answer{};
      answered += static_cast<std::size_t>(std::max<ssize_t>(0, read(master.get(), answer.data(), answer.size())));
    }
    return answered == wanted;
  };
  for (std::uint16_t n = 1; n < 5; ++n) ASSERT_TRUE(exchange(n));
  const HeapCount count(HeapCount::Of::every_thread);
  bool all = true;
  for (std::uint16_t n = 5; n < kExchanges; ++n) all &= exchange(n);
  const std::uint64_t calls = count.calls();
  EXPECT_TRUE(all);
  EXPECT_EQ(calls, 0U);
}

}  // namespace
}  // namespace slabd::hal
