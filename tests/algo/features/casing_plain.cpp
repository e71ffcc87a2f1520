// SPDX-License-Identifier: Apache-2.0
//
// A casing with an arctangent for every point in every round; the method is described in algo/features/casing.cpp.
#include "plain_features.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "algo/features/casing_fits.h"
#include "algo/median.h"

namespace slabd::algo::plain {
namespace {

constexpr std::size_t kSectors = limits::kRimSectors;
constexpr std::size_t kSectorsMin = kSectors / 2;
/// Spread of the edge's directions: half of the edge in one piece has 0.095; below this one axis of the centre is too
/// uncertain.
constexpr double kSpreadMin = 0.09;
/// The innermost points depend on the centre of the sectors; this many rounds are enough to converge.
constexpr int kRounds = 6;
/// Search range for innermost points around the nominal bore radius.
constexpr double kSearch_mm = 2.5;
/// ... and around the nominal rim height.
constexpr double kHeightGate_mm = 1.5;
/// The scale is at least a few hundredths; otherwise a regular point pattern would decide which points are outliers.
constexpr CircleWeights kEdgeWeights = {.scale_min = 0.02, .outside_weight = 0.1};
/// Neighbouring sectors share the scanner's rows, so their gaps are not independent; figures in
/// algo/features/casing.cpp.
constexpr double kEdgeVariance = 1.3;
double shared_rows(double spread) {
  return kEdgeVariance * std::sqrt(std::sqrt(0.5 / spread));
}
/// Distances of near points to the circle are correlated by chance up to this many times 1/sqrt(n) of their variance,
/// and surely displaced from kFormSure times that.
constexpr double kFormChance = 1.4;
constexpr double kFormSure = 1.5;
constexpr double kFormVariance = 4.0;
/// Distances are clipped at this many times the scatter; below kFormMin_mm the scatter is ignored.
constexpr double kFormAlike = 0.7;
constexpr double kFormReach = 3.0;
constexpr double kFormMin_mm = 0.03;
constexpr double kRadiusOffMax_mm = 1.0;
constexpr std::uint32_t kRimPointsMin = 200;
constexpr double kRimShareMin = 0.8;
/// Standard deviation of the rim beyond that of the seat.
constexpr double kRimFormMax_mm = 0.15;
/// The usable rim ends this far inside its nominal edge.
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

/// True if the density of points in the bore at or above rim height is low relative to the rim.
bool is_hole(const CloudPoints& cloud, const CasingTask& task, const CasingFrame& frame, const Circle& circle) {
  const double inside_mm = task.bore_radius_mm - kSearch_mm;
  const double around_mm = task.bore_radius_mm + kSearch_mm;
  double inside = 0.0;
  double around = 0.0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (frame.height(cloud[i]) < task.rim_height_mm - kHeightGate_mm) continue;
    const double r = (frame.in_plane(cloud[i]) - circle.centre).norm();
    if (r < inside_mm) inside += 1.0;
    if (r >= around_mm && r < task.rim_radius_mm) around += 1.0;
  }
  const double rim_mm2 = task.rim_radius_mm * task.rim_radius_mm - around_mm * around_mm;
  return inside / (inside_mm * inside_mm) <= 0.2 * around / rim_mm2;
}

/// Height of the rim around the measured centre, clear of its inner and outer edge. False if it is not valid for the
/// whole rim. rim_height() computes it from the points and has tests of its own.
bool measure_rim(const CloudPoints& cloud, const CasingTask& task, const CasingFrame& frame, const Vec2& centre,
                 CasingFeature& casing) {
  const double width = task.rim_radius_mm - task.bore_radius_mm;
  const double margin = std::min(task.edge_margin_mm, 0.25 * width);
  const double inner = task.bore_radius_mm + margin;
  const double outer = task.rim_radius_mm - margin;
  std::vector<RimPoint> on_rim;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec2 out = frame.in_plane(cloud[i]) - centre;
    if (out.norm() >= inner && out.norm() < outer)
      on_rim.push_back(
          {static_cast<float>(out.x()), static_cast<float>(out.y()), static_cast<float>(frame.height(cloud[i]))});
  }
  if (on_rim.size() < kRimPointsMin) return false;
  const RimHeight rim = rim_height(on_rim);
  casing.rim_points = static_cast<std::uint32_t>(rim.points);
  if (!rim.ok) return false;
  casing.height_mm = rim.height_mm;
  casing.rim_std_mm = rim.std_mm;
  casing.sigma_height_mm = rim.sigma_mm;
  const double seat_mm = has_value(task.seat.std_mm) ? task.seat.std_mm : 0.0;
  const double over_mm = std::max(rim.height_mm, 0.0) + std::max(4.0 * seat_mm, kRimFormMax_mm);
  // Parts higher than the seat at either edge, by points and by eighths of the ring with equal weights.
  struct Lip {
    double all = 0.0;
    double over = 0.0;
  };
  std::array<Lip, 2> edges;
  std::array<std::array<Lip, 8>, 2> eighths;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec2 out = frame.in_plane(cloud[i]) - centre;
    const double r = out.norm();
    const bool at_bore = r >= task.bore_radius_mm - kRadiusOffMax_mm && r < inner;
    if (!at_bore && !(r >= outer && r < task.rim_radius_mm)) continue;
    const std::size_t where = at_bore ? 0 : 1;
    const auto eighth = std::min(static_cast<std::size_t>((std::atan2(out.y(), out.x()) + kPi) / (0.25 * kPi)), 7UL);
    const double over = frame.height(cloud[i]) >= over_mm ? 1.0 : 0.0;
    for (Lip* lip : {&edges[where], &eighths[where][eighth]}) {
      lip->all += 1.0;
      lip->over += over;
    }
  }
  for (std::size_t where = 0; where < 2; ++where) {
    if (edges[where].over > 0.2 * edges[where].all) return false;
    double seen = 0.0;
    double share = 0.0;
    for (const Lip& lip : eighths[where]) {
      if (lip.all < 4.0) continue;
      seen += 1.0;
      share += lip.over / lip.all;
    }
    if (seen > 0.0 && share / seen > 0.2) return false;
  }
  return rim.crust_mm == 0.0 && casing.rim_points >= kRimPointsMin && rim.share_seen >= 0.5 && rim.share_on >= 0.6 &&
         rim.share_below <= 0.1 && rim.share_points >= kRimShareMin && rim.tilt * task.rim_radius_mm <= 0.25 &&
         rim.std_mm <= std::hypot(seat_mm, kRimFormMax_mm);
}

