// SPDX-License-Identifier: Apache-2.0
//
// A second plane, a step, a patch that stands out: their points are not noise, and a threshold learnt from all points
// may be wide enough to take them in. The fit then stands still on a plane that lies between or across the surfaces,
// with a small standard error and a fair share of inliers. Two properties give such a plane away.
//
//   - Measured from the right one of its surfaces, the heights fall into two heaps with a gap between them. Heights of
//     a single surface, bent or not, leave no gap: a bow thins out evenly and even a wave, which dwells at its crests,
//     passes through all heights between. So: look for planes at ever finer thresholds and ask each for a gap.
//   - Wide apart, each surface has its own fixed point. The points outside the winner's threshold then hold a plane
//     about as good, and the winner is the winner by chance.
#include "algo/features/plane_doubts.h"

#include "algo/features/plane_fit.h"
#include "algo/features/plane_lsq.h"

namespace slabd::algo {
namespace {

constexpr int kPolishSteps = 5;
// The finest threshold tried is an eighth of the fit's: surfaces 24 noise widths apart still fit one wide zone.
static_assert(kScales == 4);
/// Bins per threshold of the histogram of heights; a threshold of three noise widths gives bins of one.
constexpr std::size_t kBinsPerThreshold = 3;
/// Heights are looked at up to so many thresholds of the fit on either side.
constexpr std::size_t kReach = 2;
static_assert(2 * kReach * kBinsPerThreshold << (kScales - 1) <= kHeightBinsMax);
/// A gap holds less than this share of what an even spread of the points over the heights would put there.
constexpr double kGapShare = 0.4;
/// ... and the heap beyond it is at least this share of the points on the near side; a bump of five per cent is
/// for the flatness to find.
constexpr double kHeapShare = 0.1;
/// A rival holds at least this share of what the winner holds, and this share outside the winner's zone: a plane
/// through three stray points may well run through the winner's.
constexpr double kRivalShare = 0.8;
constexpr double kRivalOwnShare = 0.2;
constexpr double kWider = 1.25;
constexpr double kMoveSigmas = 0.1;

/// Refits within `threshold` until it hardly matters.
void polish(const SamplePoints& points, const Vec3& up, double threshold, FlatPlane& plane) {
  for (int i = 0; i < kPolishSteps; ++i) {
    FlatPlane polished = plane;
    Spread spread;
    // The best plane of a set passes through points of it; near them the sums keep their digits.
    std::size_t near = 0;
    while (near < points.size() && !(std::abs(plane.distance(points[near])) <= threshold)) ++near;
    if (near == points.size()) return;
    PointMoments moments(points[near]);
    if (!refit_within(points, threshold, up, moments, polished, spread)) return;
    if (polished.same_bits(plane)) return;
    plane = polished;
  }
}

/// Is there a gap with another heap beyond, going up (or down) from the plane? `bins` of `width` hold how many points
/// lie how high, the plane is in their middle; `gap` is where.
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
  // The counts scatter by their roots; the worst case of an empty bin is three.
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
    polish(sample.scouts(), search.up, t, plane);
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
    // What lies on this side of the gap says how noisy the level is.
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

bool bends_with_threshold(const PlaneSample& sample, const FlatPlane& plane, double threshold, double tilt_max_rad) {
  const SamplePoints points = sample.all();
  FlatPlane narrow = plane;
  polish(points, plane.n, threshold, narrow);
  FlatPlane wide = plane;
  polish(points, plane.n, kWider * threshold, wide);
  if ((wide.n - narrow.n).norm() <= tilt_max_rad && tilt_max_rad > 0.0) return false;
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
  // A handful of points moves its plane by chance.
  const double limit = kMoveSigmas + 2.0 / std::sqrt(static_cast<double>(moves.count()));
  const double noise = std::fmax(std::sqrt(squares.mean()), kThresholdFloor_mm);
  return std::sqrt(moves.mean()) > limit * noise;
}

}  // namespace slabd::algo
