// SPDX-License-Identifier: Apache-2.0
#include "algo/features/plane_steps.h"

#include <Eigen/Eigenvalues>
#include <numbers>

#include "algo/algo.h"
#include "algo/features/face_points.h"
#include "algo/features/plane_fit.h"
#include "algo/features/plane_zone.h"
#include "algo/median.h"

namespace slabd::algo {
namespace {

/// Rank of the quantile `share` among `values` sorted values.
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
    return truncated_squares(sample.preview(), plane, threshold, best_score);
  });
}

bool best_within_scales(const PlaneSample& sample, const PlaneSearch& search, double threshold,
                        std::array<FlatPlane, kScales>& best) {
  ScaledSums least;
  least.fill(std::numeric_limits<double>::infinity());
  FlatPlane widest;
  return best_hypothesis(sample.all(), search, widest, [&](const FlatPlane& plane, double) {
    const ScaledSums sums = truncated_squares(sample.preview(), plane, threshold, least);
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
  // Half of normal errors are within 0.6745 sigma.
  constexpr double kMad = 1.482602218505602;
  // ... and half of those within three sigma are within 0.6720 sigma.
  constexpr double kMadWithinThree = 1.488100;
  double sigma = kMad * value_at_rank(abs_residuals, rank_of(share, abs_residuals.size()));
  if (!std::isfinite(sigma)) return sigma;
  for (int i = 0; i < 50; ++i) {
    // The residuals kept are the smallest of all.
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
  const SamplePoints preview = sample.preview();
  const std::size_t rank = preview.count < 3 ? 0 : rank_of(share, preview.count);
  // Nearly all hypotheses fail here: too few points are closer than the best quantile so far.
  const auto quantile_score = [&](const FlatPlane& candidate, double best) {
    if (count_closer(preview, candidate, best) <= rank) return best;
    residuals_of(preview, candidate, scratch);
    return value_at_rank(std::span(scratch).first(preview.count), rank);
  };
  FlatPlane plane;
  if (!best_hypothesis(sample.all(), search, plane, quantile_score)) return false;
  threshold = threshold_about(sample, plane, share, scratch);
  return true;
}

namespace {

/// Below this ratio of the middle to the largest eigenvalue the points are on a line.
constexpr double kLineRatio = 1e-14;

/// Variance of a standard normal variable cut off beyond +-c.
double cut_variance(double c) {
  const double density = std::exp(-0.5 * c * c) / std::sqrt(2.0 * std::numbers::pi);
  return 1.0 - 2.0 * c * density / std::erf(c / std::numbers::sqrt2);
}

/// The same for data cut at `threshold` with standard deviation `std` after the cut. A cut below two noise widths
/// cannot be distinguished from points spread evenly over the zone; it counts as two.
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
  // The uncertainty of a tilt towards a principal direction decreases with the extent of the points along it.
  fit.cov_normal =
      variance / (spread.wide_mm * spread.wide_mm) * spread.along_wide * spread.along_wide.transpose() +
      variance / (spread.narrow_mm * spread.narrow_mm) * spread.along_narrow * spread.along_narrow.transpose();
}

// Problem: the points of a second plane, a step or a raised patch are not noise, and a threshold estimated from all
// points may be wide enough to include them. The fit then converges to a plane between or across the surfaces, with a
// small standard error and a fair share of inliers. Two properties reveal such a plane.
//
//   - Measured from the right one of its surfaces, the heights form two clusters with a gap between them. Heights of a
//     single surface, bent or not, leave no gap: a bow thins out evenly, and a wave, although most of its points are at
//     its crests, contains all heights between. So planes are searched at ever finer thresholds, and each is tested for
//     a gap.
//   - If they are far apart, each surface has its own fixed point. The points outside the chosen plane's threshold then
//     contain a plane of about the same quality, and the choice was random.

namespace {

constexpr int kPolishSteps = 5;
// The finest threshold tried is an eighth of the fit's: surfaces 24 noise widths apart still fit one wide zone.
static_assert(kScales == 4);
/// Bins per threshold of the height histogram; a threshold of three noise widths gives bins of one.
constexpr std::size_t kBinsPerThreshold = 3;
/// Range of the histogram on either side, in thresholds of the fit.
constexpr std::size_t kReach = 2;
static_assert(2 * kReach * kBinsPerThreshold << (kScales - 1) <= kHeightBinsMax);
/// A gap contains less than this share of the points that an even distribution over the heights would put there.
constexpr double kGapShare = 0.4;
/// ... and the cluster beyond it has at least this share of the points on the near side; flatness measures a bump of
/// five per cent.
constexpr double kHeapShare = 0.1;
/// A rival contains at least this share of the chosen plane's points, and this share outside its zone: a plane through
/// three stray points may run through the chosen plane's zone.
constexpr double kRivalShare = 0.8;
constexpr double kRivalOwnShare = 0.2;
constexpr double kWider = 1.25;
constexpr double kMoveSigmas = 0.1;

/// Refits within `threshold` until the change is negligible.
void polish(const SamplePoints& points, const Vec3& up, double threshold, FlatPlane& plane) {
  for (int i = 0; i < kPolishSteps; ++i) {
    FlatPlane polished = plane;
    Spread spread;
    // The best plane of a set passes through points of it; sums about one of them keep their digits.
    std::size_t near = 0;
    while (near < points.size() && !(std::abs(plane.distance(points[near])) <= threshold)) ++near;
    if (near == points.size()) return;
    PointMoments moments(points[near]);
    if (!refit_within(points, threshold, up, moments, polished, spread)) return;
    if (polished.same_bits(plane)) return;
    plane = polished;
  }
}

/// True if there is a gap with another cluster beyond it, upwards (or downwards) from the plane. `bins` of `width`
/// count the points by height, with the plane in the middle; `gap` is its position.
bool gap_on_side(std::span<const std::uint32_t> all_bins, bool upward, double width, double& gap) {
  std::array<double, kHeightBinsMax / 2> bins{};
  const std::size_t count = all_bins.size() / 2;
  double behind = 0.0;
  for (std::size_t k = 0; k < count; ++k) {
    const std::uint32_t up = all_bins[count + k];
    const std::uint32_t down = all_bins[count - 1 - k];
    bins[k] = upward ? up : down;
    behind += upward ? down : up;
  }
  const auto begin = bins.begin();
  const auto edge = begin + static_cast<std::ptrdiff_t>(std::min(count, kBinsPerThreshold));
  const auto end = begin + static_cast<std::ptrdiff_t>(count);
  const auto peak = std::max_element(edge, end);
  if (peak == end) return false;
  const auto valley = std::min_element(edge, peak + 1);
  double below = 0.0;
  for (auto bin = begin; bin < valley; ++bin) below += *bin;
  double beyond = 0.0;
  for (auto bin = valley; bin < end; ++bin) beyond += *bin;
  double between = below;
  for (auto bin = valley; bin <= peak; ++bin) between += *bin;
  // The counts scatter by their square roots; the upper limit for an empty bin is three.
  const double at_most = *valley + 3.0 * std::sqrt(*valley) + 3.0;
  const double even = between / static_cast<double>(peak - begin + 1);
  gap = width * (static_cast<double>(valley - begin) + 0.5);
  const bool thins_out = at_most < kGapShare * even;
  const bool rises_again = *peak > 2.0 * at_most;
  return thins_out && rises_again && beyond >= kHeapShare * (behind + below);
}

}  // namespace

bool find_level(const PlaneSample& sample, const PlaneSearch& search, double reach, Residuals& scratch,
                FlatPlane& level, double& threshold) {
  const SamplePoints points = sample.all();
  std::array<FlatPlane, kScales> best;
  if (!best_within_scales(sample, search, reach, best)) return false;
  for (std::size_t scale = 0; scale < kScales; ++scale) {
    const double t = reach / static_cast<double>(1U << scale);
    FlatPlane& plane = best[scale];
    polish(sample.preview(), search.up, t, plane);
    std::array<std::uint32_t, kHeightBinsMax> room;
    const std::span<std::uint32_t> bins = std::span(room).first(2 * kReach * kBinsPerThreshold << scale);
    const double width = t / kBinsPerThreshold;
    count_heights(points, plane, width, bins);
    double above = kReach * reach;
    double under = kReach * reach;
    double gap = 0.0;
    bool found = false;
    for (const bool upward : {true, false}) {
      if (!gap_on_side(bins, upward, width, gap)) continue;
      (upward ? above : under) = gap;
      found = true;
    }
    if (!found) continue;
    distances_of(points, plane, scratch);
    const std::span<double> heights = std::span(scratch).first(points.size());
    // The points on this side of the gap give the noise of the level.
    std::size_t near = 0;
    for (const double h : heights)
      if (h < above && h > -under) scratch[near++] = std::abs(h);
    level = plane;
    threshold = std::fmax(3.0 * robust_sigma(std::span(scratch).first(near), 0.5), kThresholdFloor_mm);
    polish(points, search.up, threshold, level);
    return true;
  }
  return false;
}

bool has_rival(const PlaneSample& sample, const PlaneSearch& search, const FlatPlane& plane, double threshold) {
  const SamplePoints points = sample.all();
  const std::size_t within = count_within(points, plane, threshold);
  const double own = static_cast<double>(within);
  if (static_cast<double>(points.size() - within) < kRivalOwnShare * own) return false;
  PlaneSample rest;
  for (std::size_t i = 0; i < points.size(); ++i)
    if (const Vec3 p = points[i]; std::abs(plane.distance(p)) > threshold && p.allFinite()) rest.add(p);
  rest.close();
  FlatPlane rival;
  if (static_cast<double>(rest.size()) < kRivalOwnShare * own) return false;
  if (!best_within(rest, search, threshold, rival)) return false;
  polish(rest.all(), search.up, threshold, rival);
  return static_cast<double>(count_within(rest.all(), rival, threshold)) >= kRivalOwnShare * own &&
         static_cast<double>(count_within(points, rival, threshold)) >= kRivalShare * own;
}

bool bends_with_threshold(const PlaneSample& sample, const FlatPlane& plane, double threshold, const BendLimits& limits,
                          const Vec3& centroid, PlaneShift& bend) {
  const SamplePoints points = sample.all();
  FlatPlane narrow = plane;
  polish(points, plane.n, threshold, narrow);
  FlatPlane wide = plane;
  polish(points, plane.n, kWider * threshold, wide);
  const bool is_small_tilt = limits.tilt_rad > 0.0 && (wide.n - narrow.n).norm() <= limits.tilt_rad;
  if (is_small_tilt && !std::isfinite(limits.move_mm)) return false;
  ScalarMoments moves(0.0);
  ScalarMoments squares(0.0);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vec3 p = points[i];
    const double h = narrow.distance(p);
    if (!(std::abs(h) <= threshold)) continue;
    const double move = wide.distance(p) - h;
    moves.add(move * move);
    squares.add(h * h);
  }
  moves.close_block();
  squares.close_block();
  if (moves.count() < 4) return false;
  // A few points move the plane by chance.
  const double limit = kMoveSigmas + 2.0 / std::sqrt(static_cast<double>(moves.count()));
  const double noise = std::fmax(std::sqrt(squares.mean()), kThresholdFloor_mm);
  const double move_mm = std::sqrt(moves.mean());
  if (!(move_mm > limit * noise)) return false;
  if (!is_small_tilt || move_mm > limits.move_mm) return true;
  bend = {wide.n - narrow.n, narrow.distance(centroid) - wide.distance(centroid)};
  return false;
}

namespace {

/// The table's half lengths: no point of a face is further out.
constexpr double kHalfX = 0.5 * static_cast<double>(limits::kFaceTableX);
constexpr double kHalfV = 0.5 * static_cast<double>(limits::kFaceTableY);

double furthest_between(const LocalPlane& plane, const Tilt& tilt) {
  return std::abs(plane.a0 - static_cast<double>(tilt.a0)) +
         std::abs(plane.a1 - static_cast<double>(tilt.a1)) * kHalfX +
         std::abs(plane.a2 - static_cast<double>(tilt.a2)) * kHalfV;
}

}  // namespace

LocalPlane::LocalPlane(const SeatFrame& frame, const FlatPlane& plane) {
  const double up = plane.n.dot(frame.up);
  a0 = (plane.d - plane.n.dot(frame.origin)) / up;
  a1 = -plane.n.dot(frame.along_rail) / up;
  a2 = -plane.n.dot(frame.along_seat) / up;
  stretch = 1.0 / std::abs(up);
}

void add_tilted(const SeatFrame& frame, const Tilt& tilt, const TiltedSums& sums, PointMoments& moments) {
  // p = origin + a0 up + A (u, v, r), with A = (along_rail + a1 up, along_seat + a2 up, up).
  Mat3 A;
  A.col(0) = frame.along_rail + static_cast<double>(tilt.a1) * frame.up;
  A.col(1) = frame.along_seat + static_cast<double>(tilt.a2) * frame.up;
  A.col(2) = frame.up;
  const Vec3 w = frame.origin + static_cast<double>(tilt.a0) * frame.up - moments.shift();
  const std::array<double, 9>& s = sums.sums;
  Mat3 Q;
  Q << s[3], s[4], s[5], s[4], s[6], s[7], s[5], s[7], s[8];
  const Vec3 linear = A * Vec3(s[0], s[1], s[2]);
  const Vec3 first = linear + sums.count * w;
  const Mat3 second =
      A * Q * A.transpose() + linear * w.transpose() + w * linear.transpose() + sums.count * w * w.transpose();
  moments.add_sums({first.x(), first.y(), first.z(), second(0, 0), second(0, 1), second(0, 2), second(1, 1),
                    second(1, 2), second(2, 2)},
                   static_cast<std::size_t>(sums.count));
}

void add_within(const ListedPoints& points, const FlatPlane& plane, double threshold, PointMoments& moments) {
  const LocalPlane local(points.frame, plane);
  add_tilted(points.frame, Tilt{},
             tilted_sums(points.runs, local.tilt(), static_cast<float>(threshold * local.stretch)), moments);
}

void add_within(const SummedPoints& points, const FlatPlane& plane, double threshold, PointMoments& moments) {
  const LocalPlane local(points.frame, plane);
  // Also true for NaN.
  if (!(furthest_between(local, points.tilt) <= points.slack_mm)) points.asked_beyond = true;
  TiltedSums sums = points.inner;
  const Tilt between{static_cast<float>(local.a0 - static_cast<double>(points.tilt.a0)),
                     static_cast<float>(local.a1 - static_cast<double>(points.tilt.a1)),
                     static_cast<float>(local.a2 - static_cast<double>(points.tilt.a2))};
  sums += tilted_sums(points.edge, between, static_cast<float>(threshold * local.stretch));
  add_tilted(points.frame, points.tilt, sums, moments);
}

}  // namespace slabd::algo
