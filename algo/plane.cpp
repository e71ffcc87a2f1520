// SPDX-License-Identifier: Apache-2.0
//
// Planes from points of which some do not belong (paper 3.1).
//
// A plane through three noisy points is a poor plane, and counting inliers against it is a poor judge. So hypotheses
// only have to find the right neighbourhood: they are scored on a stratified sample by truncated squared error, the
// best is polished by least squares, and the answer is the fixed point of "select within t, refit" on all points.
// The answer then depends on the data and t, no longer on the random draw.
//
// Invariants: distances are orthogonal (a regression on z is wrong on steep faces); sums are blocked and shifted;
// NaN points are never inliers; the same input gives the same bits.
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

#include "algo/hypotheses.h"
#include "algo/plane_fit.h"

namespace slabd::algo {
namespace {

/// Local optimisation of the best hypothesis on the sample; it settles in two or three.
constexpr int kPolishSteps = 5;
/// Below this ratio of the middle to the largest eigenvalue the points lie on a line.
constexpr double kLineRatio = 1e-14;

/// How points lie about their plane.
struct Spread {
  double squares = 0.0;  ///< sum of squared distances, mm^2
  double wide_mm = 0.0;  ///< standard deviations in the plane, along the principal directions
  double narrow_mm = 0.0;
};

/// Least-squares plane of what `moments` has seen; false when it is not a plane.
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
  return true;
}

/// Least-squares plane of the points within `threshold` of `plane`, which it replaces; false when they form none. The
/// sums are taken around `shift`: the same selection gives the same bits only with the same shift.
template <typename Points>
bool refit_within(const Points& points, std::size_t count, double threshold, const Vec3& shift, const Vec3& up,
                  FlatPlane& plane, Spread& spread, std::size_t& inliers) {
  const FlatPlane old = plane;
  PointMoments moments(shift);
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3 p = points[i];
    if (std::abs(old.distance(p)) <= threshold) moments.add(p);
  }
  moments.close_block();
  inliers = moments.count();
  return plane_of(moments, up, plane, spread);
}

/// Noise and reach say how well a tilt is known: a small patch fits a plane perfectly and knows nothing of its tilt.
bool rests_on_enough(const PlaneSupport& support, const PlaneFit& fit, const Spread& spread) {
  const double tilt_sigma_rad = fit.std_mm / (spread.narrow_mm * std::sqrt(static_cast<double>(fit.inliers)));
  return fit.inliers >= support.inliers_min && spread.wide_mm >= support.wide_mm &&
         spread.narrow_mm >= support.narrow_mm && !(tilt_sigma_rad > support.tilt_sigma_max_rad);
}

/// Least squared error truncated at the threshold (MSAC); gives up as soon as it cannot win.
double msac_score(const PlaneSample& sample, const FlatPlane& plane, double threshold, double best) {
  const double t2 = threshold * threshold;
  double sum = 0.0;
  for (std::size_t i = 0; i < sample.size; ++i) {
    const double r = plane.distance(sample.points[i]);
    const double r2 = r * r;
    sum += r2 < t2 ? r2 : t2;
    if ((i & 255U) == 255U && sum >= best) break;
  }
  return sum;
}

}  // namespace

template <typename Points>
PlaneFit fit_plane_over(const Points& points, const Vec3& up, const PlaneSettings& settings) {
  PlaneFit fit;
  fit.points = points.size();
  if (points.size() < 3) return fit;

  PlaneSample sample;
  Residuals scratch;
  Prng prng(settings.seed);
  draw_sample(points, prng, sample);
  const int hypotheses = hypotheses_needed(settings.contamination, settings.confidence, 3);
  const std::uint64_t seed = prng.next();

  // Without a given threshold a first round learns how large the noise is.
  const bool threshold_given = settings.threshold_mm > 0.0;
  const double share = trusted_share(settings.contamination);
  double threshold = settings.threshold_mm;
  if (!threshold_given && !find_threshold(sample, hypotheses, share, seed, scratch, threshold)) return fit;
  FlatPlane plane;
  if (!best_hypothesis(
          sample.points, sample.size, hypotheses, seed, plane,
          [&](const FlatPlane& candidate, double best) { return msac_score(sample, candidate, threshold, best); }))
    return fit;

  // Any place near the plane's points serves as the origin of the sums, as long as it stays the same.
  const auto finite =
      std::find_if(sample.points.begin(), sample.points.begin() + static_cast<std::ptrdiff_t>(sample.size),
                   [](const Vec3& p) { return p.allFinite(); });
  const Vec3 shift = *finite - plane.distance(*finite) * plane.n;
  Spread spread;
  std::size_t inliers = 0;
  for (int i = 0; i < kPolishSteps; ++i) {
    FlatPlane polished = plane;
    if (!refit_within(sample.points, sample.size, threshold, shift, up, polished, spread, inliers)) break;
    plane = polished;
    if (!threshold_given) threshold = threshold_about(sample, plane, share, scratch);
  }

  bool stands_still = false;
  bool is_plane = true;
  while (!stands_still && is_plane && fit.iterations < settings.refits_max) {
    ++fit.iterations;
    FlatPlane next = plane;
    is_plane = refit_within(points, points.size(), threshold, shift, up, next, spread, inliers);
    // The same selection gives the same sums, and the other way round: equal planes mean equal inlier sets.
    stands_still = is_plane && next.same_bits(plane);
    if (is_plane) plane = next;
  }

  fit.normal = plane.n.dot(up) < 0.0 ? Vec3(-plane.n) : plane.n;
  fit.offset_mm = plane.n.dot(up) < 0.0 ? -plane.d : plane.d;
  fit.inliers = inliers;
  fit.inlier_fraction = static_cast<double>(inliers) / static_cast<double>(points.size());
  if (is_plane && inliers > 3) fit.std_mm = std::sqrt(spread.squares / static_cast<double>(inliers - 3));
  fit.ok = is_plane && stands_still && fit.inlier_fraction >= settings.inlier_share_min &&
           rests_on_enough(settings.support, fit, spread);
  return fit;
}

template <typename Points>
PlaneFit fit_plane_lsq_over(const Points& points, const Vec3& up) {
  PlaneFit fit;
  fit.points = points.size();
  if (points.size() < 3) return fit;
  PointMoments moments(points[0]);
  for (std::size_t i = 0; i < points.size(); ++i) moments.add(points[i]);
  moments.close_block();
  FlatPlane plane;
  Spread spread;
  if (!plane_of(moments, up, plane, spread)) return fit;
  fit.ok = true;
  fit.normal = plane.n;
  fit.offset_mm = plane.d;
  fit.inliers = points.size();
  fit.inlier_fraction = 1.0;
  fit.iterations = 1;
  if (points.size() > 3) fit.std_mm = std::sqrt(spread.squares / static_cast<double>(points.size() - 3));
  return fit;
}

template PlaneFit fit_plane_over(const std::span<const Vec3>&, const Vec3&, const PlaneSettings&);
template PlaneFit fit_plane_over(const CloudPoints&, const Vec3&, const PlaneSettings&);
template PlaneFit fit_plane_lsq_over(const std::span<const Vec3>&, const Vec3&);
template PlaneFit fit_plane_lsq_over(const CloudPoints&, const Vec3&);

PlaneFit fit_plane(std::span<const Vec3> points, const Vec3& up, const PlaneSettings& settings) {
  return fit_plane_over(points, up, settings);
}

PlaneFit fit_plane_lsq(std::span<const Vec3> points, const Vec3& up) {
  return fit_plane_lsq_over(points, up);
}

}  // namespace slabd::algo
