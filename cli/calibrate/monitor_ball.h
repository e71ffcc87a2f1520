// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "base/base.h"
#include "cli/terminal/parse.h"
#include "config/config.h"

namespace slabd::args {
class Command;
}  // namespace slabd::args

/// One look at the ball that is fixed in the cell: from a scan file and the pose it was taken from, or from the running
/// line, which knows both.
namespace slabd::cli {

struct BallLook {
  std::string scan;
  std::string flange;  ///< T_base_flange as reported: "x y z qw qx qy qz"
  bool live = false;   ///< scan and pose come from the daemon instead
  std::string who;     ///< live: holds the line meanwhile; empty: the login
  double radius_mm = kNoValue;
  double noise_mm = 0.05;
  ScanFormOptions form;

  /// --flange, --live, --radius, --noise, --unit, --columns.
  void add_to(args::Command& command);
};

struct SeenBall {
  Pose T_base_flange;
  Vec3 p_base_mm = Vec3::Zero();  ///< centre, by the hand-eye calibration given
  std::string source;             ///< of the record: the scan, or the live view
};

/// Stops, with what is wrong and what to do, if the ball's place was not found.
[[nodiscard]] SeenBall look_at_ball(const daemon::Config& config, const BallLook& look, const Pose& T_flange_scanner);

/// The pose a ball's record was taken from, as its observations keep it, and back.
[[nodiscard]] std::string ball_observations(const SeenBall& seen, std::string_view hand_eye_id);
[[nodiscard]] std::optional<Pose> ball_pose_of(const std::string& observations);

}  // namespace slabd::cli
