// SPDX-License-Identifier: Apache-2.0
//
// Problem: fit planes to points with outliers (paper 3.1).
//
// Idea: a plane through three noisy points is inaccurate, and so is counting its inliers. So hypotheses only have to
// find the right neighbourhood: they are scored on a stratified sample by truncated squared error, the best is improved
// by least squares, and the result is the fixed point of "select within t, refit" on all points. The result then
// depends on the data and t, no longer on the random draw.
//
// "Select, refit" can only reduce the truncated squared error, so it ends. Only rounding can make it alternate between
// practically identical planes, which counts as converged.
//
// A fixed point is not necessarily the right plane: two adjacent surfaces have one each, and one in between.
// plane_steps.h tests for that.
//
// Invariants: distances are orthogonal (a regression on z is wrong on steep faces); sums are blocked and shifted; NaN
// points are never inliers; the same input gives the same bits.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "algo/features/face_points.h"
#include "algo/features/plane_fit.h"
#include "algo/features/plane_steps.h"
#include "algo/features/plane_zone.h"
#include "algo/moments.h"

namespace slabd::algo {
namespace {

/// Local optimisation of the best hypothesis on the sample, until the threshold hardly changes: two or three steps.
constexpr int kPolishSteps = 5;
constexpr double kPolished = 0.01;
/// Number of zones tried before each refit reads all points; the first one nearly always suffices.
constexpr int kZonePasses = 3;
/// A place with fewer sample points was not seen: its points are strays.
constexpr double kPlaceSampleMin = 4.0;

/// Noise and extent determine the uncertainty of a tilt: a small patch fits a plane perfectly, but its tilt is
/// uncertain.
bool rests_on_enough(const PlaneSupport& support, const PlaneFit& fit, const Spread& spread) {
  const double tilt_sigma_rad = fit.std_mm / (spread.narrow_mm * std::sqrt(static_cast<double>(fit.inliers)));
  return fit.inliers >= support.inliers_min && spread.wide_mm >= support.wide_mm &&
         spread.narrow_mm >= support.narrow_mm && !(tilt_sigma_rad > support.tilt_sigma_max_rad);
}

/// The last planes of the refits, to detect repetition.
class RecentPlanes {
 public:
  void add(const FlatPlane& plane) { planes_[count_++ % planes_.size()] = plane; }
  [[nodiscard]] bool hold(const FlatPlane& plane) const {
    const auto end = planes_.begin() + static_cast<std::ptrdiff_t>(std::min(count_, planes_.size()));
    return std::any_of(planes_.begin(), end, [&](const FlatPlane& p) { return p.same_bits(plane); });
  }

