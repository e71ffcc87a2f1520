// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "calib/calib.h"

/// Hand-eye views with known truth. The scanner looks down on an artefact from a cone of directions, the artefact is
/// anywhere in its view, and the robot has errors. Its geometry is independent of the solver's code.
namespace slabd::calib::scene {

struct Plan {
  std::size_t views = 15;
  std::size_t balls = 1;  ///< for kind ball; neighbours 150 mm apart, all visible in every view
  double tilt_deg = 35.0;
  double roll_deg = 90.0;
  double fov_mm = 100.0;  ///< half width of the artefact's places in the view
  double depth_mm = 500.0;
  double depth_half_mm = 80.0;

  double robot_mm = 0.06;  ///< white, per axis; its rotation is proportional
  std::optional<double> robot_deg;
  double smooth_mm = 0.0;  ///< per axis, a field over the workspace with a length of 500 mm
  double target_mm = 0.01;
  double target_deg = 0.003;

  double outlier_share = 0.0;  ///< share of views with the artefact displaced by 2 to 30 mm
  double outlier_min_mm = 2.0;
  double outlier_max_mm = 30.0;

  bool one_orientation = false;
  bool one_axis = false;  ///< only roll

  [[nodiscard]] StatedNoise noise() const;
};

struct Set {
  std::vector<View> views;
  Pose T_flange_scanner;
  std::vector<Pose> targets;
  std::vector<std::size_t> outliers;  ///< ascending
};

[[nodiscard]] Set make(ArtefactKind kind, const Plan& plan, std::uint64_t seed);

/// rms over the 27 points of the field of view of the distance between their places by two calibrations.
[[nodiscard]] double point_error_mm(const Pose& a, const Pose& b, const FieldOfView& fov = {});

/// Best possible result: least squares with the true weights on the true inliers, started at the truth. An independent
/// implementation (numeric derivatives, the residual's rotation as a vector between poses in the base frame). `targets`
/// are started at the truth too.
[[nodiscard]] Pose reference(ArtefactKind kind, const Set& set, const StatedNoise& noise);

}  // namespace slabd::calib::scene
