// SPDX-License-Identifier: Apache-2.0
//
// A casing with an arctangent for every point in every round; the method stands in algo/features/casing.cpp.
#include "plain_features.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "algo/features/circle.h"
#include "algo/moments.h"

namespace slabd::algo::plain {
namespace {

constexpr std::size_t kSectors = limits::kRimSectors;
constexpr std::size_t kSectorsMin = kSectors / 2;
/// Half of the edge in one piece spreads its directions by 0.095; less fixes the centre too poorly along one axis.
constexpr double kSpreadMin = 0.09;
/// The innermost points depend on the centre the sectors are drawn around; this many rounds settle it.
constexpr int kRounds = 6;
/// Innermost points are looked for this far around the nominal bore radius.
constexpr double kSearch_mm = 2.5;
/// ... and this far off the nominal rim height.
constexpr double kHeightGate_mm = 1.5;
/// Scale: never sharper than a few hundredths, or a regular point pattern would decide who is an outlier.
constexpr CircleWeights kEdgeWeights = {.scale_min = 0.02, .outside_weight = 0.1};
/// Neighbouring sectors share the scanner's rows, so their gaps are not independent as the circle's covariance takes
/// them to be. Over 400 phases and turns of the point pattern each, at pitches of 0.2 to 0.5 mm, even, jittered or
/// stretched, with a tenth of the points missing, the true variance of the centre is 0.95 to 1.7 times the independent
/// one, and up to 2.1 times when half of the edge is hidden.
constexpr double kEdgeVariance = 1.3;
double shared_rows(double spread) {
  return kEdgeVariance * std::sqrt(std::sqrt(0.5 / spread));
}
/// Distances of near points to the circle are alike by chance up to this many times 1/sqrt(n) of their variance.
constexpr double kFormChance = 1.4;
constexpr double kFormVariance = 4.0;
/// Beyond so many times the scatter a point says no more, and with less scatter than this nothing is said.
constexpr double kFormAlike = 0.7;
constexpr double kFormReach = 3.0;
constexpr double kFormMin_mm = 0.03;
constexpr double kRadiusOffMax_mm = 1.0;
constexpr std::uint32_t kRimPointsMin = 200;
/// So many of the points over the rim must be near its median height; as for planes.
constexpr double kRimShareMin = 0.8;
/// Standard deviation of the rim beyond that of the seat.
constexpr double kRimFormMax_mm = 0.15;
constexpr std::size_t kHeightSample = 4096;
/// The rim ends this far inside its nominal edge.
constexpr double kRimEdge_mm = 0.5;

/// Plane coordinates around the nominal centre: x along the rail, s across, height above the fitted seat.
class CasingFrame {
 public:
  explicit CasingFrame(const CasingTask& task) : n_(task.seat.normal), offset_(task.seat.offset_mm) {
    origin_ = task.centre - (n_.dot(task.centre) - offset_) * n_;
    ex_ = (Vec3::UnitX() - n_.x() * n_).normalized();
    es_ = n_.cross(ex_);
  }
  [[nodiscard]] Vec2 in_plane(const Vec3& p) const { return {ex_.dot(p - origin_), es_.dot(p - origin_)}; }
  [[nodiscard]] double height(const Vec3& p) const { return n_.dot(p) - offset_; }
  [[nodiscard]] Vec3 in_block(const Vec2& q) const { return origin_ + q.x() * ex_ + q.y() * es_; }

