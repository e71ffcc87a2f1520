// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

#include "base/os.h"
#include "hal/hal.h"

// Problem: maintenance tools communicate with the running daemon and must not delay it. Idea: fixed buffers, one line
// per client and turn, no waiting. Invariants: a line is answered before the next is read. A client is closed if it
// sends too much, too often or too slowly, or does not read its answer. The socket's mode restricts access to its owner
// and its group.
namespace slabd::hal {
namespace {

constexpr std::int64_t kIdleLimit_ns = 10 * kNsPerS;
/// If all places are taken, a client that has been silent for this long is replaced by the next one, which waits up to
/// 3 s.
constexpr std::int64_t kMakesRoom_ns = kNsPerS;
constexpr mode_t kOwnerAndGroup = 0660;
/// Rate limit of one client. A display requests data once or twice a second; a busy script must not take up the loop.
constexpr int kRequestsPerSecondMax = 20;

struct ControlClient {
  Fd fd;
  std::int64_t active_ns = 0;  ///< time of accepting, or of the last complete line
  std::size_t bytes = 0;       ///< bytes received and not handed out
  std::size_t handed_out = 0;  ///< bytes of the line that the caller uses, with its newline; dropped in the next turn
  bool served = false;         ///< a line this turn
  std::uint32_t uid = ControlPort::kUidUnknown;
  std::int64_t second_ns = 0;  ///< start of the second in which `requests` are counted
  int requests = 0;
  std::array<char, limits::kControlLineBytes> buffer;
};

class ControlSocket final : public ControlPort {
 public:
  ControlSocket(Fd listener, const PathText& path) : listener_(std::move(listener)), path_(path) {}
  ~ControlSocket() override { unlink(path_.c_str()); }
  ControlSocket(const ControlSocket&) = delete;
  ControlSocket& operator=(const ControlSocket&) = delete;

  std::size_t poll_fds(std::span<pollfd> fds) override {
    std::size_t count = 0;
    if (has_room()) fds[count++] = {listener_.get(), POLLIN, 0};
    for (const ControlClient& client : clients_) {
      if (!client.fd.is_open()) continue;
      // A line waiting in this buffer does not make the socket readable, but the socket is writable at once.
      const bool line_waits = line_end(client) != kNoLine;
      fds[count++] = {client.fd.get(), static_cast<short>(line_waits ? POLLIN | POLLOUT : POLLIN), 0};
    }
    return count;
  }

  bool next(std::int64_t mono_ns, std::string_view& line) override {
    drop_answered_line();
    if (!in_turn_) {
      in_turn_ = true;
      for (ControlClient& client : clients_) client.served = false;
      accept_clients(mono_ns);
    }
    for (ControlClient& client : clients_) {
      if (!client.fd.is_open() || client.served) continue;
      receive(client);
      if (take_line(client, mono_ns, line)) return true;
      close_if_unwanted(client, mono_ns);
    }
    in_turn_ = false;
    return false;
  }

  void reply(std::string_view json) override {
    if (current_ == nullptr) return;
    // Line and newline are sent separately, because the answers are large and copying them has no benefit.
    if (!send_all(*current_, json) || !send_all(*current_, "\n")) forget(*current_);
  }

  std::uint32_t peer_uid() const override { return current_ == nullptr ? kUidUnknown : current_->uid; }

 private:
  static constexpr std::size_t kNoLine = limits::kControlLineBytes;

  bool has_room() const {
    return std::any_of(clients_.begin(), clients_.end(), [](const ControlClient& c) { return !c.fd.is_open(); });
  }

  void accept_clients(std::int64_t mono_ns) {
    while (ControlClient* place = place_for_one_more(mono_ns)) {
      Fd fd(accept4(listener_.get(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC));
      if (!fd.is_open()) return;
      // Large enough for the largest answers, so that one send is enough.
      const int bytes = 1 << 20;
      setsockopt(fd.get(), SOL_SOCKET, SO_SNDBUF, &bytes, sizeof bytes);
      forget(*place);
      place->uid = uid_behind(fd);
      place->fd = std::move(fd);
      place->active_ns = mono_ns;
      place->second_ns = mono_ns;
      place->requests = 0;
    }
  }

  /// A free place, or that of the longest silent client, so that idle connections cannot keep other clients out.
  /// nullptr if there is none.
  ControlClient* place_for_one_more(std::int64_t mono_ns) {
    ControlClient* place = nullptr;
    for (ControlClient& client : clients_) {
      if (!client.fd.is_open()) return &client;
      const bool silent = mono_ns - client.active_ns > kMakesRoom_ns && !has_written(client);
      if (silent && (place == nullptr || client.active_ns < place->active_ns)) place = &client;
    }
    return place;
  }

  /// True if the client has sent data that this process has not read yet.
  static bool has_written(const ControlClient& client) {
    char byte = 0;
    return recv(client.fd.get(), &byte, 1, MSG_PEEK | MSG_DONTWAIT) > 0;
  }

  /// User id of the process that connected, from the kernel.
  static std::uint32_t uid_behind(const Fd& fd) {
    ucred peer{};
    socklen_t size = sizeof peer;
    return getsockopt(fd.get(), SOL_SOCKET, SO_PEERCRED, &peer, &size) == 0 ? peer.uid : kUidUnknown;
  }

  static void receive(ControlClient& client) {
    if (client.bytes == client.buffer.size()) return;
    const ssize_t n =
        recv(client.fd.get(), &client.buffer[client.bytes], client.buffer.size() - client.bytes, MSG_DONTWAIT);
    if (n > 0) client.bytes += static_cast<std::size_t>(n);
    const bool later = n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR);
    // A client may send its lines, shut down its sending half and wait: the lines are still answered.
    const bool finished = n == 0 && line_end(client) == kNoLine;
    if (finished || (n < 0 && !later)) forget(client);
  }

