// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "base/base.h"

/// KUKA RobotSensorInterface (RSI), the controller's half: every 4 or 12 ms one UDP datagram, a small XML document as
/// its ETHERNET object is configured (docs/ROBOT.md has the file):
///
///   <Rob Type="KUKA"><RIst X="1620.0000" Y="0.0000" Z="1910.0000" A="0.0000" B="90.0000" C="0.0000"/>
///   <Base>0</Base><Tool>0</Tool><Stopped>1</Stopped><IPOC>4208775012</IPOC></Rob>
///
/// RIst is where the tool stands in the base, measured: mm and degrees, R = Rz(A) Ry(B) Rx(C). With $TOOL = $NULLFRAME
/// and $BASE = $NULLFRAME it is the flange in the robot's root, which is what slabd asks for. IPOC counts milliseconds.
/// Base, Tool, Stopped and Emulated are not in every configuration.
namespace slabd::kuka {

/// Largest datagram that is looked at.
inline constexpr std::size_t kRsiBytesMax = 1500;

struct RsiPacket {
  Pose T_base_flange;  ///< mm
  std::int64_t ipoc_ms = 0;
  std::optional<std::int16_t> base_id;
  std::optional<std::int16_t> tool_id;
  std::optional<bool> stopped;
  bool emulated = false;  ///< <Emulated>1</Emulated>: there is no robot behind it
};

/// One datagram. frame_incomplete: not such a document; the text names element, attribute and allowed range. Uses the
/// heap.
[[nodiscard]] Result<RsiPacket> parse_rsi(std::string_view datagram);

/// What a pose needs beside the packet.
struct BridgeSettings {
  std::int64_t cycle_ms = 4;  ///< 4 (IPO_FAST) or 12
  std::int16_t base_id = 0;   ///< where the packets do not say; somebody else vouches for them then
  std::int16_t tool_id = 0;
};

/// A message for slabd, before LCM's encoding. Units as in hal/robot/flange_pose.lcm.
struct FlangePose {
  std::int64_t robot_time_us = -1;
  std::int32_t seq = 0;
  std::int16_t base_id = 0;
  std::int16_t tool_id = 0;
  std::int32_t flags = 0;  ///< bit 0 measured, bit 1 stopped (only where the controller says so), bit 4 emulated
  Pose T_base_flange;      ///< mm
};

/// Who sends: while two do, neither is believed, because nobody can say which one is the robot. Told apart by address;
/// a port may change whenever RSI is started anew.
class Senders {
 public:
  /// Silence after which a sender is gone.
  static constexpr std::int64_t kSilentNs = kNsPerS;
  enum class Answer : std::uint8_t {
    alone,  ///< the one that has sent all the time
    other,  ///< the first, or another one than before, which has been silent
    two     ///< not to be believed
  };
  /// A usable packet of `address` at `now_ns` of a clock that runs forward.
  [[nodiscard]] Answer hear(std::uint32_t address, std::int64_t now_ns);
  /// The one that sends beside `address`, when two do.
  [[nodiscard]] std::uint32_t beside(std::uint32_t address) const {
    return first_.address == address ? second_.address : first_.address;
  }

 private:
  struct Heard {
    std::uint32_t address = 0;
    std::int64_t at_ns = 0;
    bool ever = false;
    [[nodiscard]] bool lately(std::int64_t now_ns) const { return ever && now_ns - at_ns < kSilentNs; }
  };
  Heard first_;
  Heard second_;
};

struct BridgeCounters {
  std::uint64_t published = 0;
  std::uint64_t malformed = 0;
  std::uint64_t old = 0;       ///< repeated or overtaken by a newer one: not published
  std::uint64_t lost = 0;      ///< cycles that never came
  std::uint64_t restarts = 0;  ///< of the controller's count, or with another controller
};

/// Keeps the packets in order and counts what is missing: `seq` jumps by the cycles that were lost, so that slabd sees
/// the gap. A count that goes back by more than a second is a controller that was started again.
class Bridge {
 public:
  explicit Bridge(const BridgeSettings& settings) : settings_(settings) {}
  /// Nothing when the packet is old.
  [[nodiscard]] std::optional<FlangePose> translate(const RsiPacket& packet);
  /// The next packet is of another controller, with a count of its own.
  void begin_anew() { anew_ = true; }
  void count_malformed() { ++counters_.malformed; }
  [[nodiscard]] const BridgeCounters& counters() const { return counters_; }

 private:
  [[nodiscard]] std::int32_t seq_ahead(std::int64_t by) const;

  BridgeSettings settings_;
  BridgeCounters counters_;
  bool anew_ = false;
  std::int64_t ipoc_ms_ = -1;
  std::int32_t seq_ = -1;
};

}  // namespace slabd::kuka
