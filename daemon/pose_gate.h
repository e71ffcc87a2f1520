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
/// sample that says "moving" or "emergency stop", plus `dwell_ns` since that became true. A gap, a sequence jump, a
/// step back of the sender's clock or a wrong frame restarts the window.
class PoseGate {
 public:
  /// Silence after which the sender is forgotten: what comes then may be another program. The pose link believes no
  /// other one sooner.
  static constexpr std::int64_t kForgetNs = kNsPerS;

  explicit PoseGate(const PoseSettings& settings) : settings_(settings) {}

  void add(const PoseSample& sample);

  /// ok when a pose in the right frame is fresh; no_pose, pose_stale, wrong_frame otherwise.
  [[nodiscard]] Code link(std::int64_t now_ns) const;
  /// ok and the mean of the settled window, or the reason why not (link()'s answers, not_settled).
  [[nodiscard]] Code settled(std::int64_t now_ns, PoseMean& mean) const;
  /// The newest pose does not say "stopped", and its sender has said so before: until it does again nothing settles.
  /// Forgotten after kForgetNs of silence.
  [[nodiscard]] bool lacks_stopped() const;
  /// nullptr before the first.
  [[nodiscard]] const PoseSample* newest() const { return ring_.empty() ? nullptr : &ring_[ring_.size() - 1]; }
  /// Starts watching an exposure from the settled pose. Unlike the ring, the watch has no length limit: a scanner may
  /// take longer than two seconds.
  void begin_exposure(const Pose& start);
  /// After the exposure, which ended at `to_ns`: ok and the mean over it; moved_during_scan when any sample left the
  /// start by more than the limits or said "moving"; wrong_frame; pose_stale while nothing sent after `to_ns` has come
  /// (ask again after the next sample), and for good when samples were missing for longer than `gap_us` of the sender's
  /// clock. Samples that are not newer than the last one do not count.
  [[nodiscard]] Code held_still(std::int64_t to_ns, PoseMean& mean) const;

 private:
  PoseSettings settings_;
  FixedQueue<PoseSample, limits::kPoseRing> ring_;
  std::size_t run_length_ = 0;      ///< samples since the last break, counted from the newest
  bool stopped_flag_used_ = false;  ///< the sender supplies "stopped": it must then be set

  struct Exposure {
    Pose start;
    Code verdict = Code::no_pose;    ///< ok while every sample so far held still
    bool stopped_flag_used = false;  ///< is not forgotten before the exposure ends
    std::int64_t newest_utime_us = 0;
    std::uint64_t clocks_apart_us = 0;  ///< our clock minus the sender's, modulo 2^64
    std::uint32_t samples = 0;
    Vec3 offset_sum_mm = Vec3::Zero();
    Vec3 offset_low_mm = Vec3::Zero();
    Vec3 offset_high_mm = Vec3::Zero();
    Eigen::Matrix<double, 4, 1, Eigen::DontAlign> quat_sum = decltype(quat_sum)::Zero();
    double away_rad = 0.0;
  } exposure_;
  void watch(const PoseSample& sample);
};

}  // namespace slabd::daemon
