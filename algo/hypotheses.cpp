// SPDX-License-Identifier: Apache-2.0
#include "algo/hypotheses.h"

#include "algo/algo.h"
#include "algo/plane_fit.h"

namespace slabd::algo {
namespace {

double quantile_of(std::span<double> values, double share) {
  const double position = share * static_cast<double>(values.size() - 1);
  const auto k = static_cast<std::ptrdiff_t>(std::floor(position));
  std::nth_element(values.begin(), values.begin() + k, values.end());
  return values[static_cast<std::size_t>(k)];
}

}  // namespace

int hypotheses_needed(double contamination, double confidence, int points_per_hypothesis) {
  constexpr int most = static_cast<int>(limits::kPlaneHypothesesMax);
  if (!(contamination > 0.0) || !(confidence > 0.0)) return 1;
  if (contamination >= 1.0 || confidence >= 1.0) return most;
  const double all_clean = std::pow(1.0 - contamination, points_per_hypothesis);
  const double k = std::log1p(-confidence) / std::log1p(-all_clean);
  if (!(k < static_cast<double>(most))) return most;
  return std::max(1, static_cast<int>(std::ceil(k)));
}

bool plane_through(const Vec3& a, const Vec3& b, const Vec3& c, FlatPlane& plane) {
  const Vec3 ab = b - a;
  const Vec3 ac = c - a;
  const Vec3 normal = ab.cross(ac);
  const double length = normal.norm();
  if (!(length > 1e-9 * ab.norm() * ac.norm()) || !std::isfinite(length)) return false;
  plane.n = normal / length;
  plane.d = plane.n.dot(a);
  return true;
}

bool best_within(std::span<const Vec3> points, const PlaneSearch& search, double threshold, FlatPlane& best) {
  const double t2 = threshold * threshold;
  const auto score = [&](const FlatPlane& plane, double best_score) {
    double sum = 0.0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      const double r = plane.distance(points[i]);
      const double r2 = r * r;
      sum += r2 < t2 ? r2 : t2;
      // It cannot win any more.
      if ((i & 255U) == 255U && sum >= best_score) break;
    }
    return sum;
  };
  return best_hypothesis(points, search, best, score);
}

void residuals_of(const PlaneSample& sample, const FlatPlane& plane, Residuals& residuals) {
  for (std::size_t i = 0; i < sample.size; ++i) {
    const double r = std::abs(plane.distance(sample.points[i]));
    residuals[i] = std::isfinite(r) ? r : std::numeric_limits<double>::infinity();
  }
}

double robust_sigma(std::span<double> abs_residuals, double share) {
  if (abs_residuals.empty()) return 0.0;
  // Of normal errors, half lie within 0.6745 sigma.
  constexpr double kMad = 1.482602218505602;
  // ... and half of those within three sigma lie within 0.6720 sigma.
  constexpr double kMadWithinThree = 1.488100;
  double sigma = kMad * quantile_of(abs_residuals, share);
  if (!std::isfinite(sigma)) return sigma;
  std::size_t kept = abs_residuals.size();
  for (int i = 0; i < 50; ++i) {
    const auto end = std::partition(abs_residuals.begin(), abs_residuals.begin() + static_cast<std::ptrdiff_t>(kept),
                                    [&](double r) { return r <= 3.0 * sigma; });
    kept = static_cast<std::size_t>(end - abs_residuals.begin());
    if (kept == 0) return sigma;
    const double next = kMadWithinThree * quantile_of(abs_residuals.first(kept), 0.5);
    if (!(next < sigma)) return sigma;
    sigma = next;
  }
  return sigma;
}

double threshold_about(const PlaneSample& sample, const FlatPlane& plane, double share, Residuals& scratch) {
  residuals_of(sample, plane, scratch);
  return std::fmax(3.0 * robust_sigma(std::span(scratch).first(sample.size), share), kThresholdFloor_mm);
}

double trusted_share(double contamination) {
  return std::clamp(1.0 - contamination, 0.05, 0.5);
}

bool find_threshold(const PlaneSample& sample, const PlaneSearch& search, double share, Residuals& scratch,
                    double& threshold) {
  const auto quantile_score = [&](const FlatPlane& candidate, double) {
    residuals_of(sample, candidate, scratch);
    return quantile_of(std::span(scratch).first(sample.size), share);
  };
  FlatPlane plane;
  if (!best_hypothesis(sample.view(), search, plane, quantile_score)) return false;
  threshold = threshold_about(sample, plane, share, scratch);
  return true;
}

}  // namespace slabd::algo
