// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "base/limits.h"
#include "base/result.h"
#include "base/robot.h"

namespace slabd::daemon {

/// Mean of poses and their spread about it.
struct PoseMean {
  Pose T_base_flange;
  double spread_mm = 0.0;   ///< largest peak to valley of x, y, z
  double spread_rad = 0.0;  ///< twice the largest angle from the mean
  std::uint32_t samples = 0;
};

/// Decides from the last two seconds of poses, at any rate, whether the robot stands still. Pure; fed by `add`.
///
/// Poses that arrive within kSlice_ns of each other are kept as one slice: count, sums, extremes and flags of all of
/// them. So a fast sender needs no more memory than one of 250 Hz, and every pose is part of the decision.
///
/// Settled: over `window_ns` and at least `samples_min` samples, without a gap, peak to valley is within the limits. No
/// sample has the flag "moving" or "emergency stop". This must last for `dwell_ns` more. A gap, a sequence jump, a step
/// back of the sender's clock or a wrong frame restarts the window.
class PoseGate {
 public:
  /// Silence after which the sender is forgotten, because the next pose may come from another program. The pose link
  /// does not accept another program sooner.
  static constexpr std::int64_t kForget_ns = kNsPerS;
  /// Poses of one slice arrive within this time, so that the ring of slices holds at least two seconds of a sender that
  /// never pauses.
  static constexpr std::int64_t kSlice_ns = 2 * kNsPerS / static_cast<std::int64_t>(limits::kPoseRing - 1) + 1;

  explicit PoseGate(const PoseSettings& settings) : settings_(settings) {}

  void add(const PoseSample& sample);

  /// ok if a pose in the right frame is fresh; no_pose, pose_stale, wrong_frame otherwise.
  [[nodiscard]] Code link(std::int64_t now_ns) const;
  /// ok and the mean of the settled window, or the reason against it (link()'s codes, not_settled).
  [[nodiscard]] Code settled(std::int64_t now_ns, PoseMean& mean) const;
  /// True if the newest pose lacks the flag "stopped" although its sender has set it before: the gate does not settle
  /// until it is set again. Reset after kForget_ns of silence.
  [[nodiscard]] bool lacks_stopped() const;
  /// nullptr before the first pose.
  [[nodiscard]] const PoseSample* newest() const { return slices_ == 0 ? nullptr : &newest_; }
  /// Starts watching an exposure from the settled pose. Unlike the ring, the watch has no length limit, because a
  /// scanner may take longer than two seconds.
  void begin_exposure(const Pose& start);
  /// After the exposure, which ended at `to_ns`: ok and the mean over it. moved_during_scan if any sample left the
  /// start by more than the limits or had the flag "moving"; wrong_frame; pose_stale while no sample sent after `to_ns`
  /// has arrived (call again after the next sample). pose_stale permanently if samples were missing for longer than
  /// `gap_us` of the sender's clock. Samples that are not newer than the last one do not count.
  [[nodiscard]] Code held_still(std::int64_t to_ns, PoseMean& mean) const;

 private:
  using QuatSum = Eigen::Matrix<double, 4, 1, Eigen::DontAlign>;
  /// Poses that arrived together. Offsets are relative to the first one.
  struct Slice {
    Pose first;
    std::int64_t arrival_ns = 0;  ///< of the first one
    std::uint32_t samples = 0;
    Vec3 offset_sum_mm = Vec3::Zero();
    Vec3 offset_low_mm = Vec3::Zero();
    Vec3 offset_high_mm = Vec3::Zero();
    QuatSum quat_sum = QuatSum::Zero();  ///< with the sign of the first one
    double away_rad = 0.0;               ///< largest angle from the first one
    std::uint64_t clocks_apart_us = 0;   ///< the smallest one; see Exposure
    bool estop = false;                  ///< of any sample
    bool not_stopped = false;            ///< of any sample

    void add(const PoseSample& sample, std::uint64_t sample_clocks_apart_us);
  };
  /// The slices of the present run, from the newest (0) back to the oldest (slices_ - 1).
  [[nodiscard]] const Slice& slice(std::size_t back) const {
    return ring_[(newest_place_ + ring_.size() - back) % ring_.size()];
  }
  [[nodiscard]] PoseMean mean_of_newest(std::size_t slices) const;

  PoseSettings settings_;
  std::array<Slice, limits::kPoseRing> ring_;
  std::size_t newest_place_ = 0;
  std::size_t slices_ = 0;  ///< since the run started; 0: no pose yet
  PoseSample newest_;
  bool stopped_flag_used_ = false;  ///< the sender supplies "stopped", so it must be set

  struct Exposure {
    Pose start;
    Code verdict = Code::no_pose;    ///< ok while every sample so far is within the limits
    bool stopped_flag_used = false;  ///< kept until the exposure ends
    std::int64_t newest_utime_us = 0;
    std::uint64_t clocks_apart_us = 0;  ///< slabd's clock minus the sender's, modulo 2^64
    std::uint32_t samples = 0;
    Vec3 offset_sum_mm = Vec3::Zero();
    Vec3 offset_low_mm = Vec3::Zero();
    Vec3 offset_high_mm = Vec3::Zero();
    QuatSum quat_sum = QuatSum::Zero();
    double away_rad = 0.0;
  } exposure_;
  void watch(const PoseSample& sample);
};

}  // namespace slabd::daemon
