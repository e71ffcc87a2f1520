// SPDX-License-Identifier: Apache-2.0
#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <pthread.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cmath>
#include <mutex>
#include <thread>

#include "base/os.h"
#include "base/rate_limit.h"
#include "hal/gauge/gauge_datagram.h"
#include "hal/hal.h"

// Problem: an instrument may be slow, switched off or wrong, and the loop must not wait for it.
// Idea: one thread reads the Modbus instruments in turn, another one receives datagrams; both store the newest sample
// of each gauge, and the loop copies all samples under a lock that is held for a copy only. Invariants:
//   - Every wait ends: connecting and an answer take at most kAnswer_ns, and a silent endpoint gets its next request
//     after a pause that doubles up to kPauseMax_ns, so that it does not delay the others.
//   - An answer must have the transaction number of its request; after any error the connection is closed. A late
//     answer is never taken for the next one.
//   - A sample is replaced only by a newer value. An instrument that does not answer leaves its last one, which ages.
//   - A lost connection is the trouble of every gauge behind it, because none of them gets a value then.
//   - No heap after construction.
namespace slabd::hal {
namespace {

/// Period of the requests to every instrument: a slab ends once in some minutes, and a value of half a second ago is
/// fresh.
constexpr std::int64_t kRound_ns = ns_from_ms(500);
constexpr std::int64_t kAnswer_ns = ns_from_ms(300);
constexpr std::int64_t kPauseFirst_ns = ns_from_ms(500);
constexpr std::int64_t kPauseMax_ns = 10 * kNsPerS;
constexpr std::int64_t kNotePeriod_ns = 60 * kNsPerS;

using Trouble = FixedString<120>;

/// Number in one or two registers; NaN for the numbers that mean "no value".
double number_of(std::span<const std::uint16_t> registers, const GaugeSettings& gauge) {
  if (gauge.format == GaugeFormat::i16) return static_cast<std::int16_t>(registers[0]);
  if (gauge.format == GaugeFormat::u16) return registers[0];
  const std::uint32_t high = registers[gauge.low_word_first ? 1 : 0];
  const std::uint32_t low = registers[gauge.low_word_first ? 0 : 1];
  const std::uint32_t word = high << 16U | low;
  switch (gauge.format) {
    case GaugeFormat::u32: return word;
    case GaugeFormat::f32: return std::bit_cast<float>(word);
    case GaugeFormat::i16:
    case GaugeFormat::u16:
    case GaugeFormat::i32: break;
  }
  const auto number = static_cast<std::int32_t>(word);
  return number == kNoGaugeRegister ? kNoValue : static_cast<double>(number);
}

/// One Modbus/TCP server with its instruments.
struct Endpoint {
  FixedString<64> host;
  std::uint16_t port = 0;
  Fd fd;
  std::int64_t try_ns = 0;
  std::int64_t pause_ns = kPauseFirst_ns;
  std::uint16_t transaction = 0;
};

class Port final : public GaugePort {
 public:
  Port(std::span<const GaugeSettings> gauges, const GaugeSenders& senders, const Clock& clock, Fd stop)
      : senders_(senders), clock_(clock), stop_(std::move(stop)) {
    for (const GaugeSettings& gauge : gauges) static_cast<void>(gauges_.push(gauge));
    for (std::size_t i = 0; i < gauges_.size(); ++i) {
      if (gauges_[i].link == GaugeLink::modbus) has_modbus_ = true;
      if (gauges_[i].link != GaugeLink::udp) continue;
      const bool known = std::find(ports_.begin(), ports_.end(), gauges_[i].port) != ports_.end();
      if (!known) static_cast<void>(ports_.push(gauges_[i].port));
    }
  }
  ~Port() override {
    const std::uint64_t one = 1;
    static_cast<void>(!::write(stop_.get(), &one, sizeof one));
    if (modbus_.joinable()) modbus_.join();
    if (udp_.joinable()) udp_.join();
  }
  Port(const Port&) = delete;
  Port& operator=(const Port&) = delete;

  Status start() {
    for (std::size_t i = 0; i < ports_.size(); ++i)
      if (const Status opened = open_port(i); !opened.ok()) return opened;
    if (has_modbus_) modbus_ = std::thread([this] { ask_instruments(); });
    if (!ports_.empty()) udp_ = std::thread([this] { receive(); });
    return success();
  }

