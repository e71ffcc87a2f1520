// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include "calib/calib.h"

/// A calibration driven view by view in a cell with known truth. The operator follows the suggestions, or tilts and
/// turns by the usual advice.
namespace slabd::calib::driven {

struct Cell {
  Pose T_flange_scanner{Quat(0.9961947, 0.0, 0.0871557, 0.0).normalized(), Vec3(40.0, -25.0, 180.0)};
  Pose T_base_target{Quat::Identity(), Vec3(1500.0, 200.0, 600.0)};
  StatedNoise noise;
  CoverageSettings settings;
  double picture_half_mm = 150.0;  ///< beyond it the target is cut off and the view is rejected
};

inline double within(Prng& random, double amplitude) {
  return amplitude * (2.0 * random.uniform() - 1.0);
}
inline Vec3 normal3(Prng& random, double sigma) {
  return Vec3(random.normal(), random.normal(), random.normal()) * sigma;
}
inline Quat small_turn(const Vec3& v) {
  return Quat(
      Eigen::AngleAxisd(v.norm(), Eigen::Vector3d(v.norm() > 0.0 ? Vec3(v.normalized()) : Vec3(Vec3::UnitX()))));
}

/// A start with an error of `off_mm` and `off_deg` in a direction determined by the seed.
inline Pose bad_start(const Cell& cell, double off_mm, double off_deg, std::uint64_t seed) {
  Prng random(seed * 977 + 5);
  Pose start = cell.T_flange_scanner;
  start.translation_mm += normal3(random, 1.0).normalized() * off_mm;
  start.rotation = start.rotation * small_turn(normal3(random, 1.0).normalized() * rad_from_deg(off_deg));
  return start;
}

/// Adds the view of the scanner with the robot at `T_base_flange`; false if the target is not complete in the picture.
inline bool take(const Cell& cell, ArtefactKind kind, const Pose& T_base_flange, Prng& random,
                 std::vector<View>& views) {
  View view;
  view.number = views.size() + 1;
  view.T_base_flange = T_base_flange;
  Pose real = T_base_flange;
  real.translation_mm += normal3(random, cell.noise.robot_mm);
  real.rotation = (real.rotation * small_turn(normal3(random, cell.noise.robot_rad))).normalized();
  Pose seen = (real * cell.T_flange_scanner).inverse() * cell.T_base_target;
  if (std::abs(seen.translation_mm.x()) > cell.picture_half_mm ||
      std::abs(seen.translation_mm.y()) > cell.picture_half_mm ||
      seen.translation_mm.z() < cell.settings.fov.near_mm - 60.0 ||
      seen.translation_mm.z() > cell.settings.fov.far_mm + 60.0)
    return false;
  seen.translation_mm += normal3(random, cell.noise.target_mm);
  if (kind == ArtefactKind::pose) {
    seen.rotation = (seen.rotation * small_turn(normal3(random, cell.noise.target_rad))).normalized();
    view.T_scanner_target = seen;
  } else {
    view.balls.push_back({0, seen.translation_mm, std::nullopt});
  }
  views.push_back(view);
  return true;
}

/// Pose with the target in the middle of the view, seen from straight above: the beginning of every calibration.
inline Pose first_pose(const Cell& cell) {
  const Quat down(Eigen::AngleAxisd(kPi, Eigen::Vector3d::UnitX()));
  const double depth_mm = 0.5 * (cell.settings.fov.near_mm + cell.settings.fov.far_mm);
  const Pose T_base_scanner{down, cell.T_base_target.translation_mm - down * Vec3(10.0, -15.0, depth_mm)};
  return T_base_scanner * cell.T_flange_scanner.inverse();
}

struct Driven {
  std::vector<View> views;
  int missed = 0;  ///< suggestions for which the target was not in the picture
};

/// Follows every suggestion with an operator's accuracy: 5 mm and 1 degree.
inline Driven follow(const Cell& cell, ArtefactKind kind, std::size_t count, const Pose& start, std::uint64_t seed) {
  Prng random(seed * 131 + 7);
  Driven driven;
  if (!take(cell, kind, first_pose(cell), random, driven.views)) return driven;
  while (driven.views.size() < count && driven.missed < 20) {
    const Guide guide = guide_next(kind, driven.views, cell.noise, cell.settings, &start);
    if (!guide.next) return driven;
    Pose pose = guide.next->T_base_flange;
    pose.translation_mm += Vec3(within(random, 5.0), within(random, 5.0), within(random, 5.0));
    pose.rotation = (pose.rotation * small_turn(normal3(random, rad_from_deg(0.5)))).normalized();
    driven.missed += take(cell, kind, pose, random, driven.views) ? 0 : 1;
  }
  return driven;
}

/// Follows the usual advice: random tilts of 20 to 35 degrees to all sides, and rolls of +-90. The target is in corners
/// and middle, near, mid and far.
inline Driven advice(const Cell& cell, ArtefactKind kind, std::size_t count, std::uint64_t seed) {
  Prng random(seed * 313 + 11);
  Driven driven;
  const FieldOfView& fov = cell.settings.fov;
  while (driven.views.size() < count && driven.missed < 100) {
    const double tilt = rad_from_deg(20.0 + 15.0 * random.uniform());
    const double azimuth = 2.0 * kPi * random.uniform();
    const double roll = rad_from_deg(within(random, 90.0));
    const std::size_t place = driven.views.size() % 5;
    const double x = place == 0 ? 0.0 : (place & 1U) != 0 ? 0.92 : -0.92;
    const double y = place == 0 ? 0.0 : (place & 2U) != 0 ? 0.92 : -0.92;
    const double half = std::max(0.0, 1.0 - cell.settings.target_radius_mm / fov.half_x_mm);
    const double depth =
        fov.near_mm + (fov.far_mm - fov.near_mm) * (0.08 + 0.42 * static_cast<double>(driven.views.size() % 3));
    const Quat rotation = Quat(Eigen::AngleAxisd(tilt, Eigen::Vector3d(std::cos(azimuth), std::sin(azimuth), 0.0))) *
                          Quat(Eigen::AngleAxisd(kPi, Eigen::Vector3d::UnitX())) *
                          Quat(Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitZ()));
    const Vec3 seen(x * half * fov.half_x_mm, y * half * fov.half_y_mm, depth);
    const Pose T_base_scanner{rotation, cell.T_base_target.translation_mm - rotation * seen};
    driven.missed += take(cell, kind, T_base_scanner * cell.T_flange_scanner.inverse(), random, driven.views) ? 0 : 1;
  }
  return driven;
}

/// Predicted point error of the views at the true calibration.
inline double worth_mm(const Cell& cell, ArtefactKind kind, const std::vector<View>& views) {
  const std::vector<Pose> targets = {cell.T_base_target};
  return predict(kind, views, cell.T_flange_scanner, targets, cell.noise, cell.settings.fov).point_sigma_mm;
}

}  // namespace slabd::calib::driven
