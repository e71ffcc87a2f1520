// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "base/pose.h"

namespace slabd {

/// One flange pose as it arrived, converted to mm. Decisions use `arrival_ns` (our monotonic clock), records
/// `utime_us`.
struct PoseSample {
  std::int64_t arrival_ns = 0;
  std::int64_t utime_us = 0;
  std::int32_t seq = 0;
  std::int16_t base_id = 0;
  std::int16_t tool_id = 0;
  bool measured = false;
  bool stopped = false;
  bool running = false;
  bool estop = false;
  bool emulated = false;   ///< the sender declares that there is no real robot
  bool commanded = false;  ///< the message has flags, and they do not say "measured"
  Pose T_base_flange;
};

/// When the robot counts as standing still, and where it must stand. Lengths mm, angles rad, times ns.
struct PoseSettings {
  std::int64_t window_ns = 300'000'000;  ///< settled over this time ...
  int samples_min = 20;                  ///< ... and at least so many samples (a slower sender gets a longer window)
  double settled_mm = 0.03;              ///< peak to valley per axis; half the robot's repeatability
  double settled_rad = 0.003 * kPi / 180.0;
  std::int64_t dwell_ns = 200'000'000;  ///< for the arm's swing, which the encoders do not see
  double moved_mm = 0.05;               ///< allowed during the exposure
  double moved_rad = 0.005 * kPi / 180.0;
  std::int64_t stale_ns = 100'000'000;  ///< newest sample older than this: no pose
  std::int64_t gap_us = 100'000;        ///< sender's clock; a longer gap restarts the window
  std::int16_t base_id = 0;             ///< KUKA base and tool that make the pose the flange in ROBROOT
  std::int16_t tool_id = 0;
  double look_mm = 150.0;  ///< block centre off the scanner's axis, at most
};

/// How still a flange must stand for a view of a calibration. A view counts a hundred times (every scan until the next
/// calibration rests on it), so this is stricter than the gate of production. Wider limits are for a robot that cannot
/// do it; they are told with every view.
struct CaptureGuard {
  static constexpr double kStableMm = 0.01;
  static constexpr double kStableRad = 0.001 * kPi / 180.0;
  static constexpr std::int64_t kStableNs = 1'000'000'000;

  double stable_mm = kStableMm;        ///< peak to valley of x, y, z ...
  double stable_rad = kStableRad;      ///< ... and of the rotation about each axis ...
  std::int64_t stable_ns = kStableNs;  ///< ... for so long before the scan, and through it
  int samples_min = 20;                ///< in the time before the scan

  [[nodiscard]] bool is_wider() const {
    return stable_mm > kStableMm || stable_rad > kStableRad * (1.0 + 1e-9) || stable_ns < kStableNs;
  }
};

}  // namespace slabd
