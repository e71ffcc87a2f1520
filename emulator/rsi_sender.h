// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <netinet/in.h>

#include <cstdint>
#include <string>

#include "base/base.h"

/// A KUKA controller's half of RSI: the small XML documents it sends over UDP, every one of them, and what becomes of
/// some on a bad network.
namespace slabd::simulate {

class RsiSender {
 public:
  /// `to`: "HOST:PORT" of the bridge. `faults`: share of packets that get lost, come late or come garbled, a third
  /// each. config when `to` is no address.
  [[nodiscard]] static Result<RsiSender> open(const std::string& to, double faults, std::uint64_t seed);
  RsiSender(RsiSender&& other) noexcept;
  RsiSender& operator=(RsiSender&&) = delete;
  RsiSender(const RsiSender&) = delete;
  ~RsiSender();

  /// One cycle. Rounded to four decimals, as the controller does (mm, deg).
  void send(const Pose& T_base_flange, std::int16_t base_id, std::int16_t tool_id, bool stopped, std::int64_t ipoc_ms);

 private:
  RsiSender(int fd, const sockaddr_in& to, double faults, std::uint64_t seed)
      : fd_(fd), to_(to), faults_(faults), random_(seed) {}
  void put(const std::string& text) const;

  int fd_ = -1;
  sockaddr_in to_{};
  double faults_ = 0.0;
  Prng random_;
  std::string late_;
};

}  // namespace slabd::simulate
