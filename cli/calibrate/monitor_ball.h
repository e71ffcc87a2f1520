// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "base/base.h"
#include "cli/terminal/parse.h"
#include "config/config.h"

namespace slabd::cli::args {
class Command;
}  // namespace slabd::cli::args

/// Measures the ball that is fixed in the cell: from a scan file and its pose, or from the running line, which has
/// both.
namespace slabd::cli {

struct BallMeasurement {
  std::string scan;
  std::string flange;  ///< T_base_flange as reported: "x y z qw qx qy qz"
  bool live = false;   ///< scan and pose come from the daemon
  std::string who;     ///< live: operator that holds the line; empty: the login
  double radius_mm = kNoValue;
  double noise_mm = 0.05;
  ScanFormOptions form;

  /// Adds --flange, --live, --radius, --noise, --unit, --columns.
  void add_to(args::Command& command);
};

struct MeasuredBall {
  Pose T_base_flange;
  Vec3 p_base_mm = Vec3::Zero();  ///< centre by the given hand-eye calibration
  std::string source;             ///< source of the record: the scan, or the live view
};

/// Measures the ball. Stops with reason and cure if it was not found.
[[nodiscard]] MeasuredBall look_at_ball(const config::Config& config, const BallMeasurement& look,
                                        const Pose& T_flange_scanner);

/// The pose at which a ball's record was taken, as stored in its observations, and its parser.
[[nodiscard]] std::string ball_observations(const MeasuredBall& seen, std::string_view hand_eye_id);
[[nodiscard]] std::optional<Pose> ball_pose_of(const std::string& observations);

}  // namespace slabd::cli
