// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <string_view>

#include "base/base.h"

/// The robot's half of the line, a thread. It publishes FLANGE_POSE over LCM as a KUKA bridge does, or sends RSI to
/// such a bridge as the controller does, moving or at rest. While it moves, the "stopped" flag is clear. At rest the
/// measured pose has an encoder tremor of one to two micrometres.
namespace slabd::emulator {

struct RobotTraits {
  std::string lcm_url;
  std::string channel;
  double rate_hz = 125.0;
  double move_s = 0.3;        ///< from one station to the next
  double tremor_mm = 0.0015;  ///< standard deviation per axis at rest
  std::int16_t base_id = 0;
  std::int16_t tool_id = 0;
  std::uint64_t seed = 1;
  std::string rsi;          ///< "HOST:PORT" of a bridge; empty: LCM
  double rsi_faults = 0.0;  ///< share of RSI packets that are lost, late or corrupted
};

/// "udpm://239.255.76.99:7667?ttl=0" -> "239.255.76.99"; LCM's default group if the URL names none.
[[nodiscard]] std::string_view multicast_group(std::string_view lcm_url);

class RobotPeer {
 public:
  /// Opens the link and starts to publish `T_base_flange`, at rest. Code::no_pose with the cure if the multicast route
  /// is missing; Code::config if `rsi` is not an address.
  [[nodiscard]] static Result<std::unique_ptr<RobotPeer>> start(const RobotTraits& traits, const Pose& T_base_flange);
  ~RobotPeer();
  RobotPeer(const RobotPeer&) = delete;
  RobotPeer& operator=(const RobotPeer&) = delete;

  /// Starts the motion and returns at once. A call during a motion starts from the current pose.
  void move_to(const Pose& T_base_flange);
  [[nodiscard]] bool standing() const;
  /// The reported pose, without the tremor.
  [[nodiscard]] Pose pose() const;

 private:
  struct Impl;
  explicit RobotPeer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace slabd::emulator
