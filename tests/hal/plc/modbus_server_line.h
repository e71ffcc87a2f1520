// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>

#include <array>
#include <cerrno>
#include <memory>
#include <vector>

#include "base/os.h"
#include "hal/hal.h"

/// A Modbus server, raw clients that send and receive bytes, and a clock set by the test.
namespace slabd::hal {

using Bytes = std::vector<std::uint8_t>;

inline void put(Bytes& bytes, unsigned word) {
  bytes.push_back(static_cast<std::uint8_t>(word >> 8U));
  bytes.push_back(static_cast<std::uint8_t>(word & 255U));
}

inline Bytes frame(unsigned transaction, const Bytes& pdu, std::uint8_t unit = 1) {
  Bytes bytes;
  put(bytes, transaction);
  put(bytes, 0);
  put(bytes, static_cast<unsigned>(pdu.size() + 1));
  bytes.push_back(unit);
  bytes.insert(bytes.end(), pdu.begin(), pdu.end());
  return bytes;
}

inline Bytes read_frame(unsigned transaction, std::uint8_t function, unsigned first, unsigned quantity) {
  Bytes pdu = {function};
  put(pdu, first);
  put(pdu, quantity);
  return frame(transaction, pdu);
}

inline Bytes write_frame(unsigned transaction, unsigned first, const std::vector<unsigned>& values) {
  Bytes pdu = {16};
  put(pdu, first);
  put(pdu, static_cast<unsigned>(values.size()));
  pdu.push_back(static_cast<std::uint8_t>(2 * values.size()));
  for (const unsigned v : values) put(pdu, v);
  return frame(transaction, pdu);
}

inline Bytes joined(std::initializer_list<Bytes> frames) {
  Bytes all;
  for (const Bytes& f : frames) all.insert(all.end(), f.begin(), f.end());
  return all;
}

/// A client that sends and receives raw bytes.
class RawClient {
 public:
  explicit RawClient(std::uint16_t port, const char* from = nullptr) : fd_(socket(AF_INET, SOCK_STREAM, 0)) {
    if (from != nullptr) {
      sockaddr_in own = address(from, 0);
      EXPECT_EQ(bind(fd_.get(), reinterpret_cast<const sockaddr*>(&own), sizeof own), 0);
    }
    const int one = 1;
    setsockopt(fd_.get(), IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
    const sockaddr_in server = address("127.0.0.1", port);
    EXPECT_EQ(connect(fd_.get(), reinterpret_cast<const sockaddr*>(&server), sizeof server), 0);
  }
  void send(const Bytes& bytes) const {
    EXPECT_EQ(::send(fd_.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL), static_cast<ssize_t>(bytes.size()));
  }
  /// Bytes that have arrived; waits up to a second for the first one if `wait`.
  [[nodiscard]] Bytes receive(bool wait = true) const {
    pollfd p{fd_.get(), POLLIN, 0};
    if (poll(&p, 1, wait ? 1000 : 0) != 1) return {};
    Bytes bytes(4096);
    const ssize_t n = recv(fd_.get(), bytes.data(), bytes.size(), MSG_DONTWAIT);
    bytes.resize(n > 0 ? static_cast<std::size_t>(n) : 0);
    return bytes;
  }
  [[nodiscard]] bool closed_by_server() const {
    pollfd p{fd_.get(), POLLIN, 0};
    if (poll(&p, 1, 1000) != 1) return false;
    std::uint8_t byte = 0;
    return recv(fd_.get(), &byte, 1, MSG_DONTWAIT | MSG_PEEK) <= 0;
  }
  [[nodiscard]] bool still_open() const {
    std::uint8_t byte = 0;
    const ssize_t n = recv(fd_.get(), &byte, 1, MSG_DONTWAIT | MSG_PEEK);
    return n > 0 || (n < 0 && errno == EAGAIN);
  }
  [[nodiscard]] int fd() const { return fd_.get(); }

 private:
  static sockaddr_in address(const char* host, std::uint16_t port) {
    sockaddr_in a{};
    a.sin_family = AF_INET;
    a.sin_port = htons(port);
    inet_pton(AF_INET, host, &a.sin_addr);
    return a;
  }
  Fd fd_;
};

class ModbusServerTest : public ::testing::Test {
 protected:
  void SetUp() override { open({}); }

  void open(PlcSettings settings) {
    settings.port = 0;
    auto made = make_modbus_server(settings);
    ASSERT_TRUE(made.ok()) << made.error().text.c_str();
    server_ = std::move(made.value());
  }

  /// Waits until a socket of the server is ready, then runs one turn. Returns the inputs after each write.
  std::vector<PlcInputs> turn(int wait_ms = 200) {
    std::array<pollfd, kPlcPollFds> fds{};
    const std::size_t count = server_->poll_fds(fds);
    poll(fds.data(), count, wait_ms);
    std::vector<PlcInputs> writes;
    PlcInputs inputs;
    while (server_->next(now_ns_, inputs)) writes.push_back(inputs);
    return writes;
  }
  std::unique_ptr<RawClient> connected(const char* from = nullptr) {
    auto client = std::make_unique<RawClient>(server_->bound_port(), from);
    turn();
    return client;
  }
  Bytes asked(const RawClient& client, const Bytes& request) {
    client.send(request);
    turn();
    return client.receive();
  }

  std::unique_ptr<ModbusServer> server_;
  std::int64_t now_ns_ = kNsPerS;
};

}  // namespace slabd::hal
