// SPDX-License-Identifier: Apache-2.0
#include "cli/client/control.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <nlohmann/json.hpp>

#include "base/limits.h"
#include "base/os.h"
#include "cli/terminal/say.h"

namespace slabd::cli {
namespace {

constexpr int kAnswerTimeout_ms = 3'000;

Fd local_socket() {
  return Fd(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
}

Error unreachable(const std::string& path, const std::string& cause) {
  return said_error(
      Code::scanner_offline,
      say("slabd does not answer on {}: {}; is it running (systemctl status slabd), and are you in its group?", path,
          cause));
}

/// Connects the socket; returns 0 or errno. EAGAIN: the daemon listens, but does not accept.
int connect_to(const std::string& path, const Fd& socket) {
  // A blocked daemon does not accept connections. Clients that gave up remain in its queue; once it is full, connect()
  // would block permanently.
  const timeval patience{kAnswerTimeout_ms / 1000, 0};
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

}  // namespace

std::int64_t daemon_process(const std::string& path) {
  const Fd socket = local_socket();
  ucred who{};
  socklen_t bytes = sizeof who;
  if (connect_to(path, socket) != 0 || ::getsockopt(socket.get(), SOL_SOCKET, SO_PEERCRED, &who, &bytes) != 0) return 0;
  return who.pid;
}

Result<std::string> ask_daemon(const std::string& path, std::string_view line) {
  const Fd socket = local_socket();
  if (const int fault = connect_to(path, socket); fault != 0)
    return unreachable(
        path, fault == EAGAIN ? say("it listens, but takes no question within 3 s") : quote(std::strerror(fault)));
  if (::send(socket.get(), line.data(), line.size(), MSG_NOSIGNAL) != static_cast<ssize_t>(line.size()))
    return unreachable(path, quote(std::strerror(errno)));

  std::string answer;
  std::array<char, 4096> piece{};
  while (answer.find('\n') == std::string::npos) {
    pollfd waiting{socket.get(), POLLIN, 0};
    const int ready = ::poll(&waiting, 1, kAnswerTimeout_ms);
    if (ready == 0) return unreachable(path, say("connected, but no answer within 3 s"));
    const ssize_t got = ready < 0 ? -1 : ::recv(socket.get(), piece.data(), piece.size(), 0);
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) return unreachable(path, got == 0 ? say("it closed the connection") : quote(std::strerror(errno)));
    answer.append(piece.data(), static_cast<std::size_t>(got));
    if (answer.size() > limits::kControlLineBytes) return unreachable(path, say("the answer is longer than 64 kB"));
  }
  return answer.substr(0, answer.find('\n'));
}

bool daemon_has_database(const std::string& path) {
  {
    const Fd socket = local_socket();
    const int fault = connect_to(path, socket);
    if (fault == EAGAIN || fault == EACCES) return true;
    if (fault != 0) return false;
  }
  const Result<std::string> answer = ask_daemon(path, "{\"verb\":\"status\"}\n");
  if (!answer) return true;
  const nlohmann::json status = nlohmann::json::parse(answer.value(), nullptr, false);
  const nlohmann::json fault = status.is_object() ? status.value("fault", nlohmann::json()) : nlohmann::json();
  return !fault.is_object() || fault.value("code", nlohmann::json()) != static_cast<int>(Code::config);
}

}  // namespace slabd::cli
