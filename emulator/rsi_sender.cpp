// SPDX-License-Identifier: Apache-2.0
#include "emulator/rsi_sender.h"

#include <arpa/inet.h>
#include <fmt/core.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

namespace slabd::simulate {

Result<RsiSender> RsiSender::open(const std::string& to, double faults, std::uint64_t seed) {
  const std::size_t colon = to.rfind(':');
  const long port = colon == std::string::npos ? 0 : std::strtol(to.c_str() + colon + 1, nullptr, 10);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  if (port <= 0 || port > 65'535 || ::inet_pton(AF_INET, to.substr(0, colon).c_str(), &address.sin_addr) != 1)
    return error(Code::config, "--rsi %s: expected ADDRESS:PORT of the bridge, such as 127.0.0.1:49152", to.c_str());
  const int fd = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return error(Code::internal, "no UDP socket: %s", std::strerror(errno));
  return RsiSender(fd, address, faults, seed);
}

RsiSender::RsiSender(RsiSender&& other) noexcept
    : fd_(std::exchange(other.fd_, -1)),
      to_(other.to_),
      faults_(other.faults_),
      random_(other.random_),
      late_(std::move(other.late_)) {}

RsiSender::~RsiSender() {
  if (fd_ >= 0) ::close(fd_);
}

void RsiSender::put(const std::string& text) const {
  // Nobody there is the bridge's business.
  (void)::sendto(fd_, text.data(), text.size(), MSG_NOSIGNAL,
                 static_cast<const sockaddr*>(static_cast<const void*>(&to_)), sizeof to_);
}

void RsiSender::send(const Pose& T_base_flange, std::int16_t base_id, std::int16_t tool_id, bool stopped,
                     std::int64_t ipoc_ms) {
  const Vec3& p = T_base_flange.translation_mm;
  const KukaAbc abc = kuka_abc_from_rotation(T_base_flange.rotation);
  std::string text = fmt::format(
      "<Rob Type=\"KUKA\"><RIst X=\"{:.4f}\" Y=\"{:.4f}\" Z=\"{:.4f}\" A=\"{:.4f}\" B=\"{:.4f}\" C=\"{:.4f}\"/>"
      "<Base>{}</Base><Tool>{}</Tool><Stopped>{}</Stopped><Emulated>1</Emulated><Delay D=\"0\"/><IPOC>{}</IPOC></Rob>",
      p.x(), p.y(), p.z(), deg_from_rad(abc.a_rad), deg_from_rad(abc.b_rad), deg_from_rad(abc.c_rad), base_id, tool_id,
      stopped ? 1 : 0, ipoc_ms);
  const double dice = random_.uniform();
  if (dice < faults_ / 3.0) return;
  if (dice < 2.0 * faults_ / 3.0) {
    late_ = text;
    return;
  }
  if (dice < faults_) text.resize(1 + random_.below(text.size() - 1));
  put(text);
  if (!late_.empty()) put(late_);
  late_.clear();
}

}  // namespace slabd::simulate
