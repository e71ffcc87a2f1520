// SPDX-License-Identifier: Apache-2.0
//
// The circle fit with all of its steps; the method is described in algo/features/casing_fits.cpp.
#include "plain_features.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>

namespace slabd::algo::plain {
namespace {

constexpr int kSteps = 60;
constexpr std::size_t kPointsMax = 512;

double tukey(double r, double c) {
  const double u = r / c;
  if (!(std::abs(u) < 1.0)) return 0.0;
  return (1.0 - u * u) * (1.0 - u * u);
}

double median_radius(std::span<const Vec2> points, const Vec2& centre) {
  std::array<double, kPointsMax> r;
  for (std::size_t i = 0; i < points.size(); ++i) r[i] = (points[i] - centre).norm();
  const auto middle = r.begin() + static_cast<std::ptrdiff_t>(points.size() / 2);
  std::nth_element(r.begin(), middle, r.begin() + static_cast<std::ptrdiff_t>(points.size()));
  return *middle;
}

/// Standard deviation estimated from the median distance to the circle.
double scale_of(std::span<const Vec2> points, const Circle& circle) {
  std::array<double, kPointsMax> r;
  for (std::size_t i = 0; i < points.size(); ++i) r[i] = std::abs((points[i] - circle.centre).norm() - circle.radius);
  const auto middle = r.begin() + static_cast<std::ptrdiff_t>(points.size() / 2);
  std::nth_element(r.begin(), middle, r.begin() + static_cast<std::ptrdiff_t>(points.size()));
  return 1.4826 * *middle;
}

/// Normal equations of one weighted Gauss-Newton step, and related sums.
struct Normal {
  Eigen::Matrix3d H = Eigen::Matrix3d::Zero();
  Eigen::Vector3d g = Eigen::Vector3d::Zero();
  Eigen::Matrix3d psi = Eigen::Matrix3d::Zero();  ///< sum of squared weighted distances
  Eigen::Matrix2d around = Eigen::Matrix2d::Zero();
  Eigen::Vector2d aside = Eigen::Vector2d::Zero();
  double weight = 0.0;
  double weighted_squares = 0.0;
  double agreeing = 0.0;
  double squares = 0.0;
};

Normal normal_at(std::span<const Vec2> points, double cut, double outside_weight, const Circle& circle) {
  Normal sum;
  for (const Vec2& p : points) {
    const Vec2 out = p - circle.centre;
    const double r = out.norm();
    if (!(r > 0.0)) continue;
    const double e = r - circle.radius;
    const double agreement = cut > 0.0 ? tukey(e, cut) : 1.0;
    const double w = e > 0.0 ? outside_weight * agreement : agreement;
    const Eigen::Vector2d u(out.x() / r, out.y() / r);
    const Eigen::Vector3d j(-u.x(), -u.y(), -1.0);
    sum.H += w * j * j.transpose();
    sum.g += w * e * j;
    sum.psi += w * w * e * e * j * j.transpose();
    sum.around += agreement * u * u.transpose();
    sum.aside += agreement * u;
    sum.weight += w;
    sum.weighted_squares += w * e * e;
    sum.agreeing += agreement;
    sum.squares += agreement * e * e;
  }
  return sum;
}

/// Makes one step. Returns its length, negative if the points do not determine a circle.
double step(std::span<const Vec2> points, double cut, double outside_weight, Circle& circle) {
  const Normal sum = normal_at(points, cut, outside_weight, circle);
  circle.weight = sum.agreeing;
  if (!(sum.agreeing >= 3.0)) return -1.0;
  circle.rms = std::sqrt(sum.weighted_squares / sum.weight);
  // A short arc determines neither centre nor radius; relative to the weights the determinant is then nearly zero.
  const Eigen::Matrix3d unit = sum.H / sum.weight;
  if (!(unit.determinant() > 1e-9)) return -1.0;
  const Eigen::Vector3d delta = -unit.ldlt().solve(Eigen::Vector3d(sum.g / sum.weight));
  if (!delta.allFinite()) return -1.0;
  circle.centre += Vec2(delta[0], delta[1]);
  circle.radius += delta[2];
  return delta.norm();
}

/// Computes the quality figures of the finished fit.
void state_quality(std::span<const Vec2> points, double cut, double outside_weight, Circle& circle) {
  const Normal sum = normal_at(points, cut, outside_weight, circle);
  circle.scatter = std::sqrt(sum.squares / sum.agreeing);
  // Smallest variance of the unit vectors towards the points, over all directions.
  const Eigen::Matrix2d v =
      sum.around / sum.agreeing - (sum.aside / sum.agreeing) * (sum.aside / sum.agreeing).transpose();
  const double half_trace = 0.5 * (v(0, 0) + v(1, 1));
  circle.spread = half_trace - std::hypot(0.5 * (v(0, 0) - v(1, 1)), v(0, 1));
  if (!(sum.agreeing > 3.0)) return;
  const Eigen::Matrix3d inverse = sum.H.inverse();
  circle.covariance = inverse * sum.psi * inverse * (sum.agreeing / (sum.agreeing - 3.0));
}

}  // namespace

Circle fit_circle_robust(std::span<const Vec2> points, const Vec2& start, const CircleWeights& weights) {
  Circle circle;
  circle.centre = start;
  if (points.size() < 3 || points.size() > kPointsMax) return circle;
  circle.radius = median_radius(points, start);
  double cut = 0.0;
  for (int i = 0; i < kSteps; ++i) {
    // The scale follows the fit for some steps and is then fixed, so that the steps converge.
    if (i < 20) cut = 4.685 * std::max(scale_of(points, circle), weights.scale_min);
    const double moved = step(points, cut, weights.outside_weight, circle);
    if (moved < 0.0) return circle;
    if (i >= 20 && moved <= 1e-9) {
      circle.ok = circle.radius > 0.0;
      state_quality(points, cut, weights.outside_weight, circle);
      return circle;
    }
  }
  return circle;
}

}  // namespace slabd::algo::plain