 private:
  Vec3 n_;
  double offset_;
  Vec3 origin_;
  Vec3 ex_;
  Vec3 es_;
};

struct EdgePoints {
  std::array<Vec2, kSectors> points;
  std::size_t size = 0;
  [[nodiscard]] std::span<const Vec2> view() const { return {points.data(), size}; }
};

/// The innermost point of each sector around `centre`.
EdgePoints innermost(const CloudPoints& cloud, const CasingTask& task, const CasingFrame& frame, const Vec2& centre) {
  constexpr double kPerRad = static_cast<double>(kSectors) / (2.0 * kPi);
  std::array<double, kSectors> radius;
  std::array<Vec2, kSectors> point;
  const double outermost = std::min(task.bore_radius_mm + kSearch_mm, task.rim_radius_mm - kRimEdge_mm);
  radius.fill(outermost);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3 p = cloud[i];
    const Vec2 q = frame.in_plane(p);
    const Vec2 out = q - centre;
    const double r = out.norm();
    if (r >= outermost || r < task.bore_radius_mm - kSearch_mm) continue;
    if (std::abs(frame.height(p) - task.rim_height_mm) > kHeightGate_mm) continue;
    const auto sector =
        std::min(static_cast<std::size_t>((std::atan2(out.y(), out.x()) + kPi) * kPerRad), kSectors - 1);
    if (r >= radius[sector]) continue;
    radius[sector] = r;
    point[sector] = q;
  }
  EdgePoints edge;
  for (std::size_t k = 0; k < kSectors; ++k)
    if (radius[k] < outermost) edge.points[edge.size++] = point[k];
  return edge;
}

/// Robust mean height of the rim around the measured centre, clear of its inner and outer edge. False where it is no
/// height of all of the rim.
bool measure_rim(const CloudPoints& cloud, const CasingTask& task, const CasingFrame& frame, const Vec2& centre,
                 CasingFeature& casing) {
  const double width = task.rim_radius_mm - task.bore_radius_mm;
  const double margin = std::min(task.edge_margin_mm, 0.25 * width);
  const double inner = task.bore_radius_mm + margin;
  const double outer = task.rim_radius_mm - margin;
  const auto on_rim = [&](std::size_t i, double& height) {
    const Vec3 p = cloud[i];
    const double r = (frame.in_plane(p) - centre).norm();
    height = frame.height(p);
    return r >= inner && r <= outer;
  };

  std::uint32_t count = 0;
  double height = 0.0;
  for (std::size_t i = 0; i < cloud.size(); ++i)
    if (on_rim(i, height)) ++count;
  if (count < kRimPointsMin) return false;
  const std::uint32_t every = 1 + count / static_cast<std::uint32_t>(kHeightSample);
  std::array<double, kHeightSample> sample;
  std::size_t sampled = 0;
  std::uint32_t seen = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i)
    if (on_rim(i, height) && seen++ % every == 0 && sampled < sample.size()) sample[sampled++] = height;
  const auto end = sample.begin() + static_cast<std::ptrdiff_t>(sampled);
  const auto middle = sample.begin() + static_cast<std::ptrdiff_t>(sampled / 2);
  std::nth_element(sample.begin(), middle, end);
  const double median = *middle;
  for (std::size_t i = 0; i < sampled; ++i) sample[i] = std::abs(sample[i] - median);
  std::nth_element(sample.begin(), middle, end);
  const double reach = std::max(4.0 * 1.4826 * *middle, 1e-3);

  ScalarMoments heights(median);
  std::array<bool, kSectors> seen_there{};
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (!on_rim(i, height) || std::abs(height - median) > reach) continue;
    heights.add(height);
    const Vec2 out = frame.in_plane(cloud[i]) - centre;
    const double turn = (std::atan2(out.y(), out.x()) + kPi) / (2.0 * kPi);
    seen_there[std::min(static_cast<std::size_t>(turn * static_cast<double>(kSectors)), kSectors - 1)] = true;
  }
  heights.close_block();
  casing.rim_points = static_cast<std::uint32_t>(heights.count());
  casing.height_mm = heights.mean();
  casing.rim_std_mm = std::sqrt(heights.variance(1));
  casing.sigma_height_mm = casing.rim_std_mm / std::sqrt(static_cast<double>(heights.count()));
  const double seat_mm = has_value(task.seat.std_mm) ? task.seat.std_mm : 0.0;
  const double over_mm = std::max(median, 0.0) + std::max(4.0 * seat_mm, kRimFormMax_mm);
  // The same by eighths of the ring, each counting alike: on the rim, at the bore's edge and at the rim's.
  std::array<std::array<double, 8>, 3> all_by_eighth{};
  std::array<std::array<double, 8>, 3> in_by_eighth{};
  std::vector<ScalarMoments> rim_by_eighth(8, ScalarMoments(median));
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec2 out = frame.in_plane(cloud[i]) - centre;
    const double r = out.norm();
    if (r < task.bore_radius_mm - kRadiusOffMax_mm || r >= task.rim_radius_mm) continue;
    const std::size_t where = r < inner ? 1 : r > outer ? 2 : 0;
    const auto eighth = std::min(static_cast<std::size_t>((std::atan2(out.y(), out.x()) + kPi) / (0.25 * kPi)), 7UL);
    const double h = frame.height(cloud[i]);
    all_by_eighth[where][eighth] += 1.0;
    if (where == 0 ? std::abs(h - median) <= reach : h >= over_mm) in_by_eighth[where][eighth] += 1.0;
    if (where == 0 && std::abs(h - median) <= reach) rim_by_eighth[eighth].add(h);
  }
  const auto share_of = [&](std::size_t where) {
    double eighths = 0.0;
    double share = 0.0;
    for (std::size_t k = 0; k < 8; ++k) {
      if (all_by_eighth[where][k] < 4.0) continue;
      eighths += 1.0;
      share += in_by_eighth[where][k] / all_by_eighth[where][k];
    }
    return eighths > 0.0 ? share / eighths : 0.0;
  };
  // The mean and scatter that the rim has if areas weigh.
  double eighths = 0.0;
  double by_area = 0.0;
  double squares = 0.0;
  double in_all = 0.0;
  for (ScalarMoments& eighth : rim_by_eighth) {
    eighth.close_block();
    if (eighth.count() < 4) continue;
    const double off = eighth.mean() - heights.mean();
    eighths += 1.0;
    in_all += static_cast<double>(eighth.count());
    by_area += off;
    squares += off * off + eighth.variance(0);
  }
  by_area /= eighths;
  double variance = 0.0;
  for (const ScalarMoments& eighth : rim_by_eighth) {
    const auto n = static_cast<double>(eighth.count());
    if (n >= 4.0) variance += (1.0 / eighths - n / in_all) * (1.0 / eighths - n / in_all) / n;
  }
  if (std::abs(by_area) > 4.0 * casing.rim_std_mm * std::sqrt(variance)) casing.height_mm += by_area;
  const double by_area_std = std::sqrt(squares / eighths - by_area * by_area);
  if (by_area_std > std::hypot(seat_mm, kRimFormMax_mm)) return false;
  if (share_of(0) < kRimShareMin || share_of(1) > 1.0 - kRimShareMin || share_of(2) > 1.0 - kRimShareMin) return false;
  std::array<double, 2> at_edge{};
  std::array<double, 2> lip{};
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const double r = (frame.in_plane(cloud[i]) - centre).norm();
    const bool at_bore = r >= task.bore_radius_mm - kRadiusOffMax_mm && r < inner;
    if (!at_bore && !(r > outer && r < task.rim_radius_mm)) continue;
    at_edge[at_bore ? 0 : 1] += 1.0;
    lip[at_bore ? 0 : 1] += frame.height(cloud[i]) >= over_mm ? 1.0 : 0.0;
  }
  for (std::size_t k = 0; k < 2; ++k)
    if (lip[k] > (1.0 - kRimShareMin) * at_edge[k]) return false;
  return casing.rim_points >= kRimPointsMin && casing.rim_std_mm <= std::hypot(seat_mm, kRimFormMax_mm) &&
         static_cast<std::size_t>(std::count(seen_there.begin(), seen_there.end(), true)) >= kSectorsMin &&
         static_cast<double>(heights.count()) >= kRimShareMin * static_cast<double>(count);
}

