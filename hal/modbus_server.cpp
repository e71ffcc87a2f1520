// SPDX-License-Identifier: Apache-2.0
#include <arpa/inet.h>
#include <fcntl.h>
#include <modbus/modbus.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>

#include "hal/hal.h"
#include "hal/modbus_codec.h"
#include "hal/os.h"
#include "hal/plc_map.h"

// Problem: one slow, broken or hostile client must cost the PLC nothing, and no write of the PLC may be skipped.
// Idea: own non-blocking framing; libmodbus' modbus_reply() only ever sees whole requests that it can answer at once.
// Invariants:
//   - exactly one frame is read at a time, never a byte of the next: what waits stays in the kernel, where poll()
//     sees it, and the buffer cannot overflow;
//   - next() returns after each write, so the caller looks at every state the PLC has written;
//   - nothing blocks: a client that does not take its reply is closed;
//   - no heap after construction.
namespace slabd::hal {
namespace {

/// A frame must be whole this long after its first byte: one turn of a PLC's scan at the slowest, far below the
/// half second after which a PLC repeats itself.
constexpr std::int64_t kFrameDeadlineNs = ns_from_ms(300);
/// A client silent for this long has gone; a PLC speaks every 500 ms.
constexpr std::int64_t kIdleLimitNs = 60 * kNsPerS;
/// Pause of accepting when the process has no descriptors left.
constexpr std::int64_t kAcceptPauseNs = kNsPerS;
/// A dead link is noticed after 10 + 3 * 3 s by probes, after 5 s when a reply is not acknowledged.
constexpr int kKeepaliveIdleS = 10;
constexpr int kKeepaliveIntervalS = 3;
constexpr int kKeepaliveProbes = 3;
constexpr int kUnacknowledgedMs = 5000;
/// Replies the kernel keeps for a client that does not read, some hundreds; then it is closed.
constexpr int kSendBufferBytes = 1 << 16;

struct Client {
  Fd fd;
  std::uint32_t number = 0;
  std::int64_t active_ns = 0;      ///< accepted, or last whole frame
  std::int64_t first_byte_ns = 0;  ///< of the frame in `frame`
  std::size_t bytes = 0;
  std::size_t served = 0;                                   ///< frames this turn
  std::array<std::uint8_t, limits::kModbusAduMax> frame{};  ///< zero beyond `bytes`
};

struct ContextDeleter {
  void operator()(modbus_t* context) const { modbus_free(context); }
};
struct MappingDeleter {
  void operator()(modbus_mapping_t* mapping) const { modbus_mapping_free(mapping); }
};

void set_option(int fd, int level, int option, int value) {
  setsockopt(fd, level, option, &value, sizeof value);
}

void prepare_client(int fd) {
  set_option(fd, IPPROTO_TCP, TCP_NODELAY, 1);
  set_option(fd, SOL_SOCKET, SO_SNDBUF, kSendBufferBytes);
  set_option(fd, SOL_SOCKET, SO_KEEPALIVE, 1);
  set_option(fd, IPPROTO_TCP, TCP_KEEPIDLE, kKeepaliveIdleS);
  set_option(fd, IPPROTO_TCP, TCP_KEEPINTVL, kKeepaliveIntervalS);
  set_option(fd, IPPROTO_TCP, TCP_KEEPCNT, kKeepaliveProbes);
  set_option(fd, IPPROTO_TCP, TCP_USER_TIMEOUT, kUnacknowledgedMs);
}

class Server final : public ModbusServer {
 public:
  Server(const PlcServerSettings& settings, Fd listener, std::uint16_t port, modbus_t* context,
         modbus_mapping_t* mapping)
      : settings_(settings), port_(port), listener_(std::move(listener)), context_(context), mapping_(mapping) {
    publish(PlcOutputs{});
  }

  std::uint16_t bound_port() const override { return port_; }

  std::size_t poll_fds(std::span<pollfd> fds) override {
    std::size_t count = 0;
    if (now_ns_ >= accept_after_ns_) fds[count++] = {listener_.get(), POLLIN, 0};
    for (const Client& client : clients_)
      if (client.fd.is_open()) fds[count++] = {client.fd.get(), POLLIN, 0};
    return count;
  }

  bool next(std::int64_t mono_ns, PlcInputs& inputs) override {
    now_ns_ = mono_ns;
    if (!in_turn_) begin_turn();
    for (; turn_visited_ < clients_.size(); ++turn_visited_) {
      Client& client = clients_[(turn_first_ + turn_visited_) % clients_.size()];
      if (serve(client)) {
        inputs = decode_inputs(holding_image(), settings_.word_order);
        inputs.command_writer = command_writer_;
        return true;
      }
    }
    in_turn_ = false;
    return false;
  }

  void publish(const PlcOutputs& outputs) override {
    InputImage image;
    encode_outputs(outputs, settings_.word_order, image);
    std::copy(image.begin(), image.end(), mapping_->tab_input_registers);
    std::copy(image.begin(), image.end(), mapping_->tab_registers + kMirrorFirst);
  }

