// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>

#include "base/base.h"

namespace slabd::algo {

using Vec2 = Eigen::Matrix<double, 2, 1, Eigen::DontAlign>;

struct Circle {
  bool ok = false;
  Vec2 centre = Vec2::Zero();
  double radius = kNoValue;
  double rms = kNoValue;      ///< weighted, of the distances to the circle
  double weight = 0.0;        ///< sum of Tukey weights: about the number of points that agree
  double scatter = kNoValue;  ///< root mean square distance to the circle of the points that agree
  double spread = 0.0;        ///< how well they surround it: 0.5 all round, 0.095 half of it, 0 at one place
  /// Of centre and radius, from the points' own scatter about the circle, taken as independent:
  /// H^-1 (sum psi^2 j j^T) H^-1 n / (n - 3), psi the weighted distance and H = sum w j j^T (sandwich of an
  /// M-estimator; it needs no distribution, which for points that lie on one side of an edge is not normal).
  Mat3 covariance = Mat3::Constant(kNoValue);
};

/// Circle through `points` by geometric least squares (Gauss-Newton from `start`), every point with full weight.
/// ok = false: fewer than three points, or they do not determine a circle.
[[nodiscard]] Circle fit_circle(std::span<const Vec2> points, const Vec2& start);

/// How `fit_circle_robust` weighs.
struct CircleWeights {
  double scale_min = 0.0;       ///< the scale comes from the median distance and is never below this
  double outside_weight = 1.0;  ///< factor for points outside the circle; below 1 the circle leans on its inner points
};

/// The same with Tukey weights: points that lie off the common circle lose their say. Up to 512 points.
[[nodiscard]] Circle fit_circle_robust(std::span<const Vec2> points, const Vec2& start, const CircleWeights& weights);

}  // namespace slabd::algo
