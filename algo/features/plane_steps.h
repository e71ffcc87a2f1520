// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>

#include "algo/features/plane_kernels.h"
#include "algo/moments.h"
#include "base/base.h"

/// The steps of a plane fit: planes through three points of a sample and their comparison, least squares, and tests of
/// the plane found.
namespace slabd::algo {

/// Smallest inlier distance: noise-free data must not lose points to rounding.
inline constexpr double kThresholdFloor_mm = 1e-9;

/// Parameters of the random draw: the same seed gives the same K hypotheses.
struct PlaneSearch {
  int hypotheses = 1;
  std::uint64_t seed = 1;
  Vec3 up = Vec3::UnitZ();
};

/// Handle of a point, read later by `point_at`. Sets whose points are no longer in the cache prefetch the point here
/// (ListedPoints has its own versions of both).
template <typename Points>
[[nodiscard]] std::size_t ask_for_point(const Points& /*points*/, std::size_t i) {
  return i;
}
template <typename Points>
[[nodiscard]] Vec3 point_at(const Points& points, std::size_t i) {
  return points[i];
}

/// Draws one point from each of up to kPlaneSampleMax equal slices of the set: covers the face evenly in any scan
/// order. The slices come in turns, one of every four neighbours in each turn, chosen at random, because a pattern in
/// the set could leave a turn with outliers only. Points are prefetched when drawn and read 32 at a time.
template <typename Points>
void draw_sample(const Points& points, Prng& prng, PlaneSample& sample) {
  constexpr std::size_t kTurns = limits::kPlaneSampleMax / PlaneSample::kPreview;
  constexpr std::size_t kAtOnce = 32;
  const std::size_t n = points.size();
  const std::size_t m = std::min(n, limits::kPlaneSampleMax);
  // Dividing by a power of two known to the compiler costs nothing; any other division costs more than the rest.
  static_assert(std::has_single_bit(limits::kPlaneSampleMax));
  const auto start_of = [n](std::size_t slice) {
    return n < limits::kPlaneSampleMax ? slice : slice * n / limits::kPlaneSampleMax;
  };
  std::array<decltype(ask_for_point(points, n)), kAtOnce> asked{};
  std::size_t waiting = 0;
  const auto collect = [&] {
    for (std::size_t k = 0; k < waiting; ++k) sample.add(point_at(points, asked[k]));
    waiting = 0;
  };
  sample.count = 0;
  for (std::size_t turn = 0; turn < kTurns; ++turn) {
    for (std::size_t neighbours = 0; neighbours < m; neighbours += kTurns) {
      const std::size_t i = neighbours + (turn + Prng(neighbours).next()) % kTurns;
      if (i >= m) continue;
      const std::size_t first = start_of(i);
      const std::size_t slice = start_of(i + 1) - first;
      asked[waiting++] = ask_for_point(points, first + (((prng.next() >> 32U) * slice) >> 32U));
      if (waiting == kAtOnce) collect();
    }
  }
  collect();
  sample.close();
}

/// Computes the plane through three points. False if they are equal, on a line or not finite.
[[nodiscard]] bool plane_through(const Vec3& a, const Vec3& b, const Vec3& c, FlatPlane& plane);

/// Runs `score(plane, best)` over K planes through three of the points and keeps the smallest score. False if no three
/// points make a plane.
template <typename Points, typename Score>
[[nodiscard]] bool best_hypothesis(const Points& points, const PlaneSearch& search, FlatPlane& best,
                                   const Score& score) {
  if (points.size() < 3) return false;
  Prng prng(search.seed);
  double best_score = std::numeric_limits<double>::infinity();
  bool found = false;
  int drawn = 0;
  // Draws on a line or with a repeated point do not count, but the number of attempts is limited.
  for (int attempt = 0; drawn < search.hypotheses && attempt < 8 * search.hypotheses + 64; ++attempt) {
    const Vec3 a = points[prng.below(points.size())];
    const Vec3 b = points[prng.below(points.size())];
    const Vec3 c = points[prng.below(points.size())];
    FlatPlane plane;
    if (!plane_through(a, b, c, plane)) continue;
    ++drawn;
    const double s = score(plane, best_score);
    if (s < best_score) {
      best_score = s;
      best = plane;
      found = true;
    }
  }
  return found;
}

/// The hypothesis of least squared error truncated at `threshold` (MSAC), on the sample's preview. False if no three
/// points make a plane.
[[nodiscard]] bool best_within(const PlaneSample& sample, const PlaneSearch& search, double threshold, FlatPlane& best);
/// The same for several thresholds, each half of the one before.
[[nodiscard]] bool best_within_scales(const PlaneSample& sample, const PlaneSearch& search, double threshold,
                                      std::array<FlatPlane, kScales>& best);

/// Writes the distances of the points to the front of `residuals`; infinite for points that are not finite.
void residuals_of(const SamplePoints& points, const FlatPlane& plane, Residuals& residuals);

/// Inlier distance for a plane: three robust standard deviations of the trusted `share` of the sample, with a minimum
/// so that noise-free data does not lose its points to rounding.
[[nodiscard]] double threshold_about(const PlaneSample& sample, const FlatPlane& plane, double share,
                                     Residuals& scratch);

/// Share of points used for estimating the noise: the uncontaminated ones, at most a half (least median of
/// squares).
[[nodiscard]] double trusted_share(double contamination);

/// Inlier distance if none is given: from the hypothesis that best fits the trusted share of the sample. False if no
/// three points make a plane.
[[nodiscard]] bool find_threshold(const PlaneSample& sample, const PlaneSearch& search, double share,
                                  Residuals& scratch, double& threshold);

// The least-squares step of the plane fits.

/// Distribution of points about their plane.
struct Spread {
  double squares = 0.0;  ///< sum of squared distances, mm^2
  double wide_mm = 0.0;  ///< standard deviations in the plane, along the principal directions
  double narrow_mm = 0.0;
  Vec3 along_wide = Vec3::Zero();
  Vec3 along_narrow = Vec3::Zero();
};

/// Orthogonal least-squares plane of the points in `moments`. False if they do not determine one.
[[nodiscard]] bool plane_of(const PointMoments& moments, const Vec3& up, FlatPlane& plane, Spread& spread);

/// Adds the points within `threshold` of `plane` to `moments`.
template <typename Points>
void add_within(const Points& points, const FlatPlane& plane, double threshold, PointMoments& moments) {
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vec3 p = points[i];
    if (std::abs(plane.distance(p)) <= threshold) moments.add(p);
  }
  moments.close_block();
}
inline void add_within(const SamplePoints& points, const FlatPlane& plane, double threshold, PointMoments& moments) {
  const SampleSums within = sums_within(points, plane, threshold, moments.shift());
  moments.add_sums(within.sums, within.count);
}