  std::size_t clients() const override {
    return static_cast<std::size_t>(
        std::count_if(clients_.begin(), clients_.end(), [](const Client& c) { return c.fd.is_open(); }));
  }

 private:
  /// Each turn starts at another client, so that none is always served last.
  void begin_turn() {
    in_turn_ = true;
    turn_first_ = (turn_first_ + 1) % clients_.size();
    turn_visited_ = 0;
    for (Client& client : clients_) client.served = 0;
    accept_clients();
  }

  // ---- accepting

  void accept_clients() {
    if (now_ns_ < accept_after_ns_) return;
    for (std::size_t i = 0; i < clients_.size(); ++i) {
      sockaddr_in peer{};
      socklen_t peer_bytes = sizeof peer;
      Fd fd(accept4(listener_.get(), reinterpret_cast<sockaddr*>(&peer), &peer_bytes, SOCK_NONBLOCK | SOCK_CLOEXEC));
      if (!fd.is_open()) {
        const bool exhausted = errno == EMFILE || errno == ENFILE || errno == ENOBUFS || errno == ENOMEM;
        if (exhausted) accept_after_ns_ = now_ns_ + kAcceptPauseNs;
        return;
      }
      if (!allowed(ntohl(peer.sin_addr.s_addr))) continue;
      prepare_client(fd.get());
      seat(std::move(fd));
    }
  }

  bool allowed(std::uint32_t address) const {
    return std::any_of(settings_.allow.begin(), settings_.allow.end(),
                       [address](const auto& network) { return (address & network.mask) == network.address; });
  }

  /// A free place, or that of the client that has been silent longest.
  void seat(Fd fd) {
    Client* place = &clients_[0];
    for (Client& client : clients_) {
      if (!client.fd.is_open()) {
        place = &client;
        break;
      }
      if (client.active_ns < place->active_ns) place = &client;
    }
    forget(*place);
    place->fd = std::move(fd);
    place->number = ++last_number_ == 0 ? ++last_number_ : last_number_;
    place->active_ns = now_ns_;
  }

  static void forget(Client& client) {
    client.fd.reset();
    clear_frame(client);
  }

  /// Zeroed, because libmodbus looks at an address even where a request is too short to have one.
  static void clear_frame(Client& client) {
    client.frame.fill(0);
    client.bytes = 0;
  }

  // ---- serving

  /// Serves what one client has waiting. True after a write.
  bool serve(Client& client) {
    while (client.fd.is_open() && client.served < limits::kModbusFramesPerTurn && receive(client)) {
      ++client.served;
      client.active_ns = now_ns_;
      const bool wrote = answer(client);
      clear_frame(client);
      if (wrote) return true;
    }
    close_if_late(client);
    return false;
  }

  /// Reads on until one frame is whole. False: not yet, or the client was closed.
  bool receive(Client& client) {
    for (;;) {
      std::size_t wanted = kMbapLengthEnd;
      if (client.bytes >= kMbapLengthEnd) {
        const auto whole = frame_bytes(std::span(client.frame).first<kMbapLengthEnd>());
        if (!whole) {
          forget(client);
          return false;
        }
        wanted = *whole;
        if (client.bytes == wanted) return true;
      }
      const ssize_t n = recv(client.fd.get(), &client.frame[client.bytes], wanted - client.bytes, MSG_DONTWAIT);
      if (n < 0 && errno == EINTR) continue;
      if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) return false;
      if (n <= 0) {
        forget(client);
        return false;
      }
      if (client.bytes == 0) client.first_byte_ns = now_ns_;
      client.bytes += static_cast<std::size_t>(n);
    }
  }

  /// Answers the whole frame of `client`; true when it has changed holding registers. A write counts even when its
  /// reply could not be sent: the registers have changed.
  bool answer(Client& client) {
    const auto frame = std::span<const std::uint8_t>(client.frame).first(client.bytes);
    const RequestCheck check = check_request(frame, settings_.unit_id);
    if (check.refusal) {
      const auto reply = exception_reply(frame, *check.refusal);
      if (send(client.fd.get(), reply.data(), reply.size(), MSG_NOSIGNAL | MSG_DONTWAIT) !=
          static_cast<ssize_t>(reply.size()))
        forget(client);
      return false;
    }
    modbus_set_socket(context_.get(), client.fd.get());
    const int sent = modbus_reply(context_.get(), frame.data(), static_cast<int>(frame.size()), mapping_.get());
    if (check.writes_command) command_writer_ = client.number;
    if (sent < 0) forget(client);
    return check.writes;
  }

  void close_if_late(Client& client) {
    if (!client.fd.is_open()) return;
    const bool frame_late = client.bytes > 0 && now_ns_ - client.first_byte_ns > kFrameDeadlineNs;
    if (frame_late || now_ns_ - client.active_ns > kIdleLimitNs) forget(client);
  }

  HoldingImage holding_image() const {
    HoldingImage image;
    std::copy_n(mapping_->tab_registers, image.size(), image.begin());
    return image;
  }

