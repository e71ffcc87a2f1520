// SPDX-License-Identifier: Apache-2.0
#include "tests/places/ports.h"

#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstddef>
#include <random>
#include <stdexcept>
#include <string>

namespace slabd::places {
namespace {

// Below the range from which the kernel assigns ports (net.ipv4.ip_local_port_range, from 32768).
constexpr unsigned kFirst = 20'000;
constexpr unsigned kCount = 10'000;

/// Claims a port until the process ends, with the same name as ports.py. The name is an abstract socket: the
/// kernel removes it with the process, and like ports it belongs to a network namespace.
bool claim(unsigned port) {
  const std::string name = "slabd-test-port-" + std::to_string(port);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  name.copy(&address.sun_path[1], name.size());
  const auto bytes = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + name.size());
  const int fd = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) throw std::runtime_error("no socket to claim a port with");
  if (::bind(fd, static_cast<const sockaddr*>(static_cast<const void*>(&address)), bytes) == 0) return true;
  ::close(fd);
  return false;
}

/// True if the port is not used by a process that does not claim its ports.
bool is_free(unsigned port, int type) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  const int fd = ::socket(AF_INET, type | SOCK_CLOEXEC, 0);
  const bool free = ::bind(fd, static_cast<const sockaddr*>(static_cast<const void*>(&address)), sizeof address) == 0;
  ::close(fd);
  return free;
}

}  // namespace

std::uint16_t own_port() {
  const unsigned begin = std::random_device{}();
  for (unsigned i = 0; i < kCount; ++i) {
    const unsigned port = kFirst + (begin + i) % kCount;
    if (claim(port) && is_free(port, SOCK_STREAM) && is_free(port, SOCK_DGRAM)) return static_cast<std::uint16_t>(port);
  }
  throw std::runtime_error("no free port");
}

}  // namespace slabd::places
