// SPDX-License-Identifier: Apache-2.0
#include "emulator/stream_gateway.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <nlohmann/json.hpp>

#include "hal/scan/scan_stream.h"

namespace slabd::emulator {
namespace {

using nlohmann::json;
using Clock = std::chrono::steady_clock;

constexpr std::size_t kLineMax = 65'536;
constexpr int kAnswer_ms = 20'000;  ///< longer than slabd waits for a scan or writes it to disk

int left_ms(Clock::time_point until) {
  return static_cast<int>(
      std::max<std::int64_t>(0, std::chrono::duration_cast<std::chrono::milliseconds>(until - Clock::now()).count()));
}

std::optional<StreamRequest> request_of(const json& line) {
  StreamRequest request;
  request.session = line.value("session", std::uint16_t{0});
  request.cmd_seq = line.value("cmd_seq", std::uint16_t{0});
  request.station = line.value("station", 0);
  request.slab_id = line.value("slab_id", "");
  request.have_points = line.value("have_points", std::uint32_t{0});
  request.gateway = line.value("gateway", 1);
  return request;
}

}  // namespace

Status StreamGateway::connect() {
  if (socket_.is_open()) return success();
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port_);
  if (inet_pton(AF_INET, host_.c_str(), &address.sin_addr) != 1)
    return error(Code::config, "\"%s\" is not an IPv4 address", host_.c_str());
  socket_ = Fd(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  if (::connect(socket_.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    const int why = errno;
    close();
    return error(Code::scanner_offline, "%s:%u: %s (does slabd run, with [scanner] backend = \"tcp\" and this listen?)",
                 host_.c_str(), unsigned{port_}, std::strerror(why));
  }
  const int on = 1;
  setsockopt(socket_.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  text_.clear();
  return success();
}

void StreamGateway::close() {
  socket_.reset();
  text_.clear();
}

std::optional<std::string> StreamGateway::next_line(int wait_ms) {
  const auto until = Clock::now() + std::chrono::milliseconds(wait_ms);
  while (socket_.is_open()) {
    if (const std::size_t end = text_.find('\n'); end != std::string::npos) {
      std::string line = text_.substr(0, end);
      text_.erase(0, end + 1);
      return line;
    }
    if (text_.size() > kLineMax) return close(), std::nullopt;
    pollfd waiting{socket_.get(), POLLIN, 0};
    if (poll(&waiting, 1, left_ms(until)) <= 0) return std::nullopt;
    std::array<char, 4096> piece;
    const ssize_t n = recv(socket_.get(), piece.data(), piece.size(), 0);
    if (n <= 0) return close(), std::nullopt;
    text_.append(piece.data(), static_cast<std::size_t>(n));
  }
  return std::nullopt;
}

std::optional<StreamRequest> StreamGateway::next_request(int wait_ms, std::string& note) {
  const auto until = Clock::now() + std::chrono::milliseconds(wait_ms);
  while (const std::optional<std::string> text = next_line(left_ms(until))) {
    const json line = json::parse(*text, nullptr, false);
    if (!line.is_object()) continue;
    if (line.value("schema", "") == "slabd.scan_request/1") return request_of(line);
    if (!line.value("ok", true)) note = line.value("error", "");
  }
  return std::nullopt;
}

bool StreamGateway::send_all(std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    // A peer that closed without reading leaves a full window, and a blocking send() would never return.
    pollfd room{socket_.get(), POLLOUT | POLLRDHUP, 0};
    if (poll(&room, 1, -1) < 0 && errno != EINTR) return false;
    if ((room.revents & (POLLRDHUP | POLLHUP | POLLERR)) != 0) return false;
    const ssize_t n = send(socket_.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (n < 0 && (errno == EINTR || errno == EAGAIN)) continue;
    if (n <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(n));
  }
  return true;
}

Status StreamGateway::answer(const StreamRequest& request, std::span<const float> xyz, std::size_t width,
                             std::size_t height, std::int64_t utime_us, std::size_t cut_after_points, bool emulated,
                             double temperature_c) {
  hal::ScanStreamHeader header;
  header.session = request.session;
  header.cmd_seq = request.cmd_seq;
  header.width = static_cast<std::uint32_t>(width);
  header.height = static_cast<std::uint32_t>(height);
  header.count = static_cast<std::uint32_t>(xyz.size() / 3);
  header.utime_us = static_cast<std::uint64_t>(utime_us);
  header.points_crc = hal::crc32c(std::as_bytes(xyz));
  header.emulated = emulated;
  if (request.gateway >= hal::kGatewayTemperature) header.temperature_ck = hal::temperature_ck_of(temperature_c);
  // The points that slabd has may be of a scan that another process began; these must not be continued.
  const bool is_begun = begun_ == request.name() && utime_us_ == utime_us;
  header.first = is_begun && request.have_points < header.count ? request.have_points : 0;
  begun_ = request.name();
  utime_us_ = utime_us;
  resumed_from_ = header.first;
  const std::size_t end = std::min<std::size_t>(xyz.size() / 3, cut_after_points);
  const hal::ScanHeaderBytes bytes = hal::encode_scan_header(header);
  const std::size_t begin = std::min<std::size_t>(header.first, end);
  const bool sent = send_all(bytes) && send_all(std::as_bytes(xyz.subspan(3 * begin, 3 * (end - begin))));
  if (sent && end < xyz.size() / 3) {
    close();
    return error(Code::scanner_offline, "cut off after %zu points, as requested", end);
  }
  // Read also after a failed send, because slabd sends the reason before it closes.
  const auto until = Clock::now() + std::chrono::milliseconds(kAnswer_ms);
  while (const std::optional<std::string> text = next_line(left_ms(until))) {
    const json line = json::parse(*text, nullptr, false);
    if (!line.is_object() || line.value("schema", "") != "slabd.scan_answer/1") continue;
    if (line.value("ok", false)) return success();
    const std::string why = line.value("error", "");
    return error(static_cast<Code>(line.value("code", static_cast<int>(Code::internal))), "slabd refused the scan: %s",
                 why.c_str());
  }
  const bool open = socket_.is_open();
  close();
  return error(Code::scanner_offline, open ? "slabd did not answer the scan" : "the connection was lost");
}

}  // namespace slabd::emulator
