// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

#include "base/codes.h"
#include "base/fixed.h"
#include "base/limits.h"
#include "base/robot.h"

namespace slabd::daemon {

/// Mean of poses and how far they spread about it.
struct PoseMean {
  Pose T_base_flange;
  double spread_mm = 0.0;   ///< largest peak to valley of x, y, z
  double spread_rad = 0.0;  ///< twice the largest angle from the mean
  std::uint32_t samples = 0;
};

/// Decides whether the robot stands still, from the last two seconds of poses. Pure; fed by `add`.
///
/// Settled: over `window_ns` and at least `samples_min` samples, without a gap, peak to valley within the limits, no
/// sample that says "moving", plus `dwell_ns` since that became true. A gap, a sequence jump, a step back of the
/// sender's clock or a wrong frame restarts the window.
class PoseGate {
 public:
  explicit PoseGate(const PoseSettings& settings) : settings_(settings) {}

  void add(const PoseSample& sample);
  void clear() { ring_.clear(); }

  /// ok when a pose in the right frame is fresh; no_pose, pose_stale, wrong_frame otherwise.
  [[nodiscard]] Code link(std::int64_t now_ns) const;
  /// ok and the mean of the settled window, or the reason why not (link()'s answers, not_settled).
  [[nodiscard]] Code settled(std::int64_t now_ns, PoseMean& mean) const;
  /// After the exposure [from_ns, to_ns]: ok and the mean over it, moved_during_scan when any sample left `start` by
  /// more than the limits or said so, pose_stale while nothing newer than to_ns has come (ask again).
  [[nodiscard]] Code held_still(const Pose& start, std::int64_t from_ns, std::int64_t to_ns, PoseMean& mean) const;

 private:
  PoseSettings settings_;
  FixedQueue<PoseSample, limits::kPoseRing> ring_;
};

}  // namespace slabd::daemon
