// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "algo/algo.h"

/// A block that can be built with deliberate errors, and a scanner: scans with known truth. Shares nothing with the
/// tested room except the recipe's nominals: rays are intersected with half spaces, joined like the faces of the block.
namespace slabd::scene {

/// The P5600 recipe's nominals and tolerances, as numbers.
[[nodiscard]] Recipe p5600();

/// One block as built. Lengths mm, angles rad unless named otherwise.
struct Block {
  double cant_ratio = 40.0;
  double jaw_distance_mm = 380.0;
  double jaw_angle_inner_deg = 110.0;
  double jaw_angle_outer_deg = 110.0;
  double casing_spacing_mm = 233.0;
  double rim_inner_mm = -0.25;
  double rim_outer_mm = -0.25;
  double end_half_mm = 105.0;
  double wave_mm = 0.0;  ///< amplitude of a wave along s, period 75 mm: level on average
  double bump_mm = 0.0;  ///< height of a round flat bump on the seat ...
  double bump_radius_mm = 8.0;
  double bump_x_mm = 20.0;  ///< ... and its position
  double bump_s_mm = -30.0;
  std::function<double(double x_mm, double s_mm)> relief_mm;  ///< height of any other relief on the seat
  bool present = true;                                        ///< false: bare slab
  bool slab_top_seen = true;                                  ///< false: no returns from it
};

struct Scan {
  double pitch_mm = 0.4;
  double pitch_ratio = 1.0;  ///< pitch along y over pitch along x
  /// Perspective: rays start at one point and `pitch_mm` is valid at this distance. 0: rays along Z.
  double focus_mm = 0.0;
  double noise_mm = 0.03;
  double outlier_share = 0.005;
  double outlier_near_mm = 1.0;  ///< outliers are between this far ...
  double outlier_far_mm = 60.0;  ///< ... and this far off along the ray
  int outlier_clump = 1;         ///< largest number in a row of the grid, at one depth
  double tail_share = 0.0;       ///< of points with five times the noise
  double missing_share = 0.02;
  double field_x_mm = 350.0;
  double field_y_mm = 500.0;
  bool incidence = false;  ///< the cloud has its points' angles
  bool organised = false;  ///< missing points as NaN in a width x height grid
  std::uint64_t seed = 1;
  /// Actual position of the block relative to the nominal one: T_nominal_true.
  Pose displacement;
};

struct Cloud {
  std::vector<float> xyz;
  std::size_t width = 0;
  std::size_t height = 0;
  std::vector<bool> outlier;         ///< of each point
  std::vector<float> incidence_deg;  ///< for each point, if requested: angle between the ray and its face's normal
  Pose T_block_scanner;              ///< truth

  [[nodiscard]] algo::Cloud view() { return {xyz, xyz.size() / 3, width, height}; }
};

[[nodiscard]] Cloud take(const Block& block, const Scan& scan);

/// Small displacement: translation (mm) and rotation vector (deg).
[[nodiscard]] Pose displaced(double x, double y, double z, double rx_deg, double ry_deg, double rz_deg);

}  // namespace slabd::scene