 private:
  std::array<FlatPlane, 8> planes_;
  std::size_t count_ = 0;
};

/// True if two planes differ by less than rounding and a hundredth of the fit's own noise, over all its inliers.
bool indistinguishable(const FlatPlane& a, const FlatPlane& b, const Vec3& centroid, const Spread& spread,
                       double sigma_mm) {
  constexpr double kRounding_mm = 1e-9;
  const double shift = std::abs(a.distance(centroid) - b.distance(centroid));
  const double lean = (a.n - b.n).norm() * spread.wide_mm;
  return std::fmax(shift, lean) <= std::fmax(0.01 * sigma_mm, kRounding_mm);
}

/// A finite point near the plane. Any fixed origin is suitable for the sums.
Vec3 origin_near(const SamplePoints& points, const FlatPlane& plane) {
  std::size_t i = 0;
  while (i + 1 < points.size() && !points[i].allFinite()) ++i;
  return points[i] - plane.distance(points[i]) * plane.n;
}

}  // namespace

template <typename Points>
void begin_fit(const Points& points, const Vec3& up, const PlaneSettings& settings, PlaneStart& start) {
  start.found = false;
  start.doubtful = false;
  if (points.size() < 3) return;
  Residuals scratch;
  Prng prng(settings.seed);
  PlaneSample& sample = start.sample;
  draw_sample(points, prng, sample);
  start.search = {hypotheses_needed(settings.contamination, settings.confidence, 3), prng.next(), up};

  // Without a given threshold, a first round estimates the noise.
  const bool threshold_given = settings.threshold_mm > 0.0;
  const double share = trusted_share(settings.contamination);
  double threshold = settings.threshold_mm;
  if (!threshold_given && !find_threshold(sample, start.search, share, scratch, threshold)) return;
  threshold = std::fmax(threshold, settings.threshold_min_mm);
  FlatPlane plane;
  if (!best_within(sample, start.search, threshold, plane)) return;

  start.shift = origin_near(sample.all(), plane);
  for (int i = 0; i < kPolishSteps; ++i) {
    FlatPlane polished = plane;
    Spread spread;
    PointMoments moments(start.shift);
    if (!refit_within(sample.all(), threshold, up, moments, polished, spread)) break;
    const bool stands_still = polished.same_bits(plane);
    plane = polished;
    const double before = threshold;
    if (!threshold_given)
      threshold = std::fmax(threshold_about(sample, plane, share, scratch), settings.threshold_min_mm);
    if (stands_still || std::abs(threshold - before) <= kPolished * before) break;
  }
  if (FlatPlane level; find_level(sample, start.search, threshold, scratch, level, threshold)) {
    plane = level;
    start.doubtful = threshold_given;
  }
  start.plane = plane;
  start.threshold_mm = threshold;
  start.found = true;
}

template <typename Points>
PlaneFit finish_fit(const Points& points, const PlaneSettings& settings, const PlaneStart& start) {
  PlaneFit fit;
  fit.points = points.size();
  fit.doubt = PlaneDoubt::no_plane;
  if (!start.found) return fit;
  const Vec3& up = start.search.up;
  const double threshold = start.threshold_mm;
  FlatPlane plane = start.plane;
  Spread spread;
  bool stands_still = false;
  bool is_plane = true;
  RecentPlanes recent;
  while (!stands_still && is_plane && fit.iterations < settings.refits_max) {
    ++fit.iterations;
    FlatPlane next = plane;
    PointMoments moments(start.shift);
    is_plane = refit_within(points, threshold, up, moments, next, spread);
    fit.inliers = moments.count();
    if (!is_plane) break;
    const double n = static_cast<double>(fit.inliers);
    if (fit.inliers > 3) fit.std_mm = std::sqrt(spread.squares / (n - 3.0));
    state_covariance(spread, moments.mean(), threshold, fit);
    // The same selection gives the same sums, and vice versa: equal planes mean equal inlier sets.
    stands_still = next.same_bits(plane) ||
                   (recent.hold(next) && indistinguishable(next, plane, fit.centroid, spread, fit.sigma_offset_mm));
    recent.add(plane);
    plane = next;
  }

  fit.normal = plane.n.dot(up) < 0.0 ? Vec3(-plane.n) : plane.n;
  fit.offset_mm = plane.n.dot(up) < 0.0 ? -plane.d : plane.d;
  fit.inlier_fraction = static_cast<double>(fit.inliers) / static_cast<double>(points.size());
  fit.doubt = [&] {
    if (!is_plane) return PlaneDoubt::no_plane;
    if (!stands_still) return PlaneDoubt::unsettled;
    if (start.doubtful) return PlaneDoubt::second_surface;
    if (fit.inlier_fraction < settings.inlier_share_min) return PlaneDoubt::share;
    if (!rests_on_enough(settings.support, fit, spread)) return PlaneDoubt::support;
    if (bends_with_threshold(start.sample, plane, threshold, {settings.bend_max_rad, settings.bend_max_mm},
                             fit.centroid, fit.bend))
      return PlaneDoubt::bends;
    if (has_rival(start.sample, start.search, plane, threshold)) return PlaneDoubt::rival;
    return PlaneDoubt::none;
  }();
  fit.ok = fit.doubt == PlaneDoubt::none;
  if (plane.n.dot(up) < 0.0) fit.bend = {-fit.bend.normal, -fit.bend.height_mm};
  return fit;
}

template <typename Points>
PlaneFit fit_plane_over(const Points& points, const Vec3& up, const PlaneSettings& settings) {
  PlaneStart start;
  begin_fit(points, up, settings, start);
  return finish_fit(points, settings, start);
}

PlaneFit fit_plane_over(const ListedPoints& points, const Vec3& up, const PlaneSettings& settings) {
  PlaneStart start;
  return fit_plane_over(points, up, settings, start);
}

PlaneFit fit_plane_over(const ListedPoints& points, const Vec3& up, const PlaneSettings& settings, PlaneStart& start) {
  begin_fit(points, up, settings, start);
  ZonedPoints zoned;
  for (int pass = 0; pass < kZonePasses && start.found; ++pass) {
    if (!zoned.sort(points, start.plane, start.threshold_mm)) break;
    PlaneFit fit = finish_fit(zoned, settings, start);
    if (!zoned.asked_beyond()) return fit;
    start.plane = {fit.normal, fit.offset_mm};
  }
  return finish_fit(points, settings, start);
}

double share_by_area(const PlaneStart& start, const PlaneFit& fit, const SeatFrame& frame, const FaceRaster& raster,
                     const PlaceCounts& off, std::size_t points) {
  std::array<double, FaceRaster::kPlaces> all{};
  std::array<double, FaceRaster::kPlaces> within{};
  const SamplePoints sample = start.sample.all();
  const FlatPlane plane{fit.normal, fit.offset_mm};
  const FlatPlane along{frame.along_rail, frame.along_rail.dot(frame.origin)};
  const FlatPlane across{frame.along_seat, frame.along_seat.dot(frame.origin)};
  for (std::size_t i = 0; i < sample.size(); ++i) {
    const Vec3 p = sample[i];
    const double height = plane.distance(p);
    if (!std::isfinite(height)) continue;
    const std::size_t place =
        raster.place_of(static_cast<float>(along.distance(p)), static_cast<float>(across.distance(p)));
    all[place] += 1.0;
    if (std::abs(height) <= start.threshold_mm) within[place] += 1.0;
  }
  const double each = static_cast<double>(points) / static_cast<double>(sample.size());
  double seen = 0.0;
  double share = 0.0;
  for (std::size_t k = 0; k < all.size(); ++k) {
    const double here = all[k] + static_cast<double>(off[k]) / each;
    if (here < kPlaceSampleMin) continue;
    seen += 1.0;
    share += within[k] / here;
  }
  return seen > 0.0 ? share / seen : 0.0;
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
  fit.doubt = PlaneDoubt::none;
  fit.normal = plane.n;
  fit.offset_mm = plane.d;
  fit.inliers = points.size();
  fit.inlier_fraction = 1.0;
  fit.iterations = 1;
  if (points.size() > 3) fit.std_mm = std::sqrt(spread.squares / static_cast<double>(points.size() - 3));
  state_covariance(spread, moments.mean(), std::numeric_limits<double>::infinity(), fit);
  return fit;
}

template PlaneFit fit_plane_over(const std::span<const Vec3>&, const Vec3&, const PlaneSettings&);
template PlaneFit fit_plane_over(const CloudPoints&, const Vec3&, const PlaneSettings&);
template void begin_fit(const ListedPoints&, const Vec3&, const PlaneSettings&, PlaneStart&);
template PlaneFit finish_fit(const SummedPoints&, const PlaneSettings&, const PlaneStart&);
template PlaneFit fit_plane_lsq_over(const std::span<const Vec3>&, const Vec3&);
template PlaneFit fit_plane_lsq_over(const CloudPoints&, const Vec3&);

PlaneFit fit_plane(std::span<const Vec3> points, const Vec3& up, const PlaneSettings& settings) {
  return fit_plane_over(points, up, settings);
}

PlaneFit fit_plane_lsq(std::span<const Vec3> points, const Vec3& up) {
  return fit_plane_lsq_over(points, up);
}

// Classical RANSAC (Fischler and Bolles 1981), the paper's comparison in Table 1: the result is the best of K planes
// through three points. Three noisy points make a noisy plane; more points improve the choice but not the plane. No
// measured item uses it.

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
  // Sums about a point near the inliers keep their digits.
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
