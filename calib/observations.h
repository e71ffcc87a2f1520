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

/// What a calibration is computed from: where the robot said the flange was, and where the scanner saw the artefact.
/// And its written forms. Text in, values out: nothing here opens a file.
namespace slabd::calib {

enum class ArtefactKind : std::uint8_t {
  ball,  ///< one or more tooling balls fixed in the cell: `T_base_flange X c = p`
  pose,  ///< one artefact with a full pose, fixed in the cell: `T_base_flange X T_scanner_target = T_base_target`
};
[[nodiscard]] constexpr std::string_view name(ArtefactKind kind) {
  return kind == ArtefactKind::ball ? "ball" : "pose";
}

/// One ball as one view saw it.
struct BallSighting {
  std::size_t ball = 0;           ///< which ball of the cell, from 0
  Vec3 centre_mm = Vec3::Zero();  ///< scanner frame
  /// Random part, scanner axes, k = 1. Empty = what the caller states for all.
  std::optional<Mat3> cov_mm2;
};

/// What was seen while the robot stood still once. A `ball` view has at least one sighting (several balls of one view
/// share its robot error); a `pose` view has T_scanner_target.
struct View {
  std::size_t number = 0;  ///< what people call it, from 1; 0 = by its place in the set
  Pose T_base_flange;      ///< as the robot reported it
  /// A, B, C as reported, before anything wrapped them; for the convention test, which reads them in other ways.
  std::optional<std::array<double, 3>> reported_abc_rad;
  std::vector<BallSighting> balls;
  Pose T_scanner_target;
  /// Of the small motion that takes it to the true one, `T_true = T_scanner_target * motion`: x, y, z (mm), rotation
  /// about X, Y, Z (rad), target frame (calib::TargetPose). Empty = what the caller states for all.
  std::optional<Mat6> target_covariance;
};

/// Standard deviations per axis, k = 1, as the robot's and the scanner's data say. They weigh the views and are what
/// the residuals are held against.
struct StatedNoise {
  double robot_mm = 0.06;
  double robot_rad = rad_from_deg(0.0023);
  double target_mm = 0.01;  ///< a ball's centre, an artefact's origin
  double target_rad = rad_from_deg(0.003);
};
/// The stated position error of a robot as an angle: 0.06 mm go with 0.0023 deg (an arm of 1.5 m), others in
/// proportion. For callers who know only the position error.
[[nodiscard]] double robot_rad_for(double robot_mm);

/// How rotations and units are written. Everything is declared, nothing is guessed from the numbers.
enum class RotationForm : std::uint8_t {
  quaternion_wxyz,  ///< x y z qw qx qy qz
  quaternion_xyzw,  ///< x y z qx qy qz qw
  kuka_abc,         ///< x y z A B C: R = Rz(A) Ry(B) Rx(C)
  none,             ///< x y z: ball centres
};
[[nodiscard]] std::string_view name(RotationForm form);

/// The declaration of a table of poses. Without a header line a text is in the neutral form, these defaults. Else
///
///     # format: rotation=kuka_abc unit=mm angle=deg frames=T_base_flange
///
/// before the first pose. `rotation=` as in RotationForm, `unit=mm|m`, `angle=deg|rad` (kuka_abc alone, and then it
/// must be said, as the unit must), `frames=` the transform that the lines hold: T_base_flange or T_flange_base,
/// T_scanner_target or T_target_scanner (inverse ones are inverted), `labels=view,ball`: two whole numbers in front of
/// every line of a target table, the line of the flange table it belongs to and the ball that was seen, both from 1.
struct PoseFormat {
  RotationForm rotation = RotationForm::quaternion_wxyz;
  bool metres = false;
  bool radians = false;
  bool inverse = false;  ///< the lines hold T_flange_base or T_target_scanner
  bool labelled = false;
  bool declared = false;  ///< a header line was there
};

/// A table of poses as it was written, converted to mm and rad and to the direction the solver wants.
struct PoseTable {
  PoseFormat format;
  std::vector<Pose> poses;
  std::vector<std::array<double, 7>>
      written;                     ///< the numbers of each line as they stand there, 0 where there are fewer
  std::vector<std::size_t> lines;  ///< line of each pose in the text, from 1
  std::vector<std::size_t> views;  ///< labelled: from 0, else empty
  std::vector<std::size_t> balls;  ///< labelled: from 0, else empty
};

enum class TableRole : std::uint8_t { flange, target };

/// At most this many views: a set larger than that is a mistake (a whole log), and it would be solved for minutes.
inline constexpr std::size_t kViewsMax = 400;
inline constexpr std::size_t kBallsMax = 16;

/// Reads a table; `origin` (a file name) stands in front of errors, as in "flange.txt:12: ...". Refused (Code::config):
/// an unknown key or word of the header, a number that is missing, surplus or not finite, a quaternion whose length is
/// not 1 within 1e-3, a position beyond 100 m (a table in um), more than kViewsMax lines, no pose at all.
[[nodiscard]] Result<PoseTable> parse_poses(std::string_view text, std::string_view origin, TableRole role);

/// The views of two tables, numbered by the lines of the flange table. Not labelled: line by line, so they must have
/// the same length; labelled: a flange pose without a sighting is no view. `origin` of both for the errors: a count
/// that differs, a label outside the flange table, a ball twice in a view, a ball centre where a pose is needed
/// (`rotation=none` with kind pose).
[[nodiscard]] Result<std::vector<View>> views_from(ArtefactKind kind, const PoseTable& flange,
                                                   std::string_view flange_origin, const PoseTable& target,
                                                   std::string_view target_origin);

/// The other way: every pose in the given form, its header line first unless it is the neutral form. Numbers have as
/// many digits as bring back the same bits (neutral form), labels as given (`views` and `balls` from 0, or empty).
[[nodiscard]] std::string write_poses(std::span<const Pose> poses, const PoseFormat& format, TableRole role,
                                      std::span<const std::size_t> views = {}, std::span<const std::size_t> balls = {});

/// Two flange poses nearer than this are one place: a view from there again repeats the first one's error of the robot
/// and says nothing new about where the scanner sits.
inline constexpr double kSamePlaceMm = 1.0;
inline constexpr double kSamePlaceDeg = 0.1;
[[nodiscard]] bool same_place(const Pose& a, const Pose& b);

}  // namespace slabd::calib