  void newest(GaugeSamples& out) const override {
    const std::lock_guard lock(mutex_);
    out = samples_;
  }
  [[nodiscard]] ScannerText trouble(std::size_t index) const override {
    const std::lock_guard lock(mutex_);
    return ScannerText(index < troubles_.size() ? troubles_[index].view() : std::string_view());
  }
  [[nodiscard]] GaugeCounters counters() const override {
    const std::lock_guard lock(mutex_);
    return counters_;
  }
  bool next_note(std::int64_t mono_ns, ScannerText& text) override {
    const GaugeCounters now = counters();
    const std::uint64_t foreign = now.foreign - told_.foreign;
    const std::uint64_t malformed = now.malformed - told_.malformed;
    const std::uint64_t unknown = now.unknown - told_.unknown;
    if (foreign + malformed + unknown == 0 || !note_limit_.permits(mono_ns)) return false;
    told_ = now;
    text.printf(
        "gauge datagrams: %llu from addresses outside [gauges] allow, %llu lines that are not \"NAME VALUE SEQ "
        "SLAB_NO\", %llu of unknown gauges",
        static_cast<unsigned long long>(foreign), static_cast<unsigned long long>(malformed),
        static_cast<unsigned long long>(unknown));
    return true;
  }

 private:
  // ---- both threads

  /// True if the process ends within this time.
  [[nodiscard]] bool stops_within(std::int64_t wait_ns) const {
    pollfd stop{stop_.get(), POLLIN, 0};
    return ::poll(&stop, 1, static_cast<int>(std::max<std::int64_t>(wait_ns, 0) / kNsPerMs)) > 0;
  }
  void store(std::size_t index, const GaugeSample& sample) {
    const std::lock_guard lock(mutex_);
    samples_[index] = sample;
    troubles_[index].clear();
  }
  void complain(std::size_t index, const char* what) {
    const std::lock_guard lock(mutex_);
    troubles_[index] = what;
  }

  // ---- Modbus instruments

  void ask_instruments() {
    pthread_setname_np(pthread_self(), "slabd-gauge");
    for (std::int64_t round_ns = clock_.mono_ns(); !stops_within(round_ns - clock_.mono_ns()); round_ns += kRound_ns) {
      for (std::size_t i = 0; i < gauges_.size(); ++i)
        if (gauges_[i].link == GaugeLink::modbus) ask(i);
      round_ns = std::max(round_ns, clock_.mono_ns() - kRound_ns);  // after a slow round the next one is not hurried
    }
  }

  Endpoint& endpoint_of(const GaugeSettings& gauge) {
    for (Endpoint& endpoint : endpoints_) {
      if (endpoint.port == 0) {
        endpoint.host = gauge.host;
        endpoint.port = gauge.port;
      }
      if (endpoint.host == gauge.host && endpoint.port == gauge.port) return endpoint;
    }
    return endpoints_.back();  // not reached: there are as many endpoints as gauges
  }

  void ask(std::size_t index) {
    const GaugeSettings& gauge = gauges_[index];
    Endpoint& endpoint = endpoint_of(gauge);
    if (!endpoint.fd.is_open() && (clock_.mono_ns() < endpoint.try_ns || !connect(endpoint))) return;
    std::array<std::uint16_t, 2> registers{};
    if (!read(endpoint, index, registers)) return;
    endpoint.pause_ns = kPauseFirst_ns;
    GaugeSample sample;
    sample.has_value = true;
    sample.value = gauge.scale * number_of(registers, gauge);
    sample.seq = ++counts_[index];
    sample.mono_ns = clock_.mono_ns();
    sample.utime_us = clock_.utime_us();
    store(index, sample);
  }

  void lose(Endpoint& endpoint, const char* why) {
    for (std::size_t i = 0; i < gauges_.size(); ++i)
      if (gauges_[i].link == GaugeLink::modbus && &endpoint_of(gauges_[i]) == &endpoint) complain(i, why);
    endpoint.fd.reset();
    endpoint.try_ns = clock_.mono_ns() + endpoint.pause_ns;
    endpoint.pause_ns = std::min(2 * endpoint.pause_ns, kPauseMax_ns);
  }

