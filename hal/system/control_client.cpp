// SPDX-License-Identifier: Apache-2.0
#include "hal/system/control_client.h"

#include <poll.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>

#include <array>
#include <cerrno>
#include <cstring>

#include "base/limits.h"
#include "base/os.h"

namespace slabd::hal {
namespace {

using Fault = ControlAnswer::Fault;

Fd local_socket() {
  return Fd(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
}

/// Connects the socket; returns 0 or errno.
int connect_to(const std::string& path, const Fd& socket, int timeout_ms) {
  // A blocked daemon does not accept connections. Clients that gave up remain in its queue; once it is full, connect()
  // would block permanently.
  const timeval patience{timeout_ms / 1000, (timeout_ms % 1000) * 1000};
  ::setsockopt(socket.get(), SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.size() >= sizeof address.sun_path) return ENAMETOOLONG;
  std::memcpy(address.sun_path, path.c_str(), path.size() + 1);
  const bool connected =
      socket.is_open() &&
      ::connect(socket.get(), static_cast<const sockaddr*>(static_cast<const void*>(&address)), sizeof address) == 0;
  return connected ? 0 : errno;
}

ControlAnswer failed(Fault fault, int error_number = 0) {
  return {fault, error_number, {}};
}

}  // namespace

ControlAnswer ask_control(const std::string& path, std::string_view line, int timeout_ms) {
  const Fd socket = local_socket();
  if (const int fault = connect_to(path, socket, timeout_ms); fault != 0)
    return failed(fault == EAGAIN ? Fault::not_accepted : Fault::system, fault);
  if (::send(socket.get(), line.data(), line.size(), MSG_NOSIGNAL) != static_cast<ssize_t>(line.size()))
    return failed(Fault::system, errno);

  ControlAnswer answer;
  std::array<char, 4096> piece{};
  while (answer.line.find('\n') == std::string::npos) {
    pollfd waiting{socket.get(), POLLIN, 0};
    const int ready = ::poll(&waiting, 1, timeout_ms);
    if (ready == 0) return failed(Fault::silent);
    const ssize_t got = ready < 0 ? -1 : ::recv(socket.get(), piece.data(), piece.size(), 0);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return failed(Fault::system, errno);
    if (got == 0) return failed(Fault::closed);
    answer.line.append(piece.data(), static_cast<std::size_t>(got));
    if (answer.line.size() > limits::kControlLineBytes) return failed(Fault::too_long);
  }
  answer.line.resize(answer.line.find('\n'));
  return answer;
}

int try_control(const std::string& path, int timeout_ms, std::int64_t* process) {
  const Fd socket = local_socket();
  const int fault = connect_to(path, socket, timeout_ms);
  if (process == nullptr) return fault;
  ucred who{};
  socklen_t bytes = sizeof who;
  const bool known = fault == 0 && ::getsockopt(socket.get(), SOL_SOCKET, SO_PEERCRED, &who, &bytes) == 0;
  *process = known ? who.pid : 0;
  return fault;
}

}  // namespace slabd::hal
