// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
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

// The height of a casing's rim at the axis of its bore, from points of its ring that may be dark, tilted or partly
// under a crust.

/// A point of the ring: place from the bore's axis and height above the fitted seat, mm.
struct RimPoint {
  float x = 0.0F;
  float y = 0.0F;
  float height = 0.0F;
};

struct RimHeight {
  bool ok = false;            ///< the points are one plane, from most of the way round
  double height_mm = 0.0;     ///< of that plane at the axis
  double tilt = 0.0;          ///< its slope against the seat
  double std_mm = 0.0;        ///< of the points on it
  double sigma_mm = 0.0;      ///< standard uncertainty of the height: noise, form of the rim, what hides of it
  std::size_t points = 0;     ///< on it
  double share_on = 0.0;      ///< of the sectors seen, those that lie on it
  double share_below = 0.0;   ///< ... and below it: pieces missing
  double share_points = 0.0;  ///< of the points of those sectors, those that do
  double share_seen = 0.0;    ///< sectors of all that were seen
  double crust_mm = 0.0;  ///< the highest that three of four neighbouring sectors stand over the seat and this plane
};

/// Each of kRimHeightSectors sectors has one say, however many points it returned. The plane goes through those that
/// lie lowest together: what is on a rim makes it higher, and only a piece that is missing makes it lower.
inline constexpr std::size_t kRimHeightSectors = 32;

/// No heap, 0.2 ms for 6000 points.
[[nodiscard]] RimHeight rim_height(std::span<const RimPoint> points);

}  // namespace slabd::algo
