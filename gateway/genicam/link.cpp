// SPDX-License-Identifier: Apache-2.0
#include "gateway/genicam/link.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <nlohmann/json.hpp>

#include "hal/scan/scan_stream.h"

namespace slabd::gateway::genicam {
namespace {

using nlohmann::json;

/// Longest line that slabd sends: 640 bytes, with room for further members.
constexpr std::size_t kLineBytesMax = 65'536;
constexpr int kConnect_ms = 2'000;
/// Accepted range of timeout_ms: slabd's own is 1 to 60 s.
constexpr std::int64_t kTimeoutMin_ms = 100;
constexpr std::int64_t kTimeoutMax_ms = 120'000;
constexpr std::int64_t kTimeoutDefault_ms = 10'000;

std::int64_t now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

/// A member that is a whole number in the range; nullopt if it is missing or anything else.
std::optional<std::int64_t> whole(const json& line, const char* key, std::int64_t low, std::int64_t high) {
  const auto at = line.find(key);
  if (at == line.end() || !at->is_number_integer()) return std::nullopt;
  const auto number = at->get<std::int64_t>();
  return number < low || number > high ? std::nullopt : std::optional(number);
}

std::string text_of(const json& line, const char* key) {
  const auto at = line.find(key);
  return at != line.end() && at->is_string() ? at->get<std::string>() : std::string();
}

std::optional<Request> request_of(const json& line) {
  const auto session = whole(line, "session", 0, 65'535);
  const auto cmd_seq = whole(line, "cmd_seq", 0, 65'535);
  if (!session || !cmd_seq) return std::nullopt;
  Request request;
  request.session = static_cast<std::uint16_t>(*session);
  request.cmd_seq = static_cast<std::uint16_t>(*cmd_seq);
  const std::int64_t gateway = whole(line, "gateway", 1, 65'535).value_or(1);
  request.extended = gateway >= hal::kGatewayExtended;
  request.temperature = gateway >= hal::kGatewayTemperature;
  request.have_points = static_cast<std::uint32_t>(whole(line, "have_points", 0, limits::kScanPointsMax).value_or(0));
  request.timeout_ns =
      whole(line, "timeout_ms", kTimeoutMin_ms, kTimeoutMax_ms).value_or(kTimeoutDefault_ms) * kNsPerMs;
  request.slab_id = text_of(line, "slab_id");
  request.station = static_cast<int>(whole(line, "station", 0, 1'000).value_or(0));
  return request;
}

}  // namespace

Status Link::connect() {
  if (socket_.is_open()) return success();
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port_);
  if (inet_pton(AF_INET, host_.c_str(), &address.sin_addr) != 1)
    return error(Code::config, "[genicam] slabd: \"%s\" is not an IPv4 address", host_.c_str());
  Fd socket(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  int why = 0;
  if (::connect(socket.get(), static_cast<const sockaddr*>(static_cast<const void*>(&address)), sizeof address) != 0)
    why = errno;
  if (why == EINPROGRESS) {
    pollfd ready{socket.get(), POLLOUT, 0};
    socklen_t bytes = sizeof why;
    if (poll(&ready, 1, kConnect_ms) <= 0)
      why = ETIMEDOUT;
    else
      getsockopt(socket.get(), SOL_SOCKET, SO_ERROR, &why, &bytes);
  }
  if (why != 0)
    return error(Code::scanner_offline, "%s:%u: %s (does slabd run, with [scanner] backend = \"tcp\" and this listen?)",
                 host_.c_str(), unsigned{port_}, errno_text(why));
  const int on = 1;
  setsockopt(socket.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  // A peer that lost its power sends no end, and between two scans nothing else is sent.
  setsockopt(socket.get(), SOL_SOCKET, SO_KEEPALIVE, &on, sizeof on);
  // The last also while data wait for their acknowledgement, when no probe is sent.
  constexpr std::array<std::array<int, 2>, 4> kWatch = {
      {{TCP_KEEPIDLE, 10}, {TCP_KEEPINTVL, 3}, {TCP_KEEPCNT, 3}, {TCP_USER_TIMEOUT, 20'000}}};
  for (const auto& [option, value] : kWatch) setsockopt(socket.get(), IPPROTO_TCP, option, &value, sizeof value);
  socket_ = std::move(socket);
  text_.clear();
  return success();
}

void Link::close() {
  socket_.reset();
  text_.clear();
}

std::optional<Request> Link::next_request(int wait_ms, std::string& note) {
  if (!socket_.is_open()) return std::nullopt;
  std::size_t end = text_.find('\n');
  if (end == std::string::npos) {
    pollfd waiting{socket_.get(), POLLIN, 0};
    if (poll(&waiting, 1, wait_ms) <= 0) return std::nullopt;
    std::array<char, 4'096> piece;
    const ssize_t n = recv(socket_.get(), piece.data(), piece.size(), 0);
    if (n < 0 && (errno == EINTR || errno == EAGAIN)) return std::nullopt;
    if (n <= 0 || text_.size() + static_cast<std::size_t>(n) > kLineBytesMax) return close(), std::nullopt;
    text_.append(piece.data(), static_cast<std::size_t>(n));
    end = text_.find('\n');
    if (end == std::string::npos) return std::nullopt;
  }
  const json line = json::parse(text_.begin(), text_.begin() + static_cast<std::ptrdiff_t>(end), nullptr, false);
  text_.erase(0, end + 1);
  if (!line.is_object()) return std::nullopt;
  const std::string schema = text_of(line, "schema");
  if (schema == "slabd.scan_request/1") return request_of(line);
  if (schema == "slabd.scan_answer/1") {
    const auto ok = line.find("ok");
    if (ok != line.end() && ok->is_boolean() && !ok->get<bool>()) note = text_of(line, "error");
  }
  return std::nullopt;
}

bool Link::send_all(std::span<const std::byte> bytes, std::int64_t until_ns) {
  while (!bytes.empty()) {
    const std::int64_t left_ns = until_ns - now_ns();
    if (left_ns <= 0) return false;
    pollfd room{socket_.get(), POLLOUT | POLLRDHUP, 0};
    if (poll(&room, 1, static_cast<int>(left_ns / kNsPerMs + 1)) < 0 && errno != EINTR) return false;
    if ((room.revents & (POLLRDHUP | POLLHUP | POLLERR)) != 0) return false;
    const ssize_t n = ::send(socket_.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (n < 0 && (errno == EINTR || errno == EAGAIN)) continue;
    if (n <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(n));
  }
  return true;
}

Status Link::send(const Request& request, const Shot& shot, std::span<const float> xyz, std::uint32_t first,
                  const std::string& scanner, bool emulated, std::int64_t until_ns) {
  hal::ScanStreamHeader header;
  header.session = request.session;
  header.cmd_seq = request.cmd_seq;
  header.width = shot.width;
  header.height = shot.height;
  header.count = static_cast<std::uint32_t>(xyz.size() / 3);
  header.first = first < header.count ? first : 0;
  header.utime_us = static_cast<std::uint64_t>(shot.utime_us);
  header.points_crc = hal::crc32c(std::as_bytes(xyz));
  header.emulated = emulated;
  if (request.extended) header.scanner = hal::scanner_print(scanner);
  if (request.temperature) header.temperature_ck = hal::temperature_ck_of(shot.temperature_c);
  const hal::ScanHeaderBytes bytes = hal::encode_scan_header(header);
  if (send_all(bytes, until_ns) && send_all(std::as_bytes(xyz.subspan(3 * std::size_t{header.first})), until_ns))
    return success();
  close();
  return error(Code::scanner_offline, "the connection to slabd was lost while the scan was sent");
}

Status Link::refuse(const Request& request, const Error& why, std::int64_t until_ns) {
  if (!request.extended) return success();
  const bool of_scanner = why.code >= Code::scanner_offline && why.code <= Code::exposure;
  const std::string_view reason = why.text.view().substr(0, hal::kRefusalBytesMax);
  hal::ScanStreamHeader header;
  header.session = request.session;
  header.cmd_seq = request.cmd_seq;
  header.refused = true;
  // A camera that does not fit its settings is as good as none.
  header.width = static_cast<std::uint32_t>(of_scanner ? why.code : Code::scanner_offline);
  header.count = static_cast<std::uint32_t>(reason.size());
  header.points_crc = hal::crc32c(std::as_bytes(std::span(reason)));
  const hal::ScanHeaderBytes bytes = hal::encode_scan_header(header);
  if (send_all(bytes, until_ns) && send_all(std::as_bytes(std::span(reason)), until_ns)) return success();
  close();
  return error(Code::scanner_offline, "the connection to slabd was lost");
}

}  // namespace slabd::gateway::genicam
