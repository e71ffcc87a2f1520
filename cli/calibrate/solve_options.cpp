// SPDX-License-Identifier: Apache-2.0
#include "cli/calibrate/solve_options.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"

#include <algorithm>

namespace slabd::cli {

calib::StatedNoise SolveOptions::noise() const {
  const bool rotation_stated = has_value(robot_sigma_deg);
  calib::StatedNoise noise;
  noise.robot_mm = robot_sigma_mm;
  noise.robot_rad = rotation_stated ? rad_from_deg(robot_sigma_deg) : calib::robot_rad_for(robot_sigma_mm);
  noise.target_mm = target_sigma_mm;
  if (has_value(target_sigma_deg))
    noise.target_rad = rad_from_deg(target_sigma_deg);
  else if (!rotation_stated)
    noise.target_rad *= std::max(1.0, robot_sigma_mm / calib::StatedNoise{}.robot_mm);
  return noise;
}

calib::SolveSettings SolveOptions::settings() const {
  calib::SolveSettings settings;
  if (fov.size() == 4) settings.fov = {fov[0], fov[1], fov[2], fov[3]};
  settings.point_sigma_mm_max = limit_mm;
  return settings;
}

std::string SolveOptions::fov_fault() const {
  const calib::FieldOfView view = settings().fov;
  if (view.near_mm < view.far_mm && view.half_x_mm > 0.0 && view.half_y_mm > 0.0) return "";
  return "--fov: half width, half height, nearest, furthest in mm; nearest must be less than furthest, and the halves "
         "above 0";
}

void SolveOptions::add_to(args::Command& command) {
  command.add_option("--robot-sigma-mm", robot_sigma_mm, "Robot's position noise per axis")
      ->check(at_least(0.0))
      ->capture_default_str();
  command
      .add_option("--robot-sigma-deg", robot_sigma_deg,
                  "Robot's rotation noise per axis; default 0.0023 per 0.06 mm of its position noise")
      ->check(at_least(0.0));
  command.add_option("--target-sigma-mm", target_sigma_mm, "Noise of a ball's centre or the artefact's origin")
      ->check(at_least(0.0))
      ->capture_default_str();
  command
      .add_option("--target-sigma-deg", target_sigma_deg,
                  "Noise of the artefact's rotation; default 0.003, or if no rotation noise is stated and the robot's "
                  "position noise is above 0.06 mm, in proportion to it")
      ->check(at_least(0.0));
  command
      .add_option("--limit-mm", limit_mm,
                  "Refuse when the predicted point error (1 sigma) is above; default 6 times the stated position noise")
      ->check(at_least(0.0));
  command
      .add_option(
          "--fov", fov,
          "Where the error is predicted: half width, half height, nearest, furthest (mm); default 100 100 420 580")
      ->expected(4)
      ->check(at_least(0.0));
}

}  // namespace slabd::cli
