// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "base/base.h"
#include "cli/exit.h"
#include "cli/terminal/parse.h"
#include "config/config.h"

namespace slabd::cli::args {
class Command;
}  // namespace slabd::cli::args

/// Measures the ball that is fixed in the cell: from a scan file and its pose, or from the running line, which has
/// both.
namespace slabd::cli {

/// Two radii that differ by more are not the same: the centre found would move by about the difference.
inline constexpr double kSameRadius_mm = 1e-6;

struct BallMeasurement {
  std::string scan;
  std::string flange;  ///< T_base_flange as reported: "x y z qw qx qy qz"
  bool live = false;   ///< scan and pose come from the daemon
  std::string who;     ///< live: operator that holds the line; empty: the login
  double radius_mm = kNoValue;
  double noise_mm = 0.05;
  ScanFormOptions form{.unit = "", .columns = ""};  ///< empty: the configuration's

  /// Adds --flange, --live, --radius, --noise, --unit, --columns.
  void add_to(args::Command& command);
};

struct MeasuredBall {
  Pose T_base_flange;
  Vec3 p_base_mm = Vec3::Zero();            ///< centre by the given hand-eye calibration
  std::string source;                       ///< source of the record: the scan, or the live view
  double radius_free_mm = kNoValue;         ///< from the fit with free radius
  double scanner_temperature_c = kNoValue;  ///< as the scan declares it
};

/// Measures the ball. Stops with reason and cure if it was not found.
[[nodiscard]] MeasuredBall look_at_ball(const config::Config& config, const BallMeasurement& look,
                                        const Pose& T_flange_scanner);

/// Views of the ball by the running line, in one session that holds the line.
class LiveBall {
 public:
  /// Stops with the reason if the line is not free.
  LiveBall(const config::Config& config, const BallMeasurement& look);
  ~LiveBall();
  LiveBall(const LiveBall&) = delete;
  LiveBall& operator=(const LiveBall&) = delete;

  /// Takes one view. nullopt on success, otherwise the reason; the session stays open.
  [[nodiscard]] std::optional<Stop> shoot(const Pose& T_flange_scanner, MeasuredBall& seen);
  /// Renews the lease between two views; it lasts kLease_s. Stops if the session was ended by another.
  void keep();
  /// Returns the line to idle. The destructor does the same.
  void end();
  static constexpr std::int64_t kLease_s = 30;

 private:
  struct Session;
  std::unique_ptr<Session> session_;
};

/// Message if the pose differs from the one in the ball's record, else empty: the robot's error there differs by up to
/// its absolute accuracy, which is not a drift.
[[nodiscard]] std::string seen_elsewhere(const config::Config& config, const std::string& observations,
                                         const MeasuredBall& seen);
/// Note of a check from another pose.
inline constexpr const char* kElsewhereNote = "seen from another pose";

/// The pose at which a ball's record was taken, as stored in its observations, and its parser.
[[nodiscard]] std::string ball_observations(const MeasuredBall& seen, std::string_view hand_eye_id);
[[nodiscard]] std::optional<Pose> ball_pose_of(const std::string& observations);

}  // namespace slabd::cli
