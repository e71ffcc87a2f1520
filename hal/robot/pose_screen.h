// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "base/rate_limit.h"
#include "hal/hal.h"

/// Checks that need more than one datagram: whether a well-formed pose fits the preceding ones. Pure; no heap.
namespace slabd::hal {

struct PosePublisher {
  std::uint32_t address = 0;  ///< IPv4, host byte order
  std::uint16_t port = 0;
  friend bool operator==(const PosePublisher&, const PosePublisher&) = default;
};

class PoseScreen {
 public:
  /// Silence after which a publisher is considered gone, and another one (or the same with another clock) is accepted.
  static constexpr std::int64_t kSilent_ns = kNsPerS;
  /// Limits that no robot of this line exceeds: a sample further from the last one is accepted only if the next
  /// confirms it.
  static constexpr double kStep_mm = 5.0;
  static constexpr double kSpeedMmPerS = 10'000.0;
  static constexpr double kStep_rad = 0.05;
  static constexpr double kSpeedRadPerS = 20.0;

  /// True if a well-formed pose that arrived at `mono_ns` is accepted. Counts in `counters` the reason of a refusal,
  /// and gaps in the numbering of accepted poses.
  ///   - Two publishers within a second: both are refused, because slabd cannot decide which one is the robot. If the
  ///     first publisher stays silent, the second has replaced it, and its poses do not count as `second_publisher`.
  ///     next_note() reports the change and the number of poses refused before it. One program that changes its socket
  ///     is refused in the same way, and named: its sockets do not return, or its numbers continue across them.
  ///   - A clock that does not advance or goes backwards: an old or a repeated message. After a second without an
  ///     accepted pose the next one is accepted: the sender's clock was set.
  ///   - A clock that runs a thousand times too fast or too slow: utime has another unit, so no check of times would
  ///     work. Detected after a second, and refused until the rate is right for half a second. A clock in seconds is
  ///     detected after three.
  ///   - A jump: refused once, and accepted if the next sample is near the position of the jump.
  [[nodiscard]] bool admit(const PosePublisher& from, std::int64_t mono_ns, const PoseSample& sample,
                           PoseLinkCounters& counters);
  /// Records the sender of a datagram that was refused before this check, for refusal() and the log.
  void note_sender(const PosePublisher& from, std::int64_t mono_ns, const char* why);

  /// See PosePort.
  [[nodiscard]] std::string_view refusal(std::int64_t mono_ns) const;
  [[nodiscard]] bool next_note(std::int64_t mono_ns, const PoseLinkCounters& now, PoseNoteText& text);

 private:
  struct LastPose {
    PosePublisher who;
    std::int64_t at_ns = 0;
    bool ever = false;
    [[nodiscard]] bool within(std::int64_t mono_ns, std::int64_t span_ns) const {
      return ever && mono_ns - at_ns < span_ns;
    }
  };
  [[nodiscard]] bool is_alone(const PosePublisher& from, std::int64_t mono_ns, PoseLinkCounters& counters);
  void settle_rivals(PoseLinkCounters& counters);
  /// Counts changes of the socket on one computer.
  void follow_sockets(const PosePublisher& from, std::int64_t mono_ns, const PoseSample& sample);
  /// Compares the sender's clock with the arrival times, twice a second.
  void check_clock(std::int64_t mono_ns, const PoseSample& sample);
  /// The same for a clock in seconds, which stands still between most messages.
  void check_seconds(std::int64_t mono_ns, const PoseSample& sample);
  void refuse_rival(const PosePublisher& from, std::int64_t mono_ns);
  void count_numbering(const PoseSample& sample, PoseLinkCounters& counters);
  [[gnu::format(printf, 4, 5)]] void refuse(const PosePublisher& from, std::int64_t mono_ns, const char* format, ...);

  LastPose owner_;
  LastPose rival_;
  LastPose heard_;                               ///< the last pose, of any publisher
  std::int32_t heard_seq_ = 0;                   ///< its number
  std::array<std::uint16_t, 8> recent_ports_{};  ///< a ring: sockets of that computer
  std::size_t next_port_ = 0;
  int strangers_ = 0;                   ///< changes in a row to a socket that was not seen before
  std::int64_t stranger_ns_ = 0;        ///< time of the last of them
  int continued_ = 0;                   ///< changes in a row across which the numbers continue
  std::uint64_t on_socket_ = 0;         ///< poses since the last change
  std::uint64_t on_socket_before_ = 0;  ///< poses on the socket before it
  std::uint64_t since_owner_ = 0;       ///< poses of the rival since the owner's last pose
  std::uint64_t changes_ = 0;           ///< of the owner, since the last note ...
  std::uint64_t waited_ = 0;            ///< ... and refused poses of the new owner before it
  bool has_last_ = false;
  PoseSample last_;           ///< the last accepted pose
  std::int64_t last_ns_ = 0;  ///< its arrival time
  bool has_pending_ = false;  ///< the sample before this one jumped
  PoseSample pending_;
  bool has_seq_ = false;
  std::int32_t seq_ = 0;  ///< of the last sample that was not a repetition

  std::int64_t clock_from_ns_ = 0;  ///< arrival and utime at the start of the clock comparison; 0: not started
  std::int64_t clock_from_us_ = 0;
  int clock_samples_ = 0;
  int clock_odd_ = 0;                 ///< comparisons in a row that fit another unit
  const char* clock_unit_ = nullptr;  ///< unit of the sender's utime if it is not microseconds

  std::int64_t seconds_from_ns_ = 0;  ///< the same for a clock in seconds
  std::int64_t seconds_from_us_ = 0;
  int seconds_samples_ = 0;
  bool in_seconds_ = false;

  PoseNoteText refusal_;
  std::int64_t refused_ns_ = 0;
  PoseLinkCounters said_;
  RateLimit note_limit_{10 * kNsPerS};
};

}  // namespace slabd::hal
