// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "base/fixed.h"
#include "base/robot.h"

namespace slabd::daemon {

/// Peak to valley of a stretch of poses.
struct PoseRange {
  Vec3 low_mm = Vec3::Zero();
  Vec3 high_mm = Vec3::Zero();
  Vec3 low_rad = Vec3::Zero();
  Vec3 high_rad = Vec3::Zero();

  void clear() { *this = {}; }
  void add(const Vec3& off_mm, const Vec3& off_rad) {
    low_mm = low_mm.cwiseMin(off_mm);
    high_mm = high_mm.cwiseMax(off_mm);
    low_rad = low_rad.cwiseMin(off_rad);
    high_rad = high_rad.cwiseMax(off_rad);
  }
  [[nodiscard]] double mm() const { return (high_mm - low_mm).maxCoeff(); }
  [[nodiscard]] double rad() const { return (high_rad - low_rad).maxCoeff(); }
};

/// The longest run of poses, up to the newest one, over which the flange stood still. It has no gap in numbers and
/// times, the right frame, no emergency stop, and is within the guard. A violation starts a new run and is stored.
/// Works at any rate of poses and for any length of the run; pure, fixed size.
class StillWatch {
 public:
  enum class Break : std::uint8_t { none, moved, gap, clock, estop, not_stopped, wrong_frame };
  /// Reason why a run ended, with details. A copy, because later poses end further runs.
  struct Broken {
    Break by = Break::none;
    PoseRange range;            ///< moved: of the run and the pose that ended it
    std::int32_t gap_from = 0;  ///< gap: sender's numbers before and after it
    std::int32_t gap_to = 0;
    std::int16_t base_id = 0;  ///< of the pose that ended it
    std::int16_t tool_id = 0;
  };

  StillWatch(const CaptureGuard& guard, const PoseSettings& settings) : guard_(guard), settings_(settings) {}

  /// Clears the state: only poses from now on count.
  void begin();
  void add(const PoseSample& sample);
  /// From now on first_break() returns the first break, with the range of motion since then. The pose that breaks a run
  /// of 0.01 mm is only the beginning of a drive.
  void mark() { marked_break_ = {}; }

  /// True if the run has lasted as long as the guard requires.
  [[nodiscard]] bool settled() const;
  [[nodiscard]] std::uint32_t samples() const { return samples_; }
  [[nodiscard]] const PoseSample& first() const { return first_; }
  [[nodiscard]] const PoseSample& newest() const { return newest_; }
  [[nodiscard]] const PoseRange& range() const { return range_; }
  [[nodiscard]] Pose mean() const;

  /// Range of motion in the last complete second (in the first second: so far).
  [[nodiscard]] const PoseRange& recent() const { return recent_whole_ ? last_second_ : this_second_; }
  [[nodiscard]] const Broken& last_break() const { return last_break_; }
  [[nodiscard]] const Broken& first_break() const { return marked_break_; }
  /// Reason of the break or, with Break::none, the motion in the last second, for display: the end of a sentence,
  /// without a full stop.
  [[nodiscard]] FixedString<240> describe(const Broken& broken) const;

 private:
  void restart(const PoseSample& sample);
  void watch_second(const PoseSample& sample);
  void follow_marked(const PoseSample& sample);
  [[nodiscard]] Break broken_by(const PoseSample& sample) const;

  CaptureGuard guard_;
  PoseSettings settings_;
  bool any_ = false;
  bool stopped_flag_used_ = false;
  std::uint32_t samples_ = 0;
  PoseSample first_;
  PoseSample newest_;
  PoseRange range_;
  Vec3 sum_mm_ = Vec3::Zero();
  Vec3 sum_rad_ = Vec3::Zero();
  Broken last_break_;
  Broken marked_break_;
  Pose marked_from_;  ///< start of marked_break_.range, if it moved

  bool recent_whole_ = false;
  PoseSample second_start_;
  PoseRange this_second_;
  PoseRange last_second_;
};

}  // namespace slabd::daemon
