// SPDX-License-Identifier: Apache-2.0
#include "hal/plc/modbus_probe.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>

#include <array>
#include <chrono>
#include <optional>

#include "base/os.h"

namespace slabd::hal {
namespace {

using Steady = std::chrono::steady_clock;

/// Waits for `events`, at most until `until`.
bool ready(int fd, short events, Steady::time_point until) {
  const auto left_ms = std::chrono::duration_cast<std::chrono::milliseconds>(until - Steady::now()).count();
  pollfd one{fd, events, 0};
  return left_ms > 0 && poll(&one, 1, static_cast<int>(left_ms)) == 1 && (one.revents & events) != 0;
}

struct Answer {
  unsigned transaction = 0;
  std::chrono::milliseconds after{};
};

/// Reads one holding register with this transaction number. nullopt if no complete answer arrived.
std::optional<Answer> ask(int fd, const PlcSettings& settings, unsigned transaction) {
  const auto byte = [](unsigned value) { return static_cast<std::uint8_t>(value & 0xFFU); };
  const unsigned base = settings.command_base;
  const std::array<std::uint8_t, 12> question = {
      byte(transaction >> 8U), byte(transaction), 0, 0, 0, 6, settings.unit_id, 3, byte(base >> 8U), byte(base), 0, 1};
  const Steady::time_point began = Steady::now();
  const Steady::time_point until = began + 3 * std::chrono::nanoseconds(settings.timeout_ns);
  if (send(fd, question.data(), question.size(), MSG_NOSIGNAL) != static_cast<ssize_t>(question.size()))
    return std::nullopt;
  std::array<std::uint8_t, 260> answer{};
  for (std::size_t bytes = 0; bytes < 6U || bytes < 6U + (unsigned{answer[4]} << 8U | answer[5]);) {
    if (bytes == answer.size() || !ready(fd, POLLIN, until)) return std::nullopt;
    const ssize_t n = recv(fd, answer.data() + bytes, answer.size() - bytes, MSG_DONTWAIT);
    if (n <= 0) return std::nullopt;
    bytes += static_cast<std::size_t>(n);
  }
  return Answer{unsigned{answer[0]} << 8U | answer[1],
                std::chrono::duration_cast<std::chrono::milliseconds>(Steady::now() - began)};
}

}  // namespace

FixedString<160> fault_of_answers(const PlcSettings& settings) {
  FixedString<160> fault;
  const Fd fd(socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(settings.port);
  if (!fd.is_open() || inet_pton(AF_INET, settings.host.c_str(), &address.sin_addr) != 1) return fault;
  static_cast<void>(connect(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address));
  if (!ready(fd.get(), POLLOUT, Steady::now() + std::chrono::nanoseconds(settings.timeout_ns))) return fault;
  constexpr unsigned kFirst = 0x1234;
  constexpr unsigned kSecond = 0x5678;
  const std::optional<Answer> first = ask(fd.get(), settings, kFirst);
  if (!first) return fault;
  const std::optional<Answer> second = ask(fd.get(), settings, kSecond);
  const auto timeout = std::chrono::nanoseconds(settings.timeout_ns);
  if (second && second->transaction == kFirst) {
    fault = "its answers have the transaction number of the request before";
  } else if (first->transaction != kFirst) {
    fault.printf("its answers have transaction number %u, not that of the request", first->transaction);
  } else if (first->after > timeout && (!second || second->after > timeout)) {
    fault.printf("its answers arrive after %lld ms: plc.timeout_ms is %lld",
                 static_cast<long long>(first->after.count()), static_cast<long long>(settings.timeout_ns / kNsPerMs));
  }
  return fault;
}

}  // namespace slabd::hal
