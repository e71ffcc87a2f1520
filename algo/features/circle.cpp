// SPDX-License-Identifier: Apache-2.0
//
// Geometric circle fit: minimise the squared distances to the circle. The three unknowns enter almost linearly once
// the centre is known to a fraction of the radius, so Gauss-Newton needs a handful of steps; the algebraic fits that
// need no start are biased when only part of the circle is seen.
#include "algo/features/circle.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>

#include "algo/median.h"

namespace slabd::algo {
namespace {

constexpr int kSteps = 60;
constexpr std::size_t kPointsMax = 512;

double tukey(double r, double c) {
  const double u = r / c;
  if (!(std::abs(u) < 1.0)) return 0.0;
  return (1.0 - u * u) * (1.0 - u * u);
}

double mean_radius(std::span<const Vec2> points, const Vec2& centre) {
  double sum = 0.0;
  for (const Vec2& p : points) sum += (p - centre).norm();
  return sum / static_cast<double>(points.size());
}

double median_radius(std::span<const Vec2> points, const Vec2& centre) {
  std::array<double, kPointsMax> r;
  for (std::size_t i = 0; i < points.size(); ++i) r[i] = (points[i] - centre).norm();
  return median_of(std::span(r).first(points.size()));
}

/// Median distance to the circle as a standard deviation.
double scale_of(std::span<const Vec2> points, const Circle& circle) {
  std::array<double, kPointsMax> r;
  for (std::size_t i = 0; i < points.size(); ++i) r[i] = std::abs((points[i] - circle.centre).norm() - circle.radius);
  return 1.4826 * median_of(std::span(r).first(points.size()));
}

/// A point seen from the circle: unit vector from the centre, distance to the circle, and how much it counts. False at
/// the centre itself, which has no direction.
struct Sight {
  double x;
  double y;
  double off;
  double agreement;  ///< Tukey weight
  double weight;     ///< ... and side
};
bool look(const Vec2& p, double cut, double outside_weight, const Circle& circle, Sight& sight) {
  const double x = p.x() - circle.centre.x();
  const double y = p.y() - circle.centre.y();
  const double r = std::sqrt(x * x + y * y);
  if (!(r > 0.0)) return false;
  sight.x = x / r;
  sight.y = y / r;
  sight.off = r - circle.radius;
  sight.agreement = cut > 0.0 ? tukey(sight.off, cut) : 1.0;
  sight.weight = sight.off > 0.0 ? outside_weight * sight.agreement : sight.agreement;
  return true;
}

/// Normal equations of one weighted Gauss-Newton step: H = sum w j j^T, g = sum w e j with j = -(x, y, 1).
struct Normal {
  Eigen::Matrix3d H = Eigen::Matrix3d::Zero();
  Eigen::Vector3d g = Eigen::Vector3d::Zero();
  double weight = 0.0;
  double weighted_squares = 0.0;
  double agreeing = 0.0;
};

Normal normal_at(std::span<const Vec2> points, double cut, double outside_weight, const Circle& circle) {
  double xx = 0.0, xy = 0.0, yy = 0.0, x = 0.0, y = 0.0, ex = 0.0, ey = 0.0, e = 0.0;
  Normal sum;
  for (const Vec2& p : points) {
    Sight s;
    if (!look(p, cut, outside_weight, circle, s)) continue;
    const double wx = s.weight * s.x;
    const double wy = s.weight * s.y;
    xx += wx * s.x;
    xy += wx * s.y;
    yy += wy * s.y;
    x += wx;
    y += wy;
    ex += wx * s.off;
    ey += wy * s.off;
    e += s.weight * s.off;
    sum.weight += s.weight;
    sum.weighted_squares += s.weight * s.off * s.off;
    sum.agreeing += s.agreement;
  }
  sum.H << xx, xy, x, xy, yy, y, x, y, sum.weight;
  sum.g << -ex, -ey, -e;
  return sum;
}

/// One step. Returns its length, negative when the points do not fix a circle.
double step(std::span<const Vec2> points, double cut, double outside_weight, Circle& circle) {
  const Normal sum = normal_at(points, cut, outside_weight, circle);
  circle.weight = sum.agreeing;
  if (!(sum.agreeing >= 3.0)) return -1.0;
  circle.rms = std::sqrt(sum.weighted_squares / sum.weight);
  // A short arc fixes neither centre nor radius; relative to the weights the determinant then vanishes.
  const Eigen::Matrix3d unit = sum.H / sum.weight;
  if (!(unit.determinant() > 1e-9)) return -1.0;
  const Eigen::Vector3d delta = -unit.ldlt().solve(Eigen::Vector3d(sum.g / sum.weight));
  if (!delta.allFinite()) return -1.0;
  circle.centre += Vec2(delta[0], delta[1]);
  circle.radius += delta[2];
  return delta.norm();
}

/// What the finished fit knows about itself.
void state_quality(std::span<const Vec2> points, double cut, double outside_weight, Circle& circle) {
  const Normal sum = normal_at(points, cut, outside_weight, circle);
  Eigen::Matrix3d psi = Eigen::Matrix3d::Zero();  // sum of squared weighted distances
  Eigen::Matrix2d around = Eigen::Matrix2d::Zero();
  Eigen::Vector2d aside = Eigen::Vector2d::Zero();
  double squares = 0.0;
  for (const Vec2& p : points) {
    Sight s;
    if (!look(p, cut, outside_weight, circle, s)) continue;
    const Eigen::Vector2d u(s.x, s.y);
    const Eigen::Vector3d j(-s.x, -s.y, -1.0);
    psi += s.weight * s.weight * s.off * s.off * j * j.transpose();
    around += s.agreement * u * u.transpose();
    aside += s.agreement * u;
    squares += s.agreement * s.off * s.off;
  }
  circle.scatter = std::sqrt(squares / sum.agreeing);
  // Smallest variance of the unit vectors towards the points, over all directions.
  const Eigen::Matrix2d v = around / sum.agreeing - (aside / sum.agreeing) * (aside / sum.agreeing).transpose();
  const double half_trace = 0.5 * (v(0, 0) + v(1, 1));
  circle.spread = half_trace - std::hypot(0.5 * (v(0, 0) - v(1, 1)), v(0, 1));
  if (!(sum.agreeing > 3.0)) return;
  const Eigen::Matrix3d inverse = sum.H.inverse();
  circle.covariance = inverse * psi * inverse * (sum.agreeing / (sum.agreeing - 3.0));
}

}  // namespace

Circle fit_circle(std::span<const Vec2> points, const Vec2& start) {
  Circle circle;
  circle.centre = start;
  if (points.size() < 3) return circle;
  circle.radius = mean_radius(points, start);
  for (int i = 0; i < kSteps; ++i) {
    const double moved = step(points, 0.0, 1.0, circle);
    if (moved < 0.0) return circle;
    if (moved <= 1e-12 * (circle.radius + circle.centre.norm())) {
      circle.ok = circle.radius > 0.0;
      state_quality(points, 0.0, 1.0, circle);
      return circle;
    }
  }
  return circle;
}

Circle fit_circle_robust(std::span<const Vec2> points, const Vec2& start, const CircleWeights& weights) {
  Circle circle;
  circle.centre = start;
  if (points.size() < 3 || points.size() > kPointsMax) return circle;
  circle.radius = median_radius(points, start);
  double cut = 0.0;
  for (int i = 0; i < kSteps; ++i) {
    // The scale follows the fit for some steps and then stands, so that the steps can come to rest.
    const double old_cut = cut;
    if (i < 20) cut = 4.685 * std::max(scale_of(points, circle), weights.scale_min);
    const double moved = step(points, cut, weights.outside_weight, circle);
    if (moved < 0.0) return circle;
    // A step that leads nowhere with a scale that stood before it repeats itself for ever.
    const bool at_rest = i >= 20 ? moved <= 1e-9 : moved <= 1e-12 && cut == old_cut;
    if (at_rest) {
      circle.ok = circle.radius > 0.0;
      state_quality(points, cut, weights.outside_weight, circle);
      return circle;
    }
  }
  return circle;
}

}  // namespace slabd::algo
