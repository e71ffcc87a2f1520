// SPDX-License-Identifier: Apache-2.0
#include "algo/features/plane_lsq.h"

#include <Eigen/Eigenvalues>
#include <numbers>

namespace slabd::algo {
namespace {

/// Below this ratio of the middle to the largest eigenvalue the points lie on a line.
constexpr double kLineRatio = 1e-14;

/// Variance of a standard normal variable cut off beyond +-c.
double cut_variance(double c) {
  const double density = std::exp(-0.5 * c * c) / std::sqrt(2.0 * std::numbers::pi);
  return 1.0 - 2.0 * c * density / std::erf(c / std::numbers::sqrt2);
}

/// The same for what was cut at `threshold` and has standard deviation `std` now. A cut below two noise widths cannot
/// be told from points spread evenly over the zone; it counts as two.
double cut_variance_of(double std, double threshold) {
  if (!std::isfinite(threshold) || !(std > 0.0)) return 1.0;
  constexpr double kLeast = 2.0;
  double c = std::fmax(threshold / std, kLeast);
  for (int i = 0; i < 30; ++i) c = std::fmax(threshold / std * std::sqrt(cut_variance(c)), kLeast);
  return cut_variance(c);
}

}  // namespace

bool plane_of(const PointMoments& moments, const Vec3& up, FlatPlane& plane, Spread& spread) {
  if (moments.count() < 3) return false;
  const Mat3 scatter = moments.scatter();
  if (!scatter.allFinite()) return false;
  // `compute` iterates to full accuracy; the closed form `computeDirect` loses half the digits on flat sets.
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  solver.compute(scatter);
  if (solver.info() != Eigen::Success) return false;
  const Eigen::Vector3d eigenvalues = solver.eigenvalues();
  if (!(eigenvalues[1] > kLineRatio * eigenvalues[2])) return false;
  plane.n = solver.eigenvectors().col(0);
  plane.n.normalize();
  if (plane.n.dot(up) < 0.0) plane.n = -plane.n;
  plane.d = plane.n.dot(moments.mean());
  const double n = static_cast<double>(moments.count());
  spread.squares = std::fmax(plane.n.dot(scatter * plane.n), 0.0);
  spread.wide_mm = std::sqrt(eigenvalues[2] / n);
  spread.narrow_mm = std::sqrt(eigenvalues[1] / n);
  spread.along_wide = solver.eigenvectors().col(2);
  spread.along_narrow = solver.eigenvectors().col(1);
  return true;
}

void state_covariance(const Spread& spread, const Vec3& mean, double threshold, PlaneFit& fit) {
  fit.centroid = mean;
  if (!(fit.inliers > 3)) return;
  const double g = cut_variance_of(fit.std_mm, threshold);
  const double variance = fit.std_mm * fit.std_mm / (g * g * static_cast<double>(fit.inliers));
  fit.sigma_offset_mm = std::sqrt(variance);
  // A tilt towards a principal direction is known the better, the further the points reach along it.
  fit.cov_normal =
      variance / (spread.wide_mm * spread.wide_mm) * spread.along_wide * spread.along_wide.transpose() +
      variance / (spread.narrow_mm * spread.narrow_mm) * spread.along_narrow * spread.along_narrow.transpose();
}

}  // namespace slabd::algo
