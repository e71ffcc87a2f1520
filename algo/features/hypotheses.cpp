// SPDX-License-Identifier: Apache-2.0
#include "algo/features/hypotheses.h"

#include "algo/algo.h"
#include "algo/features/plane_fit.h"
#include "algo/median.h"

namespace slabd::algo {
namespace {

/// Place of the quantile `share` among so many sorted values.
std::size_t rank_of(double share, std::size_t values) {
  return static_cast<std::size_t>(std::floor(share * static_cast<double>(values - 1)));
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

bool best_within(const PlaneSample& sample, const PlaneSearch& search, double threshold, FlatPlane& best) {
  return best_hypothesis(sample.all(), search, best, [&](const FlatPlane& plane, double best_score) {
    return truncated_squares(sample.scouts(), plane, threshold, best_score);
  });
}

bool best_within_scales(const PlaneSample& sample, const PlaneSearch& search, double threshold,
                        std::array<FlatPlane, kScales>& best) {
  ScaledSums least;
  least.fill(std::numeric_limits<double>::infinity());
  FlatPlane widest;
  return best_hypothesis(sample.all(), search, widest, [&](const FlatPlane& plane, double) {
    const ScaledSums sums = truncated_squares(sample.scouts(), plane, threshold, least);
    for (std::size_t k = 0; k < kScales; ++k) {
      if (!(sums[k] < least[k])) continue;
      least[k] = sums[k];
      best[k] = plane;
    }
    return sums[0];
  });
}

void residuals_of(const SamplePoints& points, const FlatPlane& plane, Residuals& residuals) {
  distances_of(points, plane, residuals);
  for (double& r : std::span(residuals).first(points.count))
    r = std::isfinite(r) ? std::abs(r) : std::numeric_limits<double>::infinity();
}

double robust_sigma(std::span<const double> abs_residuals, double share) {
  if (abs_residuals.empty()) return 0.0;
  // Of normal errors, half lie within 0.6745 sigma.
  constexpr double kMad = 1.482602218505602;
  // ... and half of those within three sigma lie within 0.6720 sigma.
  constexpr double kMadWithinThree = 1.488100;
  double sigma = kMad * value_at_rank(abs_residuals, rank_of(share, abs_residuals.size()));
  if (!std::isfinite(sigma)) return sigma;
  for (int i = 0; i < 50; ++i) {
    // Those kept are the smallest of all.
    const std::size_t kept = count_at_most(abs_residuals, 3.0 * sigma);
    if (kept == 0) return sigma;
    const double next = kMadWithinThree * value_at_rank(abs_residuals, rank_of(0.5, kept));
    if (!(next < sigma)) return sigma;
    sigma = next;
  }
  return sigma;
}

double threshold_about(const PlaneSample& sample, const FlatPlane& plane, double share, Residuals& scratch) {
  residuals_of(sample.all(), plane, scratch);
  return std::fmax(3.0 * robust_sigma(std::span(scratch).first(sample.count), share), kThresholdFloor_mm);
}

double trusted_share(double contamination) {
  return std::clamp(1.0 - contamination, 0.05, 0.5);
}

bool find_threshold(const PlaneSample& sample, const PlaneSearch& search, double share, Residuals& scratch,
                    double& threshold) {
  const SamplePoints scouts = sample.scouts();
  const std::size_t rank = scouts.count < 3 ? 0 : rank_of(share, scouts.count);
  // Nearly all hypotheses lose: fewer points than it takes are closer than the best quantile so far.
  const auto quantile_score = [&](const FlatPlane& candidate, double best) {
    if (count_closer(scouts, candidate, best) <= rank) return best;
    residuals_of(scouts, candidate, scratch);
    return value_at_rank(std::span(scratch).first(scouts.count), rank);
  };
  FlatPlane plane;
  if (!best_hypothesis(sample.all(), search, plane, quantile_score)) return false;
  threshold = threshold_about(sample, plane, share, scratch);
  return true;
}

}  // namespace slabd::algo
