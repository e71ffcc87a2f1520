// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "base/base.h"

/// Scans of balls for tests of ball finding. Rays from the origin over a grid meet the nearest of spheres, upright
/// cylinders and planes, with noise along the ray. Simple and slow, so that it can be verified by reading.
namespace slabd::calib {

struct SceneBall {
  Vec3 centre_mm;
  double radius_mm;
};
struct ScenePost {  ///< a cylinder around an axis; scanner frame
  Vec3 from_mm;
  Vec3 to_mm;
  double radius_mm;
};
struct ScenePlane {  ///< n.p = d
  Vec3 normal;
  double offset_mm;
};

struct BallScene {
  std::vector<SceneBall> balls;
  std::vector<ScenePost> posts;
  std::vector<ScenePlane> planes;
  double pitch_mm = 0.3;  ///< distance of the rays at `distance_mm`
  double distance_mm = 500.0;
  double half_width_mm = 100.0;  ///< half width of the picture there
  bool parallel = false;
  double noise_mm = 0.05;       ///< along the ray
  double correlation_mm = 0.0;  ///< correlation length of the noise (Gaussian) at `distance_mm`; 0: white
  double flyer_share = 0.0;     ///< share of the pixels next to an edge
  double missing_share = 0.0;
  /// Picture x beyond which a plate hides everything
  double hidden_beyond_x_mm = std::numeric_limits<double>::infinity();
  std::uint64_t seed = 1;
};

/// Draws the scene: 3 floats per point, NaN for missing ones; row by row.
[[nodiscard]] std::vector<float> draw(const BallScene& scene);

}  // namespace slabd::calib
