// SPDX-License-Identifier: Apache-2.0
#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <mutex>
#include <optional>

#include "base/os.h"
#include "hal/hal.h"
#include "hal/scan/scan_stream.h"
#include "hal/scan/scanner_ports.h"
#include "hal/system/spool.h"

// Problem: a scanner that has only a vendor's SDK needs a gateway: third-party software on another computer, at the end
// of a cable. Idea: the gateway keeps one connection. A request is sent as a line of JSON; the scan is received after a
// header that names the request; the result is sent as a line. An error in the stream ends the connection, not the
// request: the gateway reconnects, receives the number of stored points, and continues. Invariants:
//   - points count only for the request that their header names, and only if all checksums match;
//   - the spool file contains exactly the decoded floats, converted to mm;
//   - one sender: another address is rejected while the first one is connected;
//   - every wait is bounded by the request's timeout, and by kStall_ns for a silent sender. Only the spool's disk may
//     block this thread longer; HangWatch reports that.
namespace slabd::hal {
namespace {

constexpr int kPoll_ms = 20;
/// Longest silence within a scan: longer than TCP takes to resend a lost segment, short enough for a retry within the
/// timeout.
constexpr std::int64_t kStall_ns = 3 * kNsPerS;
/// Time of reading on after an error, so that the sender can read the reason before the connection is reset.
constexpr std::int64_t kFarewell_ns = 200 * kNsPerMs;

FixedString<24> text_of(const sockaddr_in& address) {
  const std::uint32_t a = ntohl(address.sin_addr.s_addr);
  FixedString<24> text;
  text.printf("%u.%u.%u.%u:%u", a >> 24U, (a >> 16U) & 255U, (a >> 8U) & 255U, a & 255U,
              unsigned{ntohs(address.sin_port)});
  return text;
}

void set_option(int fd, int level, int option, int value) {
  setsockopt(fd, level, option, &value, sizeof value);
}

/// Socket options of a sender; a dead gateway is detected within 20 s without traffic.
void prepare_sender(int fd) {
  set_option(fd, IPPROTO_TCP, TCP_NODELAY, 1);
  set_option(fd, SOL_SOCKET, SO_KEEPALIVE, 1);
  set_option(fd, IPPROTO_TCP, TCP_KEEPIDLE, 10);
  set_option(fd, IPPROTO_TCP, TCP_KEEPINTVL, 3);
  set_option(fd, IPPROTO_TCP, TCP_KEEPCNT, 3);
  set_option(fd, IPPROTO_TCP, TCP_USER_TIMEOUT, 5'000);
}

class StreamPort final : public ScanStreamPort {
 public:
  StreamPort(const ScanStreamSettings& settings, const Clock& clock)
      : settings_(settings), clock_(clock), hang_(clock) {
    say("no gateway has connected yet");
    listen_if_needed();
  }

  std::uint16_t bound_port() const override { return bound_port_; }
  bool online() const override { return online_ && !hangs(); }
  bool hangs() const override { return hang_.hang().ns != 0; }
  bool spool_hangs() const override { return hangs(); }
  std::uint64_t stray_files() const override { return strays_; }
  ScannerText trouble() const override {
    if (const HangWatch::Hang hang = hang_.hang(); hang.ns != 0) return spool_hang_text(hang);
    const std::lock_guard lock(mutex_);
    return trouble_;
  }

  void idle() override {
    listen_if_needed();
    take_connections();
    if (!sender_.is_open()) return;
    std::array<std::byte, 512> unasked;
    const ssize_t n = recv(sender_.get(), unasked.data(), unasked.size(), MSG_DONTWAIT);
    if (n > 0) {
      ++strays_;
      turn_away(error(Code::frame_incomplete, "data that was not requested (a late scan?)"), 0, 0);
    } else if (n == 0 || (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR)) {
      lost("the gateway has closed the connection");
    }
  }

  Result<AcquiredScan> acquire(const ScanRequest& request, std::span<float> xyz, const std::atomic<bool>& cancel,
                               const ScanDecoded& decoded) override {
    if (request.spool_path.size() + 4 > PathText::capacity())
      return error(Code::config, "%s: the spool path and \".ply\" exceed %zu bytes", request.spool_path.c_str(),
                   PathText::capacity());
    idle();  // data received before the request is not its answer
    Job job{request, xyz};
    job.scan.path = request.spool_path;
    job.scan.path.append(".ply");
    const std::int64_t deadline_ns = clock_.mono_ns() + request.timeout_ns;
    if (sender_.is_open()) ask(job);
    Result<AcquiredScan> result = AcquiredScan{};
    for (;;) {
      if (cancel) {
        result = error(Code::interrupted, "the scan was cancelled");
        break;
      }
      if (clock_.mono_ns() >= deadline_ns) {
        result = too_late(job);
        break;
      }
      wait();
      listen_if_needed();
      // Data of a closed connection is processed before the next one is sent the number of stored points.
      if (const Status status = receive(job); !status) {
        result = status.error();
        break;
      }
      if (job.decoder.complete()) {
        result = finish(job, decoded);
        break;
      }
      if (take_connections()) ask(job);
    }
    job.file.abandon();
    conclude(job, result);
    return result;
  }

 private:
  /// One request in progress.
  struct Job {
    Job(const ScanRequest& r, std::span<float> xyz) : request(r), decoder(xyz) { decoder.expect(r.session, r.cmd_seq); }
    const ScanRequest& request;
    ScanStreamDecoder decoder;
    SpoolWriter file;
    std::uint32_t starts = 0;       ///< of the scan that `file` holds
    std::size_t points_stored = 0;  ///< in `file`
    std::int64_t moved_ns = 0;      ///< time of the last bytes
    std::int64_t begin_ns = 0;      ///< time of the header
    std::optional<Error> last;      ///< error of the last try
    AcquiredScan scan;
  };

  // ---- the connection

  void say(const char* text) {
    const std::lock_guard lock(mutex_);
    trouble_.assign(text);
  }

  void listen_if_needed() {
    if (listener_.is_open()) return;
    Fd fd(socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
    set_option(fd.get(), SOL_SOCKET, SO_REUSEADDR, 1);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(settings_.port);
    inet_pton(AF_INET, settings_.host.c_str(), &address.sin_addr);
    socklen_t bytes = sizeof address;
    if (bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 || listen(fd.get(), 4) != 0 ||
        getsockname(fd.get(), reinterpret_cast<sockaddr*>(&address), &bytes) != 0) {
      ScannerText text;
      text.printf("cannot listen for the gateway on %s:%u: %s", settings_.host.c_str(), unsigned{settings_.port},
                  errno_text(errno));
      return say(text.c_str());
    }
    bound_port_ = ntohs(address.sin_port);
    listener_ = std::move(fd);
    say("no gateway has connected yet");
  }

  bool is_allowed(const sockaddr_in& from) const {
    const std::uint32_t source = ntohl(from.sin_addr.s_addr);
    return std::any_of(settings_.allow.begin(), settings_.allow.end(),
                       [source](const PlcSettings::Network& n) { return (source & n.mask) == n.address; });
  }

  /// Accepts connections; true if there is a new sender. The same computer may reconnect (after a restart or a pulled
  /// cable), another one only if no sender is connected.
  bool take_connections() {
    bool fresh = false;
    if (!listener_.is_open()) return false;
    for (int i = 0; i < 4; ++i) {  // bounded: a flood of connections must not keep the request waiting
      sockaddr_in from{};
      socklen_t bytes = sizeof from;
      Fd fd(accept4(listener_.get(), reinterpret_cast<sockaddr*>(&from), &bytes, SOCK_NONBLOCK | SOCK_CLOEXEC));
      if (!fd.is_open()) break;
      if (!is_allowed(from)) {
        note_refused(from, "is not in [scanner] allow");
        continue;
      }
      if (sender_.is_open() && from_.sin_addr.s_addr != from.sin_addr.s_addr) {
        const Error why = error(Code::busy, "another gateway is connected: %s", text_of(from_).c_str());
        static_cast<void>(send_line(fd.get(), scan_answer_json(0, 0, &why, 0).view()));
        note_refused(from, "connected while another gateway was connected");
        continue;
      }
      prepare_sender(fd.get());
      sender_ = std::move(fd);
      from_ = from;
      online_ = true;
      say("");
      fresh = true;
    }
    return fresh;
  }

  void note_refused(const sockaddr_in& from, const char* why) {
    ++strays_;
    if (sender_.is_open()) return;
    ScannerText text;
    text.printf("%s %s", text_of(from).c_str(), why);
    say(text.c_str());
  }

  static bool send_line(int fd, std::string_view line) {
    return send(fd, line.data(), line.size(), MSG_NOSIGNAL | MSG_DONTWAIT) == static_cast<ssize_t>(line.size());
  }

  void lost(const char* why) {
    sender_.reset();
    online_ = false;
    say(why);
  }

  /// Sends the reason, lets the sender read it, and closes the connection.
  void turn_away(const Error& why, std::uint16_t session, std::uint16_t cmd_seq) {
    static_cast<void>(send_line(sender_.get(), scan_answer_json(session, cmd_seq, &why, 0).view()));
    shutdown(sender_.get(), SHUT_WR);
    const std::int64_t until_ns = clock_.mono_ns() + kFarewell_ns;
    std::array<std::byte, limits::kScanReadBytes> unread;
    pollfd waiting{sender_.get(), POLLIN, 0};
    while (clock_.mono_ns() < until_ns && poll(&waiting, 1, kPoll_ms) >= 0) {
      const ssize_t n = recv(sender_.get(), unread.data(), unread.size(), MSG_DONTWAIT);
      if (n == 0 || (n < 0 && errno != EAGAIN && errno != EINTR)) break;
    }
    ScannerText text;
    text.printf("the gateway was rejected: %s", why.text.c_str());
    lost(text.c_str());
  }

  void wait() const {
    std::array<pollfd, 2> fds = {pollfd{listener_.get(), POLLIN, 0}, pollfd{sender_.get(), POLLIN, 0}};
    poll(fds.data(), fds.size(), kPoll_ms);  // poll() ignores -1
  }

  // ---- a request

  void ask(Job& job) {
    job.decoder.cut();
    job.moved_ns = clock_.mono_ns();
    FixedString<96> more;
    more.printf(R"(, "have_points": %zu, "timeout_ms": %lld, "gateway": %d)", job.decoder.points(),
                static_cast<long long>(job.request.timeout_ns / kNsPerMs), kGatewayNow);
    if (!send_line(sender_.get(), scan_request_json(job.request, more.view()).view()))
      lost("the gateway does not take the request");
  }

  /// Receives available data. An error ends the request; an error in the stream only ends the connection.
  Status receive(Job& job) {
    while (sender_.is_open() && !job.decoder.complete()) {
      std::array<std::byte, limits::kScanReadBytes> piece;
      const ssize_t n = recv(sender_.get(), piece.data(), std::min(piece.size(), job.decoder.wanted()), MSG_DONTWAIT);
      if (n < 0 && errno == EINTR) continue;
      if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) {
        if (job.decoder.is_in_scan() && clock_.mono_ns() - job.moved_ns > kStall_ns) {
          job.last = error(Code::frame_incomplete, "the gateway fell silent after %zu of %u points",
                           job.decoder.points(), job.decoder.header().count);
          lost("the gateway fell silent in the middle of a scan");
          job.decoder.cut();
        }
        return success();
      }
      if (n <= 0) {
        if (job.decoder.is_in_scan())
          job.last = error(Code::frame_incomplete, "the connection was cut after %zu points", job.decoder.points());
        lost("the gateway has closed the connection");
        job.decoder.cut();
        return success();
      }
      job.moved_ns = clock_.mono_ns();
      const std::uint32_t starts = job.decoder.starts();
      const Status fed = job.decoder.feed(std::span(piece).first(static_cast<std::size_t>(n)));
      if (const Error* refusal = job.decoder.refusal()) return *refusal;
      if (!fed) {
        ++strays_;
        job.last = fed.error();
        turn_away(fed.error(), job.request.session, job.request.cmd_seq);
        job.decoder.cut();
        return success();
      }
      if (job.decoder.starts() != starts) {
        if (Status status = accepted(job.decoder.header()); !status) {
          ++strays_;
          return status;
        }
      }
      if (job.decoder.starts() != starts || job.begin_ns == 0) note_header(job);
      hang_.enter(HangWatch::kTake_ns, HangWatch::Place::spool);
      const Status stored = store(job);
      hang_.leave();
      if (!stored) return stored;
    }
    return success();
  }

  /// A scan of another scanner than the accepted one would be measured with the accepted one's uncertainty.
  [[nodiscard]] Status accepted(const ScanStreamHeader& header) const {
    if (settings_.scanner == 0 || header.scanner == settings_.scanner) return success();
    return error(Code::frame_incomplete,
                 "the scan is of scanner %016llx, accepted is %016llx ([genicam] accepted); 0: not stated",
                 static_cast<unsigned long long>(header.scanner), static_cast<unsigned long long>(settings_.scanner));
  }

  void note_header(Job& job) {
    if (!job.decoder.has_header()) return;
    // The exposure ended before its header was sent.
    job.begin_ns = job.scan.taken_mono_ns = clock_.mono_ns();
    job.scan.taken_utime_us = clock_.utime_us();
  }

  /// Writes points to the spool that are decoded and not stored yet.
  static Status store(Job& job) {
    const ScanStreamHeader& header = job.decoder.header();
    if (job.decoder.starts() != job.starts) {
      if (Status status = job.file.begin(job.scan.path); !status) return status;
      FixedString<96> organised;
      if (header.width != 0) organised.printf("comment organized width %u height %u\n", header.width, header.height);
      FixedString<48> scanner;
      if (header.scanner != 0)
        scanner.printf("comment scanner %016llx\n", static_cast<unsigned long long>(header.scanner));
      FixedString<48> temperature;
      if (header.temperature_ck != 0)
        temperature.printf("comment scanner_temperature_c %.2f\n", temperature_c_of(header.temperature_ck));
      FixedString<384> text;
      text.printf(
          "ply\nformat binary_little_endian 1.0\ncomment unit mm\n%s%s%s%selement vertex %u\nproperty float x\n"
          "property float y\nproperty float z\nend_header\n",
          organised.c_str(), header.emulated ? "comment emulated, as its sender declares\n" : "", scanner.c_str(),
          temperature.c_str(), header.count);
      if (Status status = job.file.write(text.view()); !status) return status;
      job.starts = job.decoder.starts();
      job.points_stored = 0;
    }
    if (job.decoder.points() <= job.points_stored) return success();
    const std::span<const float> fresh = job.decoder.fresh(job.points_stored);
    job.points_stored = job.decoder.points();
    return job.file.write(std::as_bytes(fresh));
  }

  Result<AcquiredScan> finish(Job& job, const ScanDecoded& decoded) {
    job.scan.shape = job.decoder.shape();
    if (job.scan.shape.finite < job.request.points_min)
      return error(Code::too_few_points, "%zu of %zu points are there, needed are %zu", job.scan.shape.finite,
                   job.scan.shape.points, job.request.points_min);
    job.scan.read_ms = ms_from_ns(clock_.mono_ns() - job.begin_ns);
    decoded(job.scan);
    hang_.enter(HangWatch::kTake_ns, HangWatch::Place::spool);
    const Status status = job.file.finish();
    hang_.leave();
    if (!status) return status.error();
    return job.scan;
  }

  Error too_late(const Job& job) const {
    if (job.last) return *job.last;
    const double waited_s = ms_from_ns(job.request.timeout_ns) / 1e3;
    if (job.decoder.has_header())
      return error(Code::frame_incomplete, "%zu of %u points arrived within %.1f s", job.decoder.points(),
                   job.decoder.header().count, waited_s);
    if (!sender_.is_open())
      return error(Code::scanner_offline, "no gateway is connected to %s:%u", settings_.host.c_str(),
                   unsigned{bound_port_});
    return error(Code::trigger_timeout, "no answer to request %u-%u within %.1f s", unsigned{job.request.session},
                 unsigned{job.request.cmd_seq}, waited_s);
  }

  /// Sends the result to the sender. In the middle of a scan an error also closes the connection.
  void conclude(const Job& job, const Result<AcquiredScan>& result) {
    if (!sender_.is_open()) return;
    const ScanRequest& request = job.request;
    if (result) {
      static_cast<void>(
          send_line(sender_.get(),
                    scan_answer_json(request.session, request.cmd_seq, nullptr, result.value().shape.points).view()));
    } else if (job.decoder.is_in_scan()) {
      turn_away(result.error(), request.session, request.cmd_seq);
    } else {
      static_cast<void>(
          send_line(sender_.get(), scan_answer_json(request.session, request.cmd_seq, &result.error(), 0).view()));
    }
  }

  ScanStreamSettings settings_;
  const Clock& clock_;
  Fd listener_;
  Fd sender_;
  sockaddr_in from_{};
  std::atomic<std::uint16_t> bound_port_ = 0;
  std::atomic<bool> online_ = false;
  std::atomic<std::uint64_t> strays_ = 0;
  HangWatch hang_;
  mutable std::mutex mutex_;
  ScannerText trouble_;
};

}  // namespace

Result<std::unique_ptr<ScanStreamPort>> make_scan_stream(const ScanStreamSettings& settings, const Clock& clock) {
  in_addr address{};
  if (inet_pton(AF_INET, settings.host.c_str(), &address) != 1)
    return error(Code::config, "scanner.listen \"%s\" is not an IPv4 address", settings.host.c_str());
  return std::unique_ptr<ScanStreamPort>(std::make_unique<StreamPort>(settings, clock));
}

}  // namespace slabd::hal
