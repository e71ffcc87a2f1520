// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string_view>

#include "hal/hal.h"

/// What a single datagram cannot show: whether a well-formed pose fits those before it. Pure; no heap.
namespace slabd::hal {

struct PosePublisher {
  std::uint32_t address = 0;  ///< IPv4, host byte order
  std::uint16_t port = 0;
  friend bool operator==(const PosePublisher&, const PosePublisher&) = default;
};

class PoseScreen {
 public:
  /// Silence after which a publisher is gone, and another one (or the same one with another clock) is believed.
  static constexpr std::int64_t kSilentNs = kNsPerS;
  /// What no robot of this line does: a sample further from the last one is not believed until the next confirms it.
  static constexpr double kStepMm = 5.0;
  static constexpr double kSpeedMmPerS = 10'000.0;
  static constexpr double kStepRad = 0.05;
  static constexpr double kSpeedRadPerS = 20.0;

  /// Whether a well-formed pose that came at `mono_ns` is believed. Counts in `counters` what is wrong with it, and
  /// breaks in the numbering of those that are believed.
  ///   - Two publishers within a second: neither is believed, because nobody can say which one is the robot. Whether
  ///     they were two or one took the other's place shows later: when the first is heard again, or is not. Poses of
  ///     one that took over are no `second_publisher`; next_note() tells the change and how many were not believed.
  ///   - A clock that stands still or runs back: an old or a repeated message. After a second without any that could
  ///     be believed, whatever comes is: the sender's clock was set.
  ///   - A clock that runs a thousand times too fast or too slow: its utime is in another unit, and nothing that asks
  ///     for times could hold. Seen after a second, and refused until it runs as it should for half of one.
  ///   - A jump: refused once, and believed when the next sample lies where the jump went.
  [[nodiscard]] bool admit(const PosePublisher& from, std::int64_t mono_ns, const PoseSample& sample,
                           PoseLinkCounters& counters);
  /// A datagram that was refused before it could be looked at as a pose: for refusal() and the log.
  void note_sender(const PosePublisher& from, std::int64_t mono_ns, const char* why);

  /// See PosePort.
  [[nodiscard]] std::string_view refusal(std::int64_t mono_ns) const;
  [[nodiscard]] bool next_note(std::int64_t mono_ns, const PoseLinkCounters& now, PoseNoteText& text);

 private:
  struct Heard {
    PosePublisher who;
    std::int64_t at_ns = 0;
    bool ever = false;
    [[nodiscard]] bool within(std::int64_t mono_ns, std::int64_t span_ns) const {
      return ever && mono_ns - at_ns < span_ns;
    }
  };
  [[nodiscard]] bool is_alone(const PosePublisher& from, std::int64_t mono_ns, PoseLinkCounters& counters);
  void settle_rivals(PoseLinkCounters& counters);
  /// Compares the sender's clock with the arrivals, twice a second.
  void weigh_clock(std::int64_t mono_ns, const PoseSample& sample);
  void count_numbering(const PoseSample& sample, PoseLinkCounters& counters);
  [[gnu::format(printf, 4, 5)]] void refuse(const PosePublisher& from, std::int64_t mono_ns, const char* format, ...);

  Heard owner_;
  Heard rival_;
  int strangers_ = 0;              ///< in a row: publishers of the owner's computer that were not heard before
  std::uint64_t since_owner_ = 0;  ///< poses of the rival since the owner was heard
  std::uint64_t changes_ = 0;      ///< of the owner, since the last note ...
  std::uint64_t waited_ = 0;       ///< ... and poses of the new one that were not believed before it
  bool has_last_ = false;
  PoseSample last_;           ///< believed
  std::int64_t last_ns_ = 0;  ///< when
  bool has_pending_ = false;  ///< the sample before this one jumped
  PoseSample pending_;
  bool has_seq_ = false;
  std::int32_t seq_ = 0;  ///< of the last sample that was not a repetition

  std::int64_t clock_from_ns_ = 0;  ///< arrival and utime where the comparison of the clocks began; 0: not yet
  std::int64_t clock_from_us_ = 0;
  int clock_samples_ = 0;
  int clock_odd_ = 0;                 ///< comparisons in a row that another unit explains
  const char* clock_unit_ = nullptr;  ///< what the sender's utime counts in instead of microseconds

  PoseNoteText refusal_;
  std::int64_t refused_ns_ = 0;
  PoseLinkCounters said_;
  std::int64_t next_note_ns_ = 0;
};

}  // namespace slabd::hal
