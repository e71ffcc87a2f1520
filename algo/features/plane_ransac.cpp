// SPDX-License-Identifier: Apache-2.0
//
// Classical RANSAC (Fischler and Bolles 1981), what the paper's Table 1 compares its own algorithm with: the best of K
// planes through three points is the answer. Three noisy points make a noisy plane, and the more points are looked
// at, the better the choice but not the plane. Nothing measured here rests on it.
#include "algo/features/hypotheses.h"
#include "algo/features/plane_fit.h"
#include "algo/moments.h"

namespace slabd::algo {

PlaneFit fit_plane_ransac(std::span<const Vec3> points, const Vec3& up, const PlaneSettings& settings) {
  PlaneFit fit;
  fit.points = points.size();
  if (points.size() < 3) return fit;
  Prng prng(settings.seed);
  const PlaneSearch search{hypotheses_needed(settings.contamination, settings.confidence, 3), prng.next(), up};
  double threshold = settings.threshold_mm;
  if (!(threshold > 0.0)) {
    PlaneSample sample;
    Residuals scratch;
    draw_sample(points, prng, sample);
    if (!find_threshold(sample, search, trusted_share(settings.contamination), scratch, threshold)) return fit;
  }

  const auto inliers_of = [&](const FlatPlane& plane) {
    std::uint64_t inliers = 0;
    for (const Vec3& p : points) inliers += std::abs(plane.distance(p)) <= threshold ? 1U : 0U;
    return inliers;
  };
  FlatPlane plane;
  if (!best_hypothesis(points, search, plane,
                       [&](const FlatPlane& candidate, double) { return -static_cast<double>(inliers_of(candidate)); }))
    return fit;
  if (plane.n.dot(up) < 0.0) plane = {-plane.n, -plane.d};

  fit.normal = plane.n;
  fit.offset_mm = plane.d;
  // Sums around a point near the inliers keep their digits.
  const Vec3 shift = *std::find_if(points.begin(), points.end(),
                                   [&](const Vec3& p) { return std::abs(plane.distance(p)) <= threshold; });
  PointMoments about(shift);
  ScalarMoments squares(0.0);
  for (const Vec3& p : points) {
    const double r = plane.distance(p);
    if (!(std::abs(r) <= threshold)) continue;
    about.add(p);
    squares.add(r * r);
  }
  about.close_block();
  squares.close_block();
  const double n = static_cast<double>(about.count());
  fit.inliers = about.count();
  fit.inlier_fraction = n / static_cast<double>(points.size());
  fit.centroid = about.mean();
  if (fit.inliers > 3) fit.std_mm = std::sqrt(n * squares.mean() / (n - 3.0));
  fit.ok = fit.inlier_fraction >= settings.inlier_share_min;
  fit.doubt = fit.ok ? PlaneDoubt::none : PlaneDoubt::share;
  return fit;
}

}  // namespace slabd::algo
