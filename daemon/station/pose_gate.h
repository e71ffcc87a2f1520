// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "base/limits.h"
#include "base/result.h"
#include "base/robot.h"

namespace slabd::daemon {

/// Mean of poses and how far they spread about it.
struct PoseMean {
  Pose T_base_flange;
  double spread_mm = 0.0;   ///< largest peak to valley of x, y, z
  double spread_rad = 0.0;  ///< twice the largest angle from the mean
  std::uint32_t samples = 0;
};

/// Decides whether the robot stands still, from the last two seconds of poses at any rate. Pure; fed by `add`.
///
/// Poses that arrive within kSliceNs of each other are kept as one slice: count, sums, extremes and flags of all of
/// them. A fast sender therefore needs no more room than one of 250 Hz, and no pose is left out of a decision.
///
/// Settled: over `window_ns` and at least `samples_min` samples, without a gap, peak to valley within the limits, no
/// sample that says "moving" or "emergency stop", plus `dwell_ns` since that became true. A gap, a sequence jump, a
/// step back of the sender's clock or a wrong frame restarts the window.
class PoseGate {
 public:
  /// Silence after which the sender is forgotten: what comes then may be another program. The pose link believes no
  /// other one sooner.
  static constexpr std::int64_t kForgetNs = kNsPerS;
  /// Poses of one slice arrive within this time. The ring of slices then holds two seconds or more of a sender that
  /// never pauses.
  static constexpr std::int64_t kSliceNs = 2 * kNsPerS / static_cast<std::int64_t>(limits::kPoseRing - 1) + 1;

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
  [[nodiscard]] const PoseSample* newest() const { return slices_ == 0 ? nullptr : &newest_; }
  /// Starts watching an exposure from the settled pose. Unlike the ring, the watch has no length limit: a scanner may
  /// take longer than two seconds.
  void begin_exposure(const Pose& start);
  /// After the exposure, which ended at `to_ns`: ok and the mean over it; moved_during_scan when any sample left the
  /// start by more than the limits or said "moving"; wrong_frame; pose_stale while nothing sent after `to_ns` has come
  /// (ask again after the next sample), and for good when samples were missing for longer than `gap_us` of the sender's
  /// clock. Samples that are not newer than the last one do not count.
  [[nodiscard]] Code held_still(std::int64_t to_ns, PoseMean& mean) const;

 private:
  using QuatSum = Eigen::Matrix<double, 4, 1, Eigen::DontAlign>;
  /// Poses that arrived together. Offsets are from the first one.
  struct Slice {
    Pose first;
    std::int64_t arrival_ns = 0;  ///< of the first one
    std::uint32_t samples = 0;
    Vec3 offset_sum_mm = Vec3::Zero();
    Vec3 offset_low_mm = Vec3::Zero();
    Vec3 offset_high_mm = Vec3::Zero();
    QuatSum quat_sum = QuatSum::Zero();  ///< of one sign with the first one
    double away_rad = 0.0;               ///< largest angle from the first one
    std::uint64_t clocks_apart_us = 0;   ///< the least of them; see Exposure
    bool estop = false;                  ///< of any
    bool not_stopped = false;            ///< of any

    void add(const PoseSample& sample, std::uint64_t sample_clocks_apart_us);
  };
  /// The slices of the run, from the newest (0) back to the oldest (slices_ - 1).
  [[nodiscard]] const Slice& slice(std::size_t back) const {
    return ring_[(newest_place_ + ring_.size() - back) % ring_.size()];
  }
  [[nodiscard]] PoseMean mean_of_newest(std::size_t slices) const;

  PoseSettings settings_;
  std::array<Slice, limits::kPoseRing> ring_;
  std::size_t newest_place_ = 0;
  std::size_t slices_ = 0;  ///< since the last break of the run; 0: no pose yet
  PoseSample newest_;
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
    QuatSum quat_sum = QuatSum::Zero();
    double away_rad = 0.0;
  } exposure_;
  void watch(const PoseSample& sample);
};

}  // namespace slabd::daemon
