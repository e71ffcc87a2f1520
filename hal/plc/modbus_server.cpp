// SPDX-License-Identifier: Apache-2.0
#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <charconv>
#include <cstring>

#include "base/os.h"
#include "hal/hal.h"
#include "hal/plc/modbus_codec.h"
#include "hal/plc/plc_map.h"
#include "hal/plc/plc_notes.h"

// Problem: a slow, broken or hostile client must not delay the PLC, and no write of the PLC may be skipped.
// Idea: non-blocking framing in front of the codec, one small buffer for each client, deadlines instead of waits.
// Invariants:
//   - One frame is read at a time, without any byte of the next. Waiting bytes stay in the kernel, where poll() reports
//     them, and the buffer cannot overflow.
//   - next() returns after each write, so that the caller processes every state that the PLC has written.
//   - Nothing blocks: a client that does not accept its reply is closed.
//   - The commanding client cannot be displaced: if all places are taken, clients without a request are closed first,
//     then displays.
//   - The command block belongs to one connection: a write of another connection first clears it.
//   - no heap after construction.
namespace slabd::hal {
namespace {

/// Time after its first byte in which a frame must be complete. It covers one scan cycle of the slowest PLC, and a PLC
/// repeats its request only after half a second.
constexpr std::int64_t kFrameDeadline_ns = ns_from_ms(300);
/// Silence after which a client is closed; a PLC sends a request every 500 ms.
constexpr std::int64_t kIdleLimit_ns = 60 * kNsPerS;
/// Pause before the next accept() if the process has no descriptors left.
constexpr std::int64_t kAcceptPause_ns = kNsPerS;
/// Length of the kernel's queue of connections, and the number accepted in one turn. A PLC that connects during a flood
/// of connections must not wait long. Accepting only half of the places ensures that a new client is served once before
/// it can be displaced. Each accept takes about ten microseconds.
constexpr int kBacklog = 128;
constexpr int kAcceptsPerTurn = static_cast<int>(limits::kModbusClientsMax / 2);
/// A dead link is detected after 10 + 3 * 3 s by probes, after 5 s if a reply is not acknowledged.
constexpr int kKeepaliveIdleS = 10;
constexpr int kKeepaliveIntervalS = 3;
constexpr int kKeepaliveProbes = 3;
constexpr int kUnacknowledged_ms = 5000;
/// The last writer of the command block keeps its place while it sends a frame at least this often (a PLC: every 500
/// ms).
constexpr std::int64_t kOwnerSilence_ns = 5 * kNsPerS;
/// Places for clients that may only read; the others are reserved for clients that may write.
constexpr std::size_t kReadersMax = limits::kModbusClientsMax - 2;
/// Bytes that the kernel keeps for a client that does not read: some hundreds of replies. Then it is closed.
constexpr int kSendBufferBytes = 1 << 16;

struct Client {
  Fd fd;
  std::uint32_t number = 0;
  std::uint32_t address = 0;
  bool read_only = false;
  bool spoke = false;              ///< a complete frame has arrived
  std::int64_t active_ns = 0;      ///< time of accepting, or of the last complete frame
  std::int64_t first_byte_ns = 0;  ///< of the frame in `frame`
  std::size_t bytes = 0;
  std::size_t served = 0;  ///< frames this turn
  std::array<std::uint8_t, limits::kModbusAduMax> frame{};
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
  set_option(fd, IPPROTO_TCP, TCP_USER_TIMEOUT, kUnacknowledged_ms);
}

class Server final : public ModbusServer {
 public:
  Server(const PlcSettings& settings, Fd listener, std::uint16_t port)
      : settings_(settings), port_(port), listener_(std::move(listener)) {
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
        inputs = decode_inputs(bank_.holding, settings_.word_order);
        inputs.command_writer = command_writer_;
        inputs.command_writes = command_writes_;
        return true;
      }
    }
    in_turn_ = false;
    return false;
  }

  void publish(const PlcOutputs& outputs) override { encode_outputs(outputs, settings_.word_order, bank_.input); }

  std::size_t clients() const override {
    return static_cast<std::size_t>(
        std::count_if(clients_.begin(), clients_.end(), [](const Client& c) { return c.fd.is_open(); }));
  }

