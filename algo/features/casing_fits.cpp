// SPDX-License-Identifier: Apache-2.0
//
// Geometric circle fit: minimises the squared distances to the circle. The three unknowns enter almost linearly once
// the centre is known to a fraction of the radius, so Gauss-Newton needs few steps. Algebraic fits need no start, but
// are biased if only part of the circle is seen.
#include "algo/features/casing_fits.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "algo/median.h"
#include "base/base.h"

namespace slabd::algo {
namespace {

constexpr int kSteps = 60;
constexpr std::size_t kPointsMax = 512;

double tukey(double r, double c) {
  const double u = r / c;
  if (!(std::abs(u) < 1.0)) return 0.0;
  return (1.0 - u * u) * (1.0 - u * u);
}

double mean_radius(std::span<const Vec2> points, const Vec2& centre) {
  double sum = 0.0;
  for (const Vec2& p : points) sum += (p - centre).norm();
  return sum / static_cast<double>(points.size());
}

double median_radius(std::span<const Vec2> points, const Vec2& centre) {
  std::array<double, kPointsMax> r;
  for (std::size_t i = 0; i < points.size(); ++i) r[i] = (points[i] - centre).norm();
  return median_of(std::span(r).first(points.size()));
}

/// Standard deviation estimated from the median distance to the circle.
double scale_of(std::span<const Vec2> points, const Circle& circle) {
  std::array<double, kPointsMax> r;
  for (std::size_t i = 0; i < points.size(); ++i) r[i] = std::abs((points[i] - circle.centre).norm() - circle.radius);
  return 1.4826 * median_of(std::span(r).first(points.size()));
}

/// A point relative to the circle: unit vector from the centre, distance to the circle, and weights. False for a point
/// at the centre, which has no direction.
struct Sight {
  double x;
  double y;
  double off;
  double agreement;  ///< Tukey weight
  double weight;     ///< ... times the factor for its side
};
bool look(const Vec2& p, double cut, double outside_weight, const Circle& circle, Sight& sight) {
  const double x = p.x() - circle.centre.x();
  const double y = p.y() - circle.centre.y();
  const double r = std::sqrt(x * x + y * y);
  if (!(r > 0.0)) return false;
  sight.x = x / r;
  sight.y = y / r;
  sight.off = r - circle.radius;
  sight.agreement = cut > 0.0 ? tukey(sight.off, cut) : 1.0;
  sight.weight = sight.off > 0.0 ? outside_weight * sight.agreement : sight.agreement;
  return true;
}

/// Normal equations of one weighted Gauss-Newton step: H = sum w j j^T, g = sum w e j with j = -(x, y, 1).
struct Normal {
  Eigen::Matrix3d H = Eigen::Matrix3d::Zero();
  Eigen::Vector3d g = Eigen::Vector3d::Zero();
  double weight = 0.0;
  double weighted_squares = 0.0;
  double agreeing = 0.0;
};

Normal normal_at(std::span<const Vec2> points, double cut, double outside_weight, const Circle& circle) {
  double xx = 0.0, xy = 0.0, yy = 0.0, x = 0.0, y = 0.0, ex = 0.0, ey = 0.0, e = 0.0;
  Normal sum;
  for (const Vec2& p : points) {
    Sight s;
    if (!look(p, cut, outside_weight, circle, s)) continue;
    const double wx = s.weight * s.x;
    const double wy = s.weight * s.y;
    xx += wx * s.x;
    xy += wx * s.y;
    yy += wy * s.y;
    x += wx;
    y += wy;
    ex += wx * s.off;
    ey += wy * s.off;
    e += s.weight * s.off;
    sum.weight += s.weight;
    sum.weighted_squares += s.weight * s.off * s.off;
    sum.agreeing += s.agreement;
  }
  sum.H << xx, xy, x, xy, yy, y, x, y, sum.weight;
  sum.g << -ex, -ey, -e;
  return sum;
}

/// Makes one step. Returns its length, negative if the points do not determine a circle.
double step(std::span<const Vec2> points, double cut, double outside_weight, Circle& circle) {
  const Normal sum = normal_at(points, cut, outside_weight, circle);
  circle.weight = sum.agreeing;
  if (!(sum.agreeing >= 3.0)) return -1.0;
  circle.rms = std::sqrt(sum.weighted_squares / sum.weight);
  // A short arc determines neither centre nor radius; relative to the weights the determinant is then nearly zero.
  const Eigen::Matrix3d unit = sum.H / sum.weight;
  if (!(unit.determinant() > 1e-9)) return -1.0;
  const Eigen::Vector3d delta = -unit.ldlt().solve(Eigen::Vector3d(sum.g / sum.weight));
  if (!delta.allFinite()) return -1.0;
  circle.centre += Vec2(delta[0], delta[1]);
  circle.radius += delta[2];
  return delta.norm();
}

/// Computes the quality figures of the finished fit.
void state_quality(std::span<const Vec2> points, double cut, double outside_weight, Circle& circle) {
  const Normal sum = normal_at(points, cut, outside_weight, circle);
  Eigen::Matrix3d psi = Eigen::Matrix3d::Zero();  // sum of squared weighted distances
  Eigen::Matrix2d around = Eigen::Matrix2d::Zero();
  Eigen::Vector2d aside = Eigen::Vector2d::Zero();
  double squares = 0.0;
  for (const Vec2& p : points) {
    Sight s;
    if (!look(p, cut, outside_weight, circle, s)) continue;
    const Eigen::Vector2d u(s.x, s.y);
    const Eigen::Vector3d j(-s.x, -s.y, -1.0);
    psi += s.weight * s.weight * s.off * s.off * j * j.transpose();
    around += s.agreement * u * u.transpose();
    aside += s.agreement * u;
    squares += s.agreement * s.off * s.off;
  }
  circle.scatter = std::sqrt(squares / sum.agreeing);
  // Smallest variance of the unit vectors towards the points, over all directions.
  const Eigen::Matrix2d v = around / sum.agreeing - (aside / sum.agreeing) * (aside / sum.agreeing).transpose();
  const double half_trace = 0.5 * (v(0, 0) + v(1, 1));
  circle.spread = half_trace - std::hypot(0.5 * (v(0, 0) - v(1, 1)), v(0, 1));
  if (!(sum.agreeing > 3.0)) return;
  const Eigen::Matrix3d inverse = sum.H.inverse();
  circle.covariance = inverse * psi * inverse * (sum.agreeing / (sum.agreeing - 3.0));
}

}  // namespace

Circle fit_circle(std::span<const Vec2> points, const Vec2& start) {
  Circle circle;
  circle.centre = start;
  if (points.size() < 3) return circle;
  circle.radius = mean_radius(points, start);
  for (int i = 0; i < kSteps; ++i) {
    const double moved = step(points, 0.0, 1.0, circle);
    if (moved < 0.0) return circle;
    if (moved <= 1e-12 * (circle.radius + circle.centre.norm())) {
      circle.ok = circle.radius > 0.0;
      state_quality(points, 0.0, 1.0, circle);
      return circle;
    }
  }
  return circle;
}

Circle fit_circle_robust(std::span<const Vec2> points, const Vec2& start, const CircleWeights& weights) {
  Circle circle;
  circle.centre = start;
  if (points.size() < 3 || points.size() > kPointsMax) return circle;
  circle.radius = median_radius(points, start);
  double cut = 0.0;
  for (int i = 0; i < kSteps; ++i) {
    // The scale follows the fit for some steps and is then fixed, so that the steps converge.
    const double old_cut = cut;
    if (i < 20) cut = 4.685 * std::max(scale_of(points, circle), weights.scale_min);
    const double moved = step(points, cut, weights.outside_weight, circle);
    if (moved < 0.0) return circle;
    // If neither the circle nor the scale changes, all further steps are the same.
    const bool at_rest = i >= 20 ? moved <= 1e-9 : moved <= 1e-12 && cut == old_cut;
    if (at_rest) {
      circle.ok = circle.radius > 0.0;
      state_quality(points, cut, weights.outside_weight, circle);
      return circle;
    }
  }
  return circle;
}

namespace {

constexpr std::size_t kSectors = kRimHeightSectors;
/// A sector with fewer points is ignored.
constexpr std::size_t kSectorPointsMin = 4;
/// Maximum number of a sector's points for its median.
constexpr std::size_t kSectorSample = 256;
/// A sector is on the plane if it is within this ...
constexpr double kOn_mm = 0.04;
/// ... or within this many standard deviations of its median.
constexpr double kOnSigmas = 4.0;
/// Cost of a sector below the plane, relative to one above it.
constexpr double kBelowCost = 3.0;
/// Steeper planes are not tried, because the rim is then refused anyway.
constexpr double kTiltMax = 0.02;
constexpr int kRounds = 8;
/// Points are on the plane within this many of their own robust deviations.
constexpr double kReachSigmas = 4.0;
constexpr double kReachMin_mm = 1e-3;
/// Three of four neighbouring sectors (14 mm of the ring) that are this far above the plane, and kCrust_mm above the
/// seat, are a crust that supports a rail pad. A grain of sand or a burr is in only one or two of them. Mortar is
/// rough, and the pad rests on its higher parts: the height of a sector is that of its highest quarter.
constexpr double kOverPlane_mm = 0.1;
constexpr double kCrust_mm = 0.05;
constexpr std::size_t kCrustSectors = 3;
constexpr std::size_t kCrustWindow = 4;
constexpr double kMedianSigma = 1.2533;    ///< standard error of a median over that of a mean
constexpr double kQuartileSigma = 1.3626;  ///< ... and of a quartile
constexpr double kQuartile = 0.6745;       ///< upper quartile of normal noise, in standard deviations from its mean

/// Statistics of a sector's points.
struct Sector {
  std::size_t points = 0;
  double x = 0.0;  ///< mean position
  double y = 0.0;
  double median = 0.0;
  double upper = 0.0;  ///< upper quartile
  double sigma = 0.0;  ///< of the median, from the scatter of the points
  [[nodiscard]] bool seen() const { return points >= kSectorPointsMin; }
};

struct RimPlane {
  Vec3 a = Vec3::Zero();  ///< height = a0 + a1 x + a2 y
  [[nodiscard]] double at(double x, double y) const { return a[0] + a[1] * x + a[2] * y; }
  [[nodiscard]] double over(const Sector& s) const { return s.median - at(s.x, s.y); }
};

/// Number of a point's sector, without an arctangent, whose last bit differs between processors: the octant, and four
/// sectors in each by the ratio of the coordinates (tangents of 11.25, 22.5 and 33.75 degrees).
std::size_t sector_of(const RimPoint& p) {
  static_assert(kSectors == 32);
  const float x = std::abs(p.x);
  const float y = std::abs(p.y);
  const bool steep = y > x;
  const float ratio = (steep ? x : y) / std::max(steep ? y : x, std::numeric_limits<float>::min());
  const std::size_t k =
      (ratio > 0.198912367F ? 1U : 0U) + (ratio > 0.414213562F ? 1U : 0U) + (ratio > 0.668178638F ? 1U : 0U);
  const std::size_t quarter = steep ? 7 - k : k;
  if (p.y >= 0.0F) return p.x >= 0.0F ? quarter : 15 - quarter;
  return p.x >= 0.0F ? 31 - quarter : 16 + quarter;
}

std::array<Sector, kSectors> sectors_of(std::span<const RimPoint> points) {
  std::array<Sector, kSectors> sectors{};
  for (const RimPoint& p : points) {
    Sector& s = sectors[sector_of(p)];
    ++s.points;
    s.x += static_cast<double>(p.x);
    s.y += static_cast<double>(p.y);
  }
  std::array<std::array<double, kSectorSample>, kSectors> heights;
  std::array<std::size_t, kSectors> number{};
  std::array<std::size_t, kSectors> taken{};
  for (const RimPoint& p : points) {
    const std::size_t k = sector_of(p);
    const std::size_t every = 1 + sectors[k].points / kSectorSample;
    if (number[k]++ % every == 0 && taken[k] < kSectorSample) heights[k][taken[k]++] = static_cast<double>(p.height);
  }
  for (std::size_t k = 0; k < kSectors; ++k) {
    Sector& s = sectors[k];
    if (!s.seen()) continue;
    const auto n = static_cast<double>(s.points);
    s.x /= n;
    s.y /= n;
    const std::span<double> own(heights[k].data(), taken[k]);
    s.median = median_of(own);
    const auto quarter = own.begin() + static_cast<std::ptrdiff_t>(3 * taken[k] / 4);
    std::nth_element(own.begin(), quarter, own.end());
    s.upper = *quarter;
    for (double& h : own) h = std::abs(h - s.median);
    s.sigma = kMedianSigma * 1.4826 * median_of(own) / std::sqrt(static_cast<double>(taken[k]));
  }
  return sectors;
}

/// Flags of the sectors on the plane, by sector number.
using OnPlane = std::array<bool, kSectors>;

/// Least squares through the sectors `on`, and the variance of its height at the axis for sector heights of variance 1.
/// False if the sectors are so close together that they do not determine a tilt.
bool fit_sectors(const std::array<Sector, kSectors>& sectors, const OnPlane& on, RimPlane& plane, double& at_axis) {
  Mat3 A = Mat3::Zero();
  Vec3 b = Vec3::Zero();
  for (std::size_t k = 0; k < kSectors; ++k) {
    if (!on[k]) continue;
    const Vec3 j(1.0, sectors[k].x, sectors[k].y);
    A += j * j.transpose();
    b += sectors[k].median * j;
  }
  const Eigen::LDLT<Eigen::Matrix3d> solver(A);
  if (solver.info() != Eigen::Success || !solver.isPositive() || !(solver.rcond() > 1e-6)) return false;
  plane.a = solver.solve(b);
  at_axis = solver.solve(Eigen::Vector3d::UnitX())[0];
  return plane.a.allFinite() && at_axis > 0.0;
}

/// Largest distance of a sector on the plane.
double reach_of(const Sector& s) {
  return std::max(kOn_mm, kOnSigmas * s.sigma);
}

/// Cost of a plane: the sum of the sectors' deviations.
double cost_of(const RimPlane& plane, std::span<const Sector* const> seen) {
  double cost = 0.0;
  for (const Sector* s : seen) {
    const double off = plane.over(*s) / reach_of(*s);
    cost += std::abs(off) <= 1.0 ? off * off : off > 0.0 ? 1.0 : kBelowCost;
  }
  return cost;
}

/// The best of the level planes through each sector and of the planes through three sectors about 120 degrees apart.
/// Any object on a rim makes a step in it, which a fit to all sectors would follow by a tilt.
RimPlane lowest_plane(std::span<const Sector* const> seen) {
  RimPlane best;
  double best_cost = std::numeric_limits<double>::infinity();
  const auto ask = [&](const RimPlane& plane) {
    if (!plane.a.allFinite() || std::hypot(plane.a[1], plane.a[2]) > kTiltMax) return;
    if (const double cost = cost_of(plane, seen); cost < best_cost) {
      best_cost = cost;
      best = plane;
    }
  };
  const std::size_t n = seen.size();
  for (std::size_t i = 0; i < n; ++i) {
    ask({Vec3(seen[i]->median, 0.0, 0.0)});
    for (std::size_t j = n / 4; j <= n / 2; j += 2)
      for (std::size_t k = j + n / 4; k <= 3 * n / 4; k += 2) {
        const std::array<const Sector*, 3> three = {seen[i], seen[(i + j) % n], seen[(i + k) % n]};
        Eigen::Matrix3d A;
        Eigen::Vector3d b;
        for (int row = 0; row < 3; ++row) {
          const Sector& s = *three[static_cast<std::size_t>(row)];
          A.row(row) << 1.0, s.x, s.y;
          b[row] = s.median;
        }
        if (std::abs(A.determinant()) < 1.0) continue;
        ask({Vec3(A.inverse() * b)});
      }
  }
  return best;
}

/// The largest height of kCrustSectors of kCrustWindow neighbouring sectors above the seat, if they are a crust; else
/// 0. `std_mm`: noise of the rim's points, which raises an upper quartile by itself.
double crust_of(const std::array<Sector, kSectors>& sectors, const RimPlane& plane, double std_mm) {
  std::array<double, kSectors> stands{};
  for (std::size_t k = 0; k < kSectors; ++k) {
    const Sector& s = sectors[k];
    if (!s.seen()) continue;
    const double upper = s.upper - kQuartile * std_mm;
    const double sigma = kQuartileSigma * std_mm / std::sqrt(static_cast<double>(std::min(s.points, kSectorSample)));
    if (upper - plane.at(s.x, s.y) > kOverPlane_mm && upper > kCrust_mm + 3.0 * sigma) stands[k] = upper;
  }
  double crust_mm = 0.0;
  for (std::size_t k = 0; k < kSectors; ++k) {
    std::array<double, kCrustWindow> window{};
    for (std::size_t i = 0; i < kCrustWindow; ++i) window[i] = stands[(k + i) % kSectors];
    std::sort(window.begin(), window.end());
    crust_mm = std::max(crust_mm, window[kCrustWindow - kCrustSectors]);
  }
  return crust_mm;
}

/// Sectors relative to the rim's plane.
struct SectorsOnPlane {
  double on = 0.0;
  double below = 0.0;
  double squares = 0.0;  ///< of the distances of those on it
};

SectorsOnPlane compare(const std::array<Sector, kSectors>& sectors, const RimPlane& plane, const OnPlane& on) {
  SectorsOnPlane result;
  for (std::size_t k = 0; k < kSectors; ++k) {
    const Sector& s = sectors[k];
    if (!s.seen()) continue;
    const double over = plane.over(s);
    if (on[k]) {
      result.on += 1.0;
      result.squares += over * over;
    } else if (over < 0.0) {
      result.below += 1.0;
    }
  }
  return result;
}

/// The rim's points relative to its plane.
struct PointsOnPlane {
  double asked = 0.0;  ///< points of sectors on the plane
  double n = 0.0;      ///< of these, near it
  double used = 0.0;   ///< sectors with such points
  double mean = 0.0;   ///< sum over sectors of their mean
  double scatter = 0.0;
  double white = 0.0;  ///< sum over sectors of 1 / points
};

/// Equal weight per area, so that a dark part of a rim counts fully. No value if no point was sampled.
std::optional<PointsOnPlane> average(std::span<const RimPoint> points, const RimPlane& plane, const OnPlane& on) {
  const auto off = [&](const RimPoint& p) {
    return static_cast<double>(p.height) - plane.at(static_cast<double>(p.x), static_cast<double>(p.y));
  };
  std::array<double, 4096> sample;
  std::size_t sampled = 0;
  const std::size_t every = 1 + points.size() / sample.size();
  for (std::size_t i = 0; i < points.size(); i += every)
    if (on[sector_of(points[i])]) sample[sampled++] = std::abs(off(points[i]));
  if (sampled == 0) return std::nullopt;
  const double reach_mm = std::max(kReachSigmas * 1.4826 * median_of(std::span(sample).first(sampled)), kReachMin_mm);

  std::array<double, kSectors> sum{};
  std::array<double, kSectors> sum2{};
  std::array<double, kSectors> count{};
  PointsOnPlane result;
  for (const RimPoint& p : points) {
    const std::size_t k = sector_of(p);
    if (!on[k]) continue;
    result.asked += 1.0;
    const double h = off(p);
    if (!(std::abs(h) <= reach_mm)) continue;
    count[k] += 1.0;
    sum[k] += h;
    sum2[k] += h * h;
  }
  for (std::size_t k = 0; k < kSectors; ++k) {
    if (count[k] == 0.0) continue;
    result.used += 1.0;
    result.n += count[k];
    result.mean += sum[k] / count[k];
    result.scatter += sum2[k];
    result.white += 1.0 / count[k];
  }
  return result;
}

}  // namespace

RimHeight rim_height(std::span<const RimPoint> points) {
  RimHeight rim;
  const std::array<Sector, kSectors> sectors = sectors_of(points);
  std::array<const Sector*, kSectors> of_seen{};
  std::size_t seen = 0;
  for (const Sector& s : sectors)
    if (s.seen()) of_seen[seen++] = &s;
  rim.share_seen = static_cast<double>(seen) / static_cast<double>(kSectors);
  if (seen < kSectors / 4) return rim;

  RimPlane plane = lowest_plane(std::span(of_seen).first(seen));
  OnPlane on{};
  double at_axis = 0.0;
  for (int round = 0; round < kRounds; ++round) {
    OnPlane now{};
    for (std::size_t k = 0; k < kSectors; ++k)
      now[k] = sectors[k].seen() && std::abs(plane.over(sectors[k])) <= reach_of(sectors[k]);
    if (now == on) break;
    on = now;
    if (!fit_sectors(sectors, on, plane, at_axis)) return rim;
  }

  const SectorsOnPlane fit = compare(sectors, plane, on);
  const auto all = static_cast<double>(seen);
  rim.share_on = fit.on / all;
  rim.share_below = fit.below / all;
  rim.tilt = std::hypot(plane.a[1], plane.a[2]);
  if (fit.on < 4.0) return rim;

  const std::optional<PointsOnPlane> near = average(points, plane, on);
  if (!near || !(near->n > 3.0)) return rim;
  rim.share_points = near->n / near->asked;
  rim.points = static_cast<std::size_t>(near->n);
  rim.height_mm = plane.a[0] + near->mean / near->used;
  rim.std_mm = std::sqrt(near->scatter / near->n);
  rim.crust_mm = crust_of(sectors, plane, rim.std_mm);
  // Noise of a mean over sectors; if a part of the ring is not on the plane, the tilt also contributes at the axis.
  const double lever = at_axis * fit.on;
  const double noise2 = lever * rim.std_mm * rim.std_mm * near->white / (near->used * near->used);
  // Form: deviation of the sectors from the plane beyond their noise; two neighbours are correlated.
  double by_noise2 = 0.0;
  for (std::size_t k = 0; k < kSectors; ++k)
    if (on[k]) by_noise2 += sectors[k].sigma * sectors[k].sigma;
  const double form2 = 2.0 * std::max(fit.squares - by_noise2, 0.0) / std::max(fit.on - 3.0, 1.0) * at_axis;
  // The edge of a crust is too thin to be distinguished from the rim.
  const double edge_mm = 0.5 * kOn_mm * std::max(0.0, 1.0 - rim.share_on - rim.share_below) / std::sqrt(3.0);
  rim.sigma_mm = std::sqrt(noise2 + form2 + edge_mm * edge_mm);
  rim.ok = true;
  return rim;
}

}  // namespace slabd::algo
