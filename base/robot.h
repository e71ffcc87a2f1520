// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "base/pose.h"

namespace slabd {

/// One flange pose as received, converted to mm. Decisions use `arrival_ns` (local monotonic clock), records use
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
  bool emulated = false;   ///< the sender declares an emulated robot
  bool commanded = false;  ///< the message has flags, but not the flag "measured"
  Pose T_base_flange;
  std::uint8_t arm = 0;  ///< whose robot this is: index into LineArms::list
};

/// Criteria for a robot at rest, and its expected place. Lengths mm, angles rad, times ns.
struct PoseSettings {
  std::int64_t window_ns = 300'000'000;  ///< the pose is settled over this time ...
  int samples_min = 20;      ///< ... and at least this number of samples (a slower sender gets a longer window)
  double settled_mm = 0.03;  ///< peak to valley per axis; half the robot's repeatability
  double settled_rad = 0.003 * kPi / 180.0;
  std::int64_t dwell_ns = 200'000'000;  ///< waiting time for the swing of the arm, which the encoders do not measure
  double moved_mm = 0.05;               ///< largest motion during the exposure
  double moved_rad = 0.005 * kPi / 180.0;
  std::int64_t stale_ns = 100'000'000;  ///< a pose older than this is not used
  std::int64_t gap_us = 100'000;        ///< sender's clock; a longer gap restarts the window
  std::int16_t base_id = 0;             ///< KUKA base and tool for which the pose is the flange in ROBROOT
  std::int16_t tool_id = 0;
  double look_mm = 150.0;  ///< largest distance of the block centre from the scanner's axis
};

/// Required stillness of the flange for a calibration view. All scans until the next calibration depend on a view, so
/// these limits are stricter than the production gate. Wider limits are for a robot that cannot meet them; they are
/// reported with every view.
struct CaptureGuard {
  static constexpr double kStable_mm = 0.01;
  static constexpr double kStable_rad = 0.001 * kPi / 180.0;
  static constexpr std::int64_t kStable_ns = 1'000'000'000;

  double stable_mm = kStable_mm;        ///< peak to valley of x, y, z ...
  double stable_rad = kStable_rad;      ///< ... and of the rotation about each axis ...
  std::int64_t stable_ns = kStable_ns;  ///< ... for this time before the scan, and during it
  int samples_min = 20;                 ///< in the time before the scan

  [[nodiscard]] bool is_wider() const {
    return stable_mm > kStable_mm || stable_rad > kStable_rad * (1.0 + 1e-9) || stable_ns < kStable_ns;
  }
};

}  // namespace slabd
