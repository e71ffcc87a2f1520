// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/base.h"

/// Input of a calibration: the flange poses reported by the robot, and the artefact as measured by the scanner; and
/// their text forms. No function here opens a file.
namespace slabd::calib {

enum class ArtefactKind : std::uint8_t {
  ball,  ///< one or more tooling balls fixed in the cell: `T_base_flange X c = p`
  pose,  ///< one artefact with a full pose, fixed in the cell: `T_base_flange X T_scanner_target = T_base_target`
};
[[nodiscard]] constexpr std::string_view name(ArtefactKind kind) {
  return kind == ArtefactKind::ball ? "ball" : "pose";
}

/// One ball in one view.
struct BallObservation {
  std::size_t ball = 0;           ///< index of the ball in the cell, from 0
  Vec3 centre_mm = Vec3::Zero();  ///< scanner frame
  /// Random part, scanner axes, k = 1. nullopt: the value stated for all.
  std::optional<Mat3> cov_mm2;
};

/// Measurements at one stop of the robot. A `ball` view has at least one sighting (the balls of one view share the
/// robot's error); a `pose` view has T_scanner_target.
struct View {
  std::size_t number = 0;  ///< number shown to people, from 1; 0: its place in the set
  Pose T_base_flange;      ///< as reported by the robot
  /// A, B, C as reported, before any wrapping, for the convention test, which tries other readings.
  std::optional<std::array<double, 3>> reported_abc_rad;
  std::vector<BallObservation> balls;
  Pose T_scanner_target;
  /// Covariance of the small motion to the true pose, `T_true = T_scanner_target * motion`: x, y, z (mm), rotation
  /// about X, Y, Z (rad), target frame (calib::TargetPose). nullopt: the value stated for all.
  std::optional<Mat6> target_covariance;
};

/// Standard deviations per axis, k = 1, from the data of robot and scanner. They weight the views, and the residuals
/// are compared with them.
struct StatedNoise {
  double robot_mm = 0.06;
  double robot_rad = rad_from_deg(0.0023);
  double target_mm = 0.01;  ///< centre of a ball, or origin of an artefact
  double target_rad = rad_from_deg(0.003);
};
/// Angle error for a stated position error of a robot: 0.0023 deg for 0.06 mm (an arm of 1.5 m), proportional for
/// others. Used if only the position error is known.
[[nodiscard]] double robot_rad_for(double robot_mm);

/// Text form of rotations. Forms and units are declared, never guessed from the numbers.
enum class RotationForm : std::uint8_t {
  quaternion_wxyz,  ///< x y z qw qx qy qz
  quaternion_xyzw,  ///< x y z qx qy qz qw
  kuka_abc,         ///< x y z A B C: R = Rz(A) Ry(B) Rx(C)
  none,             ///< x y z: ball centres
};
[[nodiscard]] std::string_view name(RotationForm form);

/// Declared format of a table of poses. Without a header line a text is in the neutral form, with these defaults.
/// A header line before the first pose declares another form:
///
///     # format: rotation=kuka_abc unit=mm angle=deg frames=T_base_flange
///
/// `rotation=` as in RotationForm, `unit=mm|m`, `angle=deg|rad` (only for kuka_abc, where
/// angle and unit are required). `frames=` is the transform in the lines: T_base_flange or T_flange_base,
/// T_scanner_target or T_target_scanner (inverse ones are inverted). `labels=view,ball` declares two integers before
/// every line of a target table: the line of the flange table, and the ball, both from 1.
struct PoseFormat {
  RotationForm rotation = RotationForm::quaternion_wxyz;
  bool metres = false;
  bool radians = false;
  bool inverse = false;  ///< the lines contain T_flange_base or T_target_scanner
  bool labelled = false;
  bool declared = false;  ///< a header line was present
};

/// A table of poses, converted to mm and rad and to the direction required by the solver.
struct PoseTable {
  PoseFormat format;
  std::vector<Pose> poses;
  std::vector<std::array<double, 7>> written;  ///< the numbers of each line as written, 0 if there are fewer
  std::vector<std::size_t> lines;              ///< line of each pose in the text, from 1
  std::vector<std::size_t> views;              ///< labelled: from 0; otherwise empty
  std::vector<std::size_t> balls;              ///< labelled: from 0; otherwise empty
};

enum class TableRole : std::uint8_t { flange, target };

/// Largest number of views. A larger set is a mistake (a whole log) and would be solved for minutes.
inline constexpr std::size_t kViewsMax = 400;
inline constexpr std::size_t kBallsMax = 16;

/// Reads a table; `origin` (a file name) is the prefix of errors, as in "flange.txt:12: ...". Code::config: an unknown
/// key or word in the header, or a number that is missing, surplus or not finite. Also a quaternion whose length is not
/// 1 within 1e-3, or a position beyond 100 m (a table in um). Also more than kViewsMax lines, or a table without poses.
[[nodiscard]] Result<PoseTable> parse_poses(std::string_view text, std::string_view origin, TableRole role);

/// Combines two tables into views, numbered by the lines of the flange table. Without labels the lines correspond, so
/// the lengths must be equal. With labels a flange pose without a sighting is skipped. Errors contain the `origin` of a
/// table. They are different lengths, a label outside the flange table, or a ball twice in a view. A ball centre
/// instead of a pose (`rotation=none` with kind pose) is an error too.
[[nodiscard]] Result<std::vector<View>> views_from(ArtefactKind kind, const PoseTable& flange,
                                                   std::string_view flange_origin, const PoseTable& target,
                                                   std::string_view target_origin);

/// Writes poses in the given form, with a header line unless it is the neutral form. Numbers in the neutral form have
/// enough digits to reproduce the same bits; labels as given (`views` and `balls` from 0, or empty).
[[nodiscard]] std::string write_poses(std::span<const Pose> poses, const PoseFormat& format, TableRole role,
                                      std::span<const std::size_t> views = {}, std::span<const std::size_t> balls = {});

/// Two flange poses closer than this are one place. A further view from there repeats the robot's error of the first
/// one and gives no new information about the scanner's pose.
inline constexpr double kSamePlace_mm = 1.0;
inline constexpr double kSamePlace_deg = 0.1;
[[nodiscard]] bool same_place(const Pose& a, const Pose& b);

}  // namespace slabd::calib