/// Variance of the centre by what moves a part of the edge: what neighbours' distances to the circle share.
double edge_form_mm2(const std::vector<Vec2>& edge, const Circle& circle) {
  if (!(circle.scatter > kFormMin_mm)) return 0.0;
  std::vector<double> off;
  for (const Vec2& p : edge) off.push_back((p - circle.centre).norm() - circle.radius);
  const auto n = static_cast<double>(off.size());
  double mean = 0.0;
  for (const double o : off) mean += o / n;
  const auto clamped = [&](double reach_mm) {
    std::vector<double> to(off.size());
    for (std::size_t i = 0; i < off.size(); ++i) to[i] = std::clamp(off[i] - mean, -reach_mm, reach_mm);
    return to;
  };
  std::vector<double> lean = clamped(kFormAlike * circle.scatter);
  double middle = 0.0;
  for (const double l : lean) middle += l / n;
  for (double& l : lean) l -= middle;
  double own = 0.0;
  double next = 0.0;
  double next_but_one = 0.0;
  const std::size_t count = lean.size();
  for (std::size_t i = 0; i < count; ++i) {
    own += lean[i] * lean[i];
    next += lean[i] * lean[i + 1 < count ? i + 1 : 0];
    next_but_one += lean[i] * lean[i + 2 < count ? i + 2 : i + 2 - count];
  }
  double moved = 0.0;
  for (const double m : clamped(kFormReach * circle.scatter)) moved += m * m;
  return 0.5 * (next + next_but_one) > kFormChance / std::sqrt(n) * own ? kFormVariance * moved / n : 0.0;
}

}  // namespace

CasingFeature measure_casing(const CloudPoints& points, const CasingTask& task) {
  CasingFeature casing;
  const CasingFrame frame(task);
  Circle circle;
  std::vector<Vec2> edge_points;
  for (int round = 0; round < kRounds; ++round) {
    const Vec2 centre = circle.ok ? circle.centre : Vec2(Vec2::Zero());
    const EdgePoints edge = innermost(points, task, frame, centre);
    casing.edge_points = static_cast<std::uint32_t>(edge.size);
    edge_points.assign(edge.view().begin(), edge.view().end());
    if (edge.size < kSectorsMin) return casing;
    circle = plain::fit_circle_robust(edge.view(), centre, kEdgeWeights);
    casing.inlier_fraction = circle.weight / static_cast<double>(kSectors);
    if (!circle.ok || circle.weight < 0.4 * static_cast<double>(kSectors) || circle.spread < kSpreadMin) return casing;
  }
  casing.centre = frame.in_block(circle.centre);
  casing.radius_mm = circle.radius;
  casing.edge_rms_mm = circle.scatter;
  casing.cov_circle = shared_rows(circle.spread) * circle.covariance;
  const double form = edge_form_mm2(edge_points, circle);
  for (const int axis : {0, 1}) casing.cov_circle(axis, axis) += form;
  if (std::abs(circle.radius - task.bore_radius_mm) > kRadiusOffMax_mm) return casing;
  casing.ok = measure_rim(points, task, frame, circle.centre, casing);
  return casing;
}

}  // namespace slabd::algo::plain
