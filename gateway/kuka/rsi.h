// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "base/base.h"

/// KUKA RobotSensorInterface (RSI), the controller's side: every 4 or 12 ms one UDP datagram, a small XML document in
/// the format configured in its ETHERNET object (docs/ROBOT.md contains the file):
///
///   <Rob Type="KUKA"><RIst X="1620.0000" Y="0.0000" Z="1910.0000" A="0.0000" B="90.0000" C="0.0000"/>
///   <Base>0</Base><Tool>0</Tool><Stopped>1</Stopped><IPOC>4208775012</IPOC></Rob>
///
/// RIst is the measured pose of the tool in the base: mm and degrees, R = Rz(A) Ry(B) Rx(C). With $TOOL = $NULLFRAME
/// and $BASE = $NULLFRAME it is the flange in the robot root frame, which slabd requires. IPOC counts milliseconds.
/// Base, Tool, Stopped and Emulated are optional.
namespace slabd::gateway::kuka {

/// Largest accepted datagram.
inline constexpr std::size_t kRsiBytesMax = 1500;

struct RsiPacket {
  Pose T_base_flange;  ///< mm
  std::int64_t ipoc_ms = 0;
  std::optional<std::int16_t> base_id;
  std::optional<std::int16_t> tool_id;
  std::optional<bool> stopped;
  bool emulated = false;  ///< <Emulated>1</Emulated>: the pose is not from a real robot
};

/// Parses one datagram. Code::frame_incomplete if it is not such a document; the text names element, attribute and
/// allowed range. Uses the heap.
[[nodiscard]] Result<RsiPacket> parse_rsi(std::string_view datagram);

/// Settings that complete a packet to a pose.
struct BridgeSettings {
  std::int64_t cycle_ms = 4;  ///< 4 (IPO_FAST) or 12
  std::int16_t base_id = 0;   ///< used if the packets do not contain it; it is then not verified
  std::int16_t tool_id = 0;
};

/// A message for slabd before LCM encoding. Units as in hal/robot/flange_pose.lcm.
struct FlangePose {
  std::int64_t robot_time_us = -1;
  std::int32_t seq = 0;
  std::int16_t base_id = 0;
  std::int16_t tool_id = 0;
  std::int32_t flags = 0;  ///< bit 0 measured, bit 1 stopped (only if the controller reports it), bit 4 emulated
  Pose T_base_flange;      ///< mm
};

/// Detects competing senders: while two controllers send, both are rejected, because the real one is unknown. Senders
/// are distinguished by address, because the port may change when RSI is restarted.
class Senders {
 public:
  /// Time without packets after which a sender is removed.
  static constexpr std::int64_t kSilent_ns = kNsPerS;
  enum class Answer : std::uint8_t {
    alone,  ///< the same sender as before
    other,  ///< the first sender, or a new one after the previous one has been silent
    two     ///< two senders: the packet is rejected
  };
  /// Registers a usable packet from `address` at `now_ns` of a monotonic clock.
  [[nodiscard]] Answer hear(std::uint32_t address, std::int64_t now_ns);
  /// The other sender if two send, one of them from `address`.
  [[nodiscard]] std::uint32_t other_than(std::uint32_t address) const {
    return first_.address == address ? second_.address : first_.address;
  }

 private:
  struct LastPacket {
    std::uint32_t address = 0;
    std::int64_t at_ns = 0;
    bool ever = false;
    [[nodiscard]] bool lately(std::int64_t now_ns) const { return ever && now_ns - at_ns < kSilent_ns; }
  };
  LastPacket first_;
  LastPacket second_;
};

struct BridgeCounters {
  std::uint64_t published = 0;
  std::uint64_t malformed = 0;
  std::uint64_t old = 0;       ///< repeated or overtaken by a newer one: not published
  std::uint64_t lost = 0;      ///< cycles without a packet
  std::uint64_t restarts = 0;  ///< restarts of the controller's count, or changes of the controller
};

/// Keeps the packets in order and counts missing ones: `seq` jumps by the number of lost cycles, so that slabd detects
/// the gap. A count that decreases by more than a second means that the controller was restarted.
class Bridge {
 public:
  explicit Bridge(const BridgeSettings& settings) : settings_(settings) {}
  /// Message for the packet; nullopt if the packet is old.
  [[nodiscard]] std::optional<FlangePose> translate(const RsiPacket& packet);
  /// The next packet is from another controller, which has its own count.
  void restart() { restart_ = true; }
  void count_malformed() { ++counters_.malformed; }
  [[nodiscard]] const BridgeCounters& counters() const { return counters_; }

 private:
  [[nodiscard]] std::int32_t seq_ahead(std::int64_t by) const;

  BridgeSettings settings_;
  BridgeCounters counters_;
  bool restart_ = false;
  std::int64_t ipoc_ms_ = -1;
  std::int32_t seq_ = -1;
};

}  // namespace slabd::gateway::kuka
