// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "calib/calib.h"

namespace slabd::args {
class Command;
}  // namespace slabd::args

/// What a solver is told beside the views: noise, field of view, limit. Shared by `solve`, from tables, and by `new`,
/// for a whole session.
namespace slabd::cli {

struct SolveOptions {
  double robot_sigma_mm = calib::StatedNoise{}.robot_mm;
  double robot_sigma_deg = kNoValue;
  double target_sigma_mm = calib::StatedNoise{}.target_mm;
  double target_sigma_deg = kNoValue;
  double limit_mm = kNoValue;
  std::vector<double> fov;

  void add_to(args::Command& command);
  /// Who states nothing but a position noise for the robot gets rotations in proportion: a robot of 0.7 mm with the
  /// angles of one of 0.06 mm would weigh them a hundred times too much. Targets are not taken to be better for it.
  [[nodiscard]] calib::StatedNoise noise() const;
  [[nodiscard]] calib::SolveSettings settings() const;
  /// What is wrong with --fov; empty: nothing.
  [[nodiscard]] std::string fov_fault() const;
};

}  // namespace slabd::cli
