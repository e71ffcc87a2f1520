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

/// The longest stretch of poses, up to the newest one, over which the flange stood still: gapless numbers and times,
/// the right frame, no emergency stop, everything within the guard. Whatever breaks it starts a new stretch and is
/// remembered. Works at any rate of poses and for any length of stretch; pure, fixed size.
class StillWatch {
 public:
  enum class Break : std::uint8_t { none, moved, gap, clock, estop, not_stopped, wrong_frame };
  /// What ended a stretch, with what there is to say of it. A copy: later poses end further stretches.
  struct Broken {
    Break by = Break::none;
    PoseRange range;            ///< moved: of the stretch and the pose that ended it
    std::int32_t gap_from = 0;  ///< gap: sender's numbers around it
    std::int32_t gap_to = 0;
    std::int16_t base_id = 0;  ///< of the pose that ended it
    std::int16_t tool_id = 0;
  };

  StillWatch(const CaptureGuard& guard, const PoseSettings& settings) : guard_(guard), settings_(settings) {}

  /// Forgets everything: only poses from now on count.
  void begin();
  void add(const PoseSample& sample);
  /// From here on first_break() says what broke the stretch first, and over what range it moved in all since then: the
  /// pose that breaks a stretch of 0.01 mm is only the beginning of a drive.
  void mark() { marked_break_ = {}; }

  /// Has the stretch lasted as long as the guard asks for?
  [[nodiscard]] bool settled() const;
  [[nodiscard]] std::uint32_t samples() const { return samples_; }
  [[nodiscard]] const PoseSample& first() const { return first_; }
  [[nodiscard]] const PoseSample& newest() const { return newest_; }
  [[nodiscard]] const PoseRange& range() const { return range_; }
  [[nodiscard]] Pose mean() const;

  /// How far it moved in the last whole second (the first second: so far).
  [[nodiscard]] const PoseRange& recent() const { return recent_whole_ ? last_second_ : this_second_; }
  [[nodiscard]] const Broken& last_break() const { return last_break_; }
  [[nodiscard]] const Broken& first_break() const { return marked_break_; }
  /// What broke it, or, with Break::none, how it moved in the last second: a sentence's end without a full stop, for
  /// people.
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
  Pose marked_from_;  ///< where marked_break_.range counts from, when it moved

  bool recent_whole_ = false;
  PoseSample second_start_;
  PoseRange this_second_;
  PoseRange last_second_;
};

}  // namespace slabd::daemon