  [[nodiscard]] bool ready(int fd, short events, std::int64_t until_ns) const {
    const std::int64_t left_ns = until_ns - clock_.mono_ns();
    pollfd one{fd, events, 0};
    return left_ns > 0 && ::poll(&one, 1, static_cast<int>(left_ns / kNsPerMs) + 1) == 1 && (one.revents & events) != 0;
  }

  bool connect(Endpoint& endpoint) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(endpoint.port);
    Fd fd(::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
    bool open = fd.is_open() && inet_pton(AF_INET, endpoint.host.c_str(), &address.sin_addr) == 1;
    if (open && ::connect(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
      open = errno == EINPROGRESS && ready(fd.get(), POLLOUT, clock_.mono_ns() + kAnswer_ns);
    int fault = 0;
    socklen_t bytes = sizeof fault;
    open = open && getsockopt(fd.get(), SOL_SOCKET, SO_ERROR, &fault, &bytes) == 0 && fault == 0;
    if (!open) {
      lose(endpoint, "the instrument's Modbus server does not accept a connection");
      return false;
    }
    const int on = 1;
    setsockopt(fd.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    endpoint.fd = std::move(fd);
    return true;
  }

  /// Reads the registers of one gauge; false if it stored a trouble instead. An exception of the instrument keeps the
  /// connection; any other fault closes it.
  bool read(Endpoint& endpoint, std::size_t index, std::span<std::uint16_t, 2> out) {
    const GaugeSettings& gauge = gauges_[index];
    const auto byte = [](unsigned value) { return static_cast<std::uint8_t>(value & 0xFFU); };
    const unsigned transaction = ++endpoint.transaction;
    const unsigned function = gauge.input_register ? 4 : 3;
    const unsigned count = registers_of(gauge.format);
    const unsigned address = gauge.address;
    const std::array<std::uint8_t, 12> request = {
        byte(transaction >> 8U), byte(transaction), 0, 0,          0, 6, gauge.unit_id, byte(function),
        byte(address >> 8U),     byte(address),     0, byte(count)};
    const std::int64_t until_ns = clock_.mono_ns() + kAnswer_ns;
    if (::send(endpoint.fd.get(), request.data(), request.size(), MSG_NOSIGNAL) !=
        static_cast<ssize_t>(request.size())) {
      lose(endpoint, "the instrument closed the connection");
      return false;
    }
    std::array<std::uint8_t, 13> answer{};
    std::size_t bytes = 0;
    std::size_t wanted = 9;  // an exception
    while (bytes < wanted) {
      const bool came = ready(endpoint.fd.get(), POLLIN, until_ns);
      const ssize_t n = came ? ::recv(endpoint.fd.get(), answer.data() + bytes, wanted - bytes, MSG_DONTWAIT) : 0;
      if (n <= 0) {
        lose(endpoint, came ? "the instrument closed the connection" : "the instrument does not answer");
        return false;
      }
      bytes += static_cast<std::size_t>(n);
      if (bytes >= 9 && answer[7] == function) wanted = 9 + 2 * count;
    }
    const bool is_own = answer[0] == request[0] && answer[1] == request[1] && answer[2] == 0 && answer[3] == 0 &&
                        answer[6] == gauge.unit_id;
    if (is_own && answer[7] == (function | 0x80U)) {
      Trouble trouble;
      trouble.printf("the instrument refuses register %u with exception %u", address, unsigned{answer[8]});
      complain(index, trouble.c_str());
      return false;
    }
    if (!is_own || answer[7] != function || answer[8] != 2 * count) {
      lose(endpoint, "the instrument's answer is not that of the request");
      return false;
    }
    for (std::size_t i = 0; i < count; ++i)
      out[i] = static_cast<std::uint16_t>(unsigned{answer[9 + 2 * i]} << 8U | answer[10 + 2 * i]);
    return true;
  }

  // ---- datagrams

  Status open_port(std::size_t i) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(ports_[i]);
    address.sin_addr.s_addr = htonl(INADDR_ANY);
    Fd fd(::socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
    if (!fd.is_open() || ::bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
      return error(Code::config, "gauge.source udp:%u: %s%s", unsigned{ports_[i]}, errno_text(errno),
                   errno == EADDRINUSE ? " (another program uses this port)" : "");
    sockets_[i] = std::move(fd);
    return success();
  }

  void receive() {
    pthread_setname_np(pthread_self(), "slabd-gaugeudp");
    for (;;) {
      std::array<pollfd, limits::kGaugesMax + 1> fds{};
      for (std::size_t i = 0; i < ports_.size(); ++i) fds[i] = {sockets_[i].get(), POLLIN, 0};
      fds[ports_.size()] = {stop_.get(), POLLIN, 0};
      ::poll(fds.data(), ports_.size() + 1, -1);
      if (fds[ports_.size()].revents != 0) return;
      for (std::size_t i = 0; i < ports_.size(); ++i)
        if (fds[i].revents != 0) take_datagram(i);
    }
  }

  void take_datagram(std::size_t socket) {
    std::array<char, limits::kGaugeDatagramBytes> bytes{};
    sockaddr_in from{};
    socklen_t from_bytes = sizeof from;
    const ssize_t n = ::recvfrom(sockets_[socket].get(), bytes.data(), bytes.size(), MSG_DONTWAIT | MSG_TRUNC,
                                 reinterpret_cast<sockaddr*>(&from), &from_bytes);
    if (n < 0) return;
    const std::uint32_t sender = ntohl(from.sin_addr.s_addr);
    const bool allowed = std::any_of(senders_.begin(), senders_.end(), [&](const PlcSettings::Network& network) {
      return (sender & network.mask) == network.address;
    });
    if (!allowed) return count(&GaugeCounters::foreign);
    if (static_cast<std::size_t>(n) > bytes.size()) return count(&GaugeCounters::malformed);
    std::string_view text(bytes.data(), static_cast<std::size_t>(n));
    while (!text.empty())
      if (const std::string_view line = next_line(text); !line.empty()) take_line(ports_[socket], line);
  }

  void take_line(std::uint16_t port, std::string_view text) {
    const std::optional<GaugeLine> line = parse_gauge_line(text);
    if (!line) return count(&GaugeCounters::malformed);
    for (std::size_t i = 0; i < gauges_.size(); ++i) {
      if (gauges_[i].link != GaugeLink::udp || gauges_[i].port != port || !(gauges_[i].name == line->name)) continue;
      // The same datagram again is not a new measurement.
      if (counts_[i] == line->seq) return count(&GaugeCounters::repeated);
      counts_[i] = line->seq;
      count(&GaugeCounters::accepted);
      return store(
          i, {true, gauges_[i].scale * line->number, line->seq, line->slab_no, clock_.mono_ns(), clock_.utime_us()});
    }
    count(&GaugeCounters::unknown);
  }

  void count(std::uint64_t GaugeCounters::*counter) {
    const std::lock_guard lock(mutex_);
    ++(counters_.*counter);
  }

  GaugeList gauges_;
  GaugeSenders senders_;
  const Clock& clock_;
  Fd stop_;
  bool has_modbus_ = false;
  FixedVector<std::uint16_t, limits::kGaugesMax> ports_;
  std::array<Fd, limits::kGaugesMax> sockets_;
  std::array<Endpoint, limits::kGaugesMax> endpoints_;
  std::array<std::uint32_t, limits::kGaugesMax> counts_{};  ///< each used by the thread of its gauge only

  mutable std::mutex mutex_;
  GaugeSamples samples_{};
  std::array<Trouble, limits::kGaugesMax> troubles_;
  GaugeCounters counters_;

  GaugeCounters told_;  ///< the loop's
  RateLimit note_limit_{kNotePeriod_ns};

  std::thread modbus_;
  std::thread udp_;
};

}  // namespace

Result<std::unique_ptr<GaugePort>> make_gauge_port(std::span<const GaugeSettings> gauges, const GaugeSenders& senders,
                                                   const Clock& clock) {
  Fd stop(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC));
  if (!stop.is_open()) return error(Code::internal, "the gauges cannot be read: %s", errno_text(errno));
  auto port = std::make_unique<Port>(gauges, senders, clock, std::move(stop));
  if (const Status started = port->start(); !started.ok()) return started.error();
  return std::unique_ptr<GaugePort>(std::move(port));
}

}  // namespace slabd::hal