  PlcServerSettings settings_;
  std::uint16_t port_;
  Fd listener_;
  std::unique_ptr<modbus_t, ContextDeleter> context_;
  std::unique_ptr<modbus_mapping_t, MappingDeleter> mapping_;
  std::array<Client, limits::kModbusClientsMax> clients_;
  std::uint32_t last_number_ = 0;
  std::uint32_t command_writer_ = 0;

  std::int64_t now_ns_ = 0;
  std::int64_t accept_after_ns_ = 0;
  bool in_turn_ = false;
  std::size_t turn_first_ = 0;
  std::size_t turn_visited_ = 0;
};

/// Opens the listening socket and reports the port it got.
Result<Fd> listen_on(const PlcServerSettings& settings, std::uint16_t& port) {
  const char* host = settings.host.c_str();
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(settings.port);
  if (inet_pton(AF_INET, host, &address.sin_addr) != 1)
    return error(Code::config, "plc.listen: host \"%s\" is not an IPv4 address (such as 127.0.0.1 or 0.0.0.0)", host);
  Fd fd(socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (!fd.is_open()) return error(Code::config, "plc.listen: no socket: %s", errno_text(errno));
  set_option(fd.get(), SOL_SOCKET, SO_REUSEADDR, 1);
  if (bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 ||
      listen(fd.get(), static_cast<int>(limits::kModbusClientsMax)) != 0) {
    const char* cure = errno == EADDRINUSE      ? " (another program serves this port)"
                       : errno == EACCES        ? " (ports below 1024 need CAP_NET_BIND_SERVICE)"
                       : errno == EADDRNOTAVAIL ? " (no interface has this address)"
                                                : "";
    return error(Code::config, "plc.listen %s:%u: %s%s", host, unsigned{settings.port}, errno_text(errno), cure);
  }
  socklen_t bytes = sizeof address;
  getsockname(fd.get(), reinterpret_cast<sockaddr*>(&address), &bytes);
  port = ntohs(address.sin_port);
  return fd;
}

}  // namespace

Result<std::unique_ptr<ModbusServer>> make_modbus_server(const PlcServerSettings& settings) {
  if (settings.unit_id < 1 || settings.unit_id > 247)
    return error(Code::config, "plc.unit_id is %u, allowed 1..247", unsigned{settings.unit_id});
  PlcServerSettings complete = settings;
  // Nobody named: this computer only, never everybody.
  if (complete.allow.empty()) static_cast<void>(complete.allow.push({0x7F000000U, 0xFF000000U}));
  std::uint16_t port = 0;
  Result<Fd> listener = listen_on(complete, port);
  if (!listener) return listener.error();

  // The address given here is never connected to; the context only carries the socket for modbus_reply().
  modbus_t* context = modbus_new_tcp("127.0.0.1", 1502);
  modbus_mapping_t* mapping = modbus_mapping_new(0, 0, kMirrorFirst + kInputRegisters, kInputRegisters);
  if (context == nullptr || mapping == nullptr) {
    modbus_free(context);
    if (mapping != nullptr) modbus_mapping_free(mapping);
    return error(Code::internal, "libmodbus: %s", errno_text(errno));
  }
  // What libmodbus sleeps before an exception of its own. None is ever reached; if one were, it must not stall.
  modbus_set_response_timeout(context, 0, 1);
  return std::unique_ptr<ModbusServer>(
      std::make_unique<Server>(complete, std::move(listener.value()), port, context, mapping));
}

Result<PlcServerSettings::Network> parse_network(std::string_view cidr) {
  const std::size_t slash = cidr.find('/');
  const std::string_view address_part = cidr.substr(0, slash);
  const FixedString<INET_ADDRSTRLEN> address_text(address_part);  // for its terminator
  const FixedString<64> shown(cidr);
  in_addr address{};
  if (address_part.size() >= INET_ADDRSTRLEN || inet_pton(AF_INET, address_text.c_str(), &address) != 1)
    return error(Code::config, "\"%s\" is not an IPv4 network (such as 10.0.0.0/8)", shown.c_str());
  unsigned bits = 32;
  if (slash != std::string_view::npos) {
    const std::string_view text = cidr.substr(slash + 1);
    const auto [end, failed] = std::from_chars(text.data(), text.data() + text.size(), bits);
    if (failed != std::errc{} || end != text.data() + text.size() || bits > 32)
      return error(Code::config, "\"%s\": prefix length \"%.*s\", allowed 0..32", shown.c_str(),
                   static_cast<int>(std::min<std::size_t>(text.size(), 16)), text.data());
  }
  PlcServerSettings::Network network;
  network.mask = bits == 0 ? 0U : ~0U << (32 - bits);
  network.address = ntohl(address.s_addr);
  if ((network.address & ~network.mask) != 0)
    return error(Code::config, "\"%s\" has bits set beyond its /%u prefix", shown.c_str(), bits);
  return network;
}

}  // namespace slabd::hal