  const PlcLinkCounters& counters() const override { return counters_; }
  std::string_view trouble() const override { return {}; }
  bool next_note(std::int64_t mono_ns, PlcNoteText& text) override {
    in_addr last{htonl(troubled_)};
    std::array<char, INET_ADDRSTRLEN> from{};
    if (troubled_ != 0) inet_ntop(AF_INET, &last, from.data(), from.size());
    return notes_.next(mono_ns, counters_, from.data(), text);
  }
  std::span<const std::uint16_t> holding() const override { return bank_.holding; }

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
    for (int i = 0; i < kAcceptsPerTurn; ++i) {
      sockaddr_in peer{};
      socklen_t peer_bytes = sizeof peer;
      Fd fd(accept4(listener_.get(), reinterpret_cast<sockaddr*>(&peer), &peer_bytes, SOCK_NONBLOCK | SOCK_CLOEXEC));
      if (!fd.is_open()) {
        const bool exhausted = errno == EMFILE || errno == ENFILE || errno == ENOBUFS || errno == ENOMEM;
        if (exhausted) accept_after_ns_ = now_ns_ + kAcceptPause_ns;
        return;
      }
      const std::uint32_t address = ntohl(peer.sin_addr.s_addr);
      const int may_write = narrowest(settings_.allow, address);
      const int may_read = narrowest(settings_.read_only, address);
      const bool reader = may_read >= may_write;
      if (may_write < 0 && may_read < 0) {
        blame(counters_.not_allowed, address);
        continue;
      }
      prepare_client(fd.get());
      seat(std::move(fd), address, reader);
    }
  }

  /// Prefix length of the narrowest network that contains the address, -1 if none does. As in routing, the narrower of
  /// `allow` and `read_only` decides: the PLC may be in a network that otherwise may only read.
  static int narrowest(const FixedVector<PlcSettings::Network, 16>& networks, std::uint32_t address) {
    int longest = -1;
    for (const PlcSettings::Network& network : networks)
      if ((address & network.mask) == network.address) longest = std::max(longest, std::popcount(network.mask));
    return longest;
  }

  /// Rank of a client; the lowest is replaced first. The order is: a free place, the address with the most places, then
  /// clients without a frame, read-only clients, writing clients, and the commanding one. Among equals the longest
  /// silent one is replaced. So a computer that floods the server displaces its own connections, and a reconnecting PLC
  /// is safe before its first frame.
  int rank(const Client& client) const {
    if (!client.fd.is_open()) return -1000;
    const bool owner = client.number == command_writer_ && now_ns_ - client.active_ns < kOwnerSilence_ns;
    if (owner) return 1000;
    const auto places = std::count_if(clients_.begin(), clients_.end(), [&](const Client& other) {
      return other.fd.is_open() && other.address == client.address;
    });
    const int kind = !client.spoke ? 0 : client.read_only ? 1 : 2;
    return kind - 10 * static_cast<int>(places);
  }

  /// Assigns a place. Displays cannot take the last places, so the PLC always finds one without displacing a client.
  void seat(Fd fd, std::uint32_t address, bool reader) {
    const bool readers_full =
        reader && static_cast<std::size_t>(std::count_if(clients_.begin(), clients_.end(), [](const Client& c) {
                    return c.fd.is_open() && c.read_only;
                  })) >= kReadersMax;
    Client* place = nullptr;
    for (Client& client : clients_) {
      if (readers_full && !(client.fd.is_open() && client.read_only)) continue;
      if (place == nullptr) place = &client;
      const int order = rank(client) - rank(*place);
      if (order < 0 || (order == 0 && client.active_ns < place->active_ns)) place = &client;
    }
    if (place->fd.is_open()) blame(counters_.displaced, place->address);
    forget(*place);
    ++counters_.connections;
    place->fd = std::move(fd);
    place->number = ++last_number_ == 0 ? ++last_number_ : last_number_;
    place->address = address;
    place->read_only = reader;
    place->spoke = false;
    place->active_ns = now_ns_;
  }

  void blame(std::uint64_t& counter, std::uint32_t address) {
    ++counter;
    troubled_ = address;
  }

  static void forget(Client& client) {
    client.fd.reset();
    clear_frame(client);
  }

  static void clear_frame(Client& client) { client.bytes = 0; }

  // ---- serving

  /// Serves the waiting requests of one client. True after a write.
  bool serve(Client& client) {
    while (client.fd.is_open() && client.served < limits::kModbusFramesPerTurn && receive(client)) {
      ++client.served;
      client.spoke = true;
      client.active_ns = now_ns_;
      ++counters_.frames;
      counters_.last_frame_ns = now_ns_;
      const bool wrote = answer(client);
      clear_frame(client);
      if (wrote) return true;
    }
    close_if_late(client);
    return false;
  }

  /// Reads until one frame is complete. False if it is not complete yet, or the client was closed.
  bool receive(Client& client) {
    for (;;) {
      std::size_t wanted = kMbapLengthEnd;
      if (client.bytes >= kMbapLengthEnd) {
        const auto whole = frame_bytes(std::span(client.frame).first<kMbapLengthEnd>());
        if (!whole) {
          blame(counters_.malformed, client.address);
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

  /// Answers the whole frame of `client`; true if it has changed holding registers. A write counts even if its reply
  /// could not be sent, because the registers have changed.
  bool answer(Client& client) {
    const auto frame = std::span<const std::uint8_t>(client.frame).first(client.bytes);
    RequestCheck check = check_request(frame, settings_.unit_id);
    if (check.writes && client.read_only) {
      check = {ModbusException::device_failure, false, false};
      blame(counters_.read_only, client.address);
    } else if (check.refusal) {
      blame(counters_.exceptions, client.address);
    }
    std::array<std::uint8_t, limits::kModbusAduMax> reply{};
    std::copy_n(frame.begin(), kMbapBytes, reply.begin());  // transaction, protocol and unit are copied from the
                                                            // request
    const auto reply_pdu = std::span(reply).subspan<kMbapBytes>();
    const auto pdu = frame.subspan(kMbapBytes);
    std::size_t bytes = kExceptionPduBytes;
    if (check.refusal) {
      std::ranges::copy(exception_pdu(pdu[0], *check.refusal), reply_pdu.begin());
    } else {
      if (check.writes_command) take_command_block(client);
      bytes = answer_pdu(pdu, bank_, reply_pdu);
    }
    reply[kMbapLengthEnd - 2] = static_cast<std::uint8_t>((bytes + 1) >> 8U);
    reply[kMbapLengthEnd - 1] = static_cast<std::uint8_t>((bytes + 1) & 0xFFU);
    bytes += kMbapBytes;
    if (send(client.fd.get(), reply.data(), bytes, MSG_NOSIGNAL | MSG_DONTWAIT) != static_cast<ssize_t>(bytes)) {
      blame(counters_.unsent, client.address);
      forget(client);
    }
    return check.writes;
  }

  /// The command block belongs to one connection. A write of another connection starts with an empty block, so that
  /// words of two writers never form one command.
  void take_command_block(const Client& client) {
    ++command_writes_;
    if (client.number == command_writer_) return;
    command_writer_ = client.number;
    std::fill(bank_.holding.begin() + kCommandFirst, bank_.holding.begin() + kCommandLast + 1, std::uint16_t{0});
  }

  void close_if_late(Client& client) {
    if (!client.fd.is_open()) return;
    const bool frame_late = client.bytes > 0 && now_ns_ - client.first_byte_ns > kFrameDeadline_ns;
    const bool idle = now_ns_ - client.active_ns > kIdleLimit_ns;
    if (!frame_late && !idle) return;
    blame(frame_late ? counters_.late : counters_.idle, client.address);
    forget(client);
  }

  PlcSettings settings_;
  std::uint16_t port_;
  Fd listener_;
  RegisterBank bank_;
  PlcLinkCounters counters_;
  PlcNotes notes_;
  std::uint32_t troubled_ = 0;  ///< address of the last error
  std::array<Client, limits::kModbusClientsMax> clients_;
  std::uint32_t last_number_ = 0;
  std::uint32_t command_writer_ = 0;
  std::uint32_t command_writes_ = 0;

  std::int64_t now_ns_ = 0;
  std::int64_t accept_after_ns_ = 0;
  bool in_turn_ = false;
  std::size_t turn_first_ = 0;
  std::size_t turn_visited_ = 0;
};

/// Opens the listening socket and returns its port.
Result<Fd> listen_on(const PlcSettings& settings, std::uint16_t& port) {
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
      listen(fd.get(), kBacklog) != 0) {
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

Result<std::unique_ptr<ModbusServer>> make_modbus_server(const PlcSettings& settings) {
  if (settings.unit_id < 1 || settings.unit_id > 247)
    return error(Code::config, "plc.unit_id is %u, allowed 1..247", unsigned{settings.unit_id});
  PlcSettings complete = settings;
  // Without a configured network only this computer may connect.
  if (complete.allow.empty()) static_cast<void>(complete.allow.push({0x7F000000U, 0xFF000000U}));
  std::uint16_t port = 0;
  Result<Fd> listener = listen_on(complete, port);
  if (!listener) return listener.error();

  return std::unique_ptr<ModbusServer>(std::make_unique<Server>(complete, std::move(listener.value()), port));
}

Result<PlcSettings::Network> parse_network(std::string_view cidr) {
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
  PlcSettings::Network network;
  network.mask = bits == 0 ? 0U : ~0U << (32 - bits);
  network.address = ntohl(address.s_addr);
  if ((network.address & ~network.mask) != 0)
    return error(Code::config, "\"%s\" has bits set beyond its /%u prefix", shown.c_str(), bits);
  return network;
}

}  // namespace slabd::hal