/// Variance of the centre from displacement of a part of the edge: the part of the distances shared by neighbours.
double edge_form_mm2(const std::vector<Vec2>& edge, const Circle& circle) {
  if (!(circle.scatter > kFormMin_mm)) return 0.0;
  std::vector<double> off;
  for (const Vec2& p : edge) off.push_back((p - circle.centre).norm() - circle.radius);
  const auto n = static_cast<double>(off.size());
  std::vector<double> sorted = off;
  const double mean = median_of(sorted);
  const auto clamped = [&](double reach_mm) {
    std::vector<double> to(off.size());
    for (std::size_t i = 0; i < off.size(); ++i)
      to[i] = std::clamp(off[i] - mean, -reach_mm, std::min(reach_mm, circle.scatter));
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
  if (own == 0.0) return 0.0;
  const double in_chances = 0.5 * (next + next_but_one) / own * std::sqrt(n) / kFormChance;
  const double belief = std::min(1.0, std::max(0.0, (in_chances - 1.0) / (kFormSure - 1.0)));
  return belief * kFormVariance * moved / n;
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
    circle = fit_circle_robust(edge.view(), centre, kEdgeWeights);  // has a test of its own
    casing.inlier_fraction = circle.weight / static_cast<double>(kSectors);
    if (!circle.ok || circle.weight < 0.4 * static_cast<double>(kSectors) || circle.spread < kSpreadMin) return casing;
  }
  if (std::abs(circle.radius - task.bore_radius_mm) > kRadiusOffMax_mm || !is_hole(points, task, frame, circle))
    return casing;
  casing.centre = frame.in_block(circle.centre);
  casing.radius_mm = circle.radius;
  casing.edge_rms_mm = circle.scatter;
  casing.cov_circle = shared_rows(circle.spread) * circle.covariance;
  const double form = edge_form_mm2(edge_points, circle);
  for (const int axis : {0, 1}) casing.cov_circle(axis, axis) += form;
  casing.ok = measure_rim(points, task, frame, circle.centre, casing);
  return casing;
}

}  // namespace slabd::algo::plain