  /// Index of the first newline, or kNoLine.
  static std::size_t line_end(const ControlClient& client) {
    const auto end = client.buffer.begin() + static_cast<std::ptrdiff_t>(client.bytes);
    const auto newline = std::find(client.buffer.begin(), end, '\n');
    return newline == end ? kNoLine : static_cast<std::size_t>(newline - client.buffer.begin());
  }

  bool take_line(ControlClient& client, std::int64_t mono_ns, std::string_view& line) {
    const std::size_t end = client.fd.is_open() ? line_end(client) : kNoLine;
    if (end == kNoLine) return false;
    if (asks_too_often(client, mono_ns)) {
      forget(client);
      return false;
    }
    line = {client.buffer.data(), end};
    client.handed_out = end + 1;
    client.active_ns = mono_ns;
    client.served = true;
    current_ = &client;
    return true;
  }

  static bool asks_too_often(ControlClient& client, std::int64_t mono_ns) {
    if (mono_ns - client.second_ns >= kNsPerS) {
      client.second_ns = mono_ns;
      client.requests = 0;
    }
    return ++client.requests > kRequestsPerSecondMax;
  }

  void drop_answered_line() {
    if (current_ == nullptr) return;
    ControlClient& client = *current_;
    current_ = nullptr;
    if (!client.fd.is_open()) return;
    client.bytes -= client.handed_out;
    std::memmove(client.buffer.data(), client.buffer.data() + client.handed_out, client.bytes);
    client.handed_out = 0;
  }

  static void close_if_unwanted(ControlClient& client, std::int64_t mono_ns) {
    const bool oversized = client.bytes == client.buffer.size();
    if (oversized || mono_ns - client.active_ns > kIdleLimit_ns) forget(client);
  }

  static bool send_all(const ControlClient& client, std::string_view text) {
    return send(client.fd.get(), text.data(), text.size(), MSG_DONTWAIT | MSG_NOSIGNAL) ==
           static_cast<ssize_t>(text.size());
  }

  static void forget(ControlClient& client) {
    client.fd.reset();
    client.bytes = 0;
    client.handed_out = 0;
  }

  Fd listener_;
  PathText path_;
  std::array<ControlClient, limits::kControlClientsMax> clients_;
  ControlClient* current_ = nullptr;  ///< the client whose line the caller uses
  bool in_turn_ = false;
};

/// Removes the socket of a dead daemon at `address`; fails if another file or a listening process is there.
Status remove_stale(const char* path, const sockaddr_un& address) {
  struct stat status {};
  if (lstat(path, &status) != 0) {
    if (errno == ENOENT) return success();
    return error(Code::config, "control.socket %s: %s", path, errno_text(errno));
  }
  if (!S_ISSOCK(status.st_mode)) return error(Code::config, "control.socket %s: exists and is not a socket", path);
  const Fd probe(socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  const bool answered = connect(probe.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  // EAGAIN means that a busy process listens. Only a refused connection proves that no process listens.
  if (answered || errno != ECONNREFUSED)
    return error(Code::config, "control.socket %s: another process is listening there", path);
  if (unlink(path) != 0) return error(Code::config, "control.socket %s: %s", path, errno_text(errno));
  return success();
}

}  // namespace

Result<std::unique_ptr<ControlPort>> make_control_socket(const char* path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (std::strlen(path) == 0 || std::strlen(path) >= sizeof address.sun_path)
    return error(Code::config, "control.socket \"%.200s\": allowed are 1..%zu bytes", path,
                 sizeof address.sun_path - 1);
  std::memcpy(address.sun_path, path, std::strlen(path));
  if (Status status = remove_stale(path, address); !status) return status.error();

  Fd fd(socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  // fchmod before bind() protects the socket from the start; chmod after it reverts the effect of the umask.
  if (!fd.is_open() || fchmod(fd.get(), kOwnerAndGroup) != 0 ||
      bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 ||
      chmod(path, kOwnerAndGroup) != 0 || listen(fd.get(), static_cast<int>(limits::kControlClientsMax)) != 0)
    return error(Code::config, "control.socket %s: %s", path, errno_text(errno));
  return std::unique_ptr<ControlPort>(std::make_unique<ControlSocket>(std::move(fd), PathText(path)));
}

}  // namespace slabd::hal