/// Replaces `plane` by the least-squares plane of the points within `threshold` of it. False if they do not determine
/// one. `moments` must be empty; the sums are taken about its shift, and the same selection gives the same bits only
/// with the same shift.
template <typename Points>
[[nodiscard]] bool refit_within(const Points& points, double threshold, const Vec3& up, PointMoments& moments,
                                FlatPlane& plane, Spread& spread) {
  add_within(points, plane, threshold, moments);
  return plane_of(moments, up, plane, spread);
}

/// Fills in the covariances for inliers of standard deviation `fit.std_mm`. Selection within `threshold` cuts off the
/// tails of the noise: the inliers look quieter, and the fit follows its own selection. With g(c) = 1 - 2 c phi(c) / (2
/// Phi(c) - 1), c the threshold in noise widths, the variance of the noise is std^2 / g and that of a fit std^2 / g^2
/// over the usual divisors (M-estimator with hard rejection). At c = 3 std is 1.3 % and the plain standard error 2.7 %
/// too small. Infinite `threshold`: nothing was cut.
void state_covariance(const Spread& spread, const Vec3& mean, double threshold, PlaneFit& fit);

// Tests for confident but wrong planes: structure among the points instead of noise. All use the sample.

/// True if the zone of +-`threshold` around the best plane contains two surfaces, side by side or stacked, with almost
/// nothing in between; a plane through both is neither. Then `level` becomes the plane of the stronger one and
/// `threshold` its own three robust standard deviations. A bow, a wave or a roof is one surface. Two surfaces closer
/// than about four standard deviations of the noise look like one noisier surface.
[[nodiscard]] bool find_level(const PlaneSample& sample, const PlaneSearch& search, double reach, Residuals& scratch,
                              FlatPlane& level, double& threshold);

/// True if the choice of plane is ambiguous: the points further than `threshold` from `plane` contain another plane
/// with at least four fifths as many points, a fifth of them its own.
[[nodiscard]] bool has_rival(const PlaneSample& sample, const PlaneSearch& search, const FlatPlane& plane,
                             double threshold);

/// True if the plane depends on where the threshold cuts. A second surface three to four standard deviations
/// away pulls the plane to one side. With a quarter wider threshold, the plane then moves by more than a tenth
/// of a standard deviation. It does not count if the plane then tilts by at most `limits.tilt_rad` (and that is not
/// 0) and moves by at most `limits.move_mm`. `bend` is then the change at `centroid`, if `limits.move_mm` is finite.
struct BendLimits {
  double tilt_rad = 0.0;
  double move_mm = 0.0;
};
[[nodiscard]] bool bends_with_threshold(const PlaneSample& sample, const FlatPlane& plane, double threshold,
                                        const BendLimits& limits, const Vec3& centroid, PlaneShift& bend);

}  // namespace slabd::algo
