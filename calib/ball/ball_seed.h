// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/base.h"

namespace slabd::calib {

/// A place that much of a spherical surface points to.
struct BallCandidate {
  Vec3 centre_mm = Vec3::Zero();  ///< to about a hundredth of the radius
  double votes = 0.0;             ///< patches of surface, each an eighth of a radius wide
};

/// Centres of spheres of about `radius_mm` in a scan (3 floats a point, mm, NaN = missing), most votes first, at most
/// `count_max` of them. A few per cent more or less of radius are found as well; cylinders and edges may come along.
/// O(points) with at most 80 MB of working memory, whatever the scan.
[[nodiscard]] std::vector<BallCandidate> ball_candidates(std::span<const float> xyz, double radius_mm,
                                                         const Vec3& viewpoint_mm, std::size_t count_max);

}  // namespace slabd::calib
