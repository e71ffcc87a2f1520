// SPDX-License-Identifier: Apache-2.0
//
// Minimum zone of thousands of points, exactly and in fixed memory.
//
// The thinnest zone of any set touches it in three points on one side and one on the other, or in two and two. Of a
// few points it can therefore be found by trying every such contact: the normal is the cross product of two
// connections. The few points that matter are found by cutting planes: solve for the active points, look which points
// of the whole set stick out of that zone most, take them in, repeat. The width for the active points can only be
// too small, the width of the whole set along the found normal only too large: when they meet, both are the answer.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "algo/algo.h"
#include "algo/features/flatness.h"

namespace slabd::algo {
namespace {

/// Ten points start it and two join per pass; flat surfaces end with about eleven.
constexpr std::size_t kActiveMax = 40;

struct Extremes {
  double width = 0.0;
  std::size_t low = 0;
  std::size_t high = 0;
};

Extremes extremes_along(std::span<const Vec3> points, const Vec3& n, const Vec3& origin) {
  Extremes e;
  double low = std::numeric_limits<double>::infinity();
  double high = -low;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double h = n.dot(points[i] - origin);
    if (h < low) {
      low = h;
      e.low = i;
    }
    if (h > high) {
      high = h;
      e.high = i;
    }
  }
  e.width = high - low;
  return e;
}

struct ActiveSet {
  std::array<std::size_t, kActiveMax> index{};
  std::array<Vec3, kActiveMax> points{};
  std::size_t size = 0;

  [[nodiscard]] bool holds(std::size_t i) const {
    return std::find(index.begin(), index.begin() + static_cast<std::ptrdiff_t>(size), i) !=
           index.begin() + static_cast<std::ptrdiff_t>(size);
  }
  /// False when it is full.
  bool add(std::size_t i, const Vec3& p) {
    if (holds(i)) return true;
    if (size == kActiveMax) return false;
    index[size] = i;
    points[size++] = p;
    return true;
  }
};

/// Thinnest zone of the active points by trying every contact: the cross products of all pairs of connections.
double thinnest(const ActiveSet& active, const Vec3& origin, Vec3& normal) {
  const std::span<const Vec3> points(active.points.data(), active.size);
  double best = std::numeric_limits<double>::infinity();
  const std::size_t pairs = active.size * active.size;
  const auto connection = [&](std::size_t pair, Vec3& v) {
    const std::size_t i = pair / active.size;
    const std::size_t j = pair % active.size;
    v = points[j] - points[i];
    return i < j;
  };
  for (std::size_t a = 0; a < pairs; ++a) {
    Vec3 u;
    if (!connection(a, u)) continue;
    for (std::size_t b = a + 1; b < pairs; ++b) {
      Vec3 v;
      if (!connection(b, v)) continue;
      Vec3 n = u.cross(v);
      const double length = n.norm();
      if (!(length > 1e-12 * u.norm() * v.norm())) continue;
      n /= length;
      // Width with early exit, as most contacts lose at once.
      double low = 0.0;
      double high = 0.0;
      for (std::size_t i = 0; i < points.size(); ++i) {
        const double h = n.dot(points[i] - origin);
        if (i == 0) low = high = h;
        low = std::min(low, h);
        high = std::max(high, h);
        if (high - low >= best) break;
      }
      if (high - low < best) {
        best = high - low;
        normal = n;
      }
    }
  }
  return best;
}

}  // namespace

double minimum_zone_mm(std::span<const Vec3> points) {
  if (points.size() < 4) return kNoValue;
  const PlaneFit plane = fit_plane_lsq(points, Vec3::UnitZ());
  if (!plane.ok) return kNoValue;
  const Vec3 origin = points[0];

  // Start: the extremes of the least-squares plane, and of that plane tilted a little in four directions.
  double extent = 0.0;
  for (const Vec3& p : points) extent = std::max(extent, (p - origin).norm());
  const Vec3 u = plane.normal.unitOrthogonal();
  const Vec3 v = plane.normal.cross(u);
  const double tilt = std::max(extremes_along(points, plane.normal, origin).width / extent, 1e-9);
  ActiveSet active;
  for (const Vec3& lean : {Vec3(Vec3::Zero()), Vec3(tilt * u), Vec3(-tilt * u), Vec3(tilt * v), Vec3(-tilt * v)}) {
    const Extremes e = extremes_along(points, (plane.normal + lean).normalized(), origin);
    active.add(e.low, points[e.low]);
    active.add(e.high, points[e.high]);
  }
  // A zone needs four contacts: fill up from the set, whichever points they are.
  for (std::size_t i = 0; i < points.size() && active.size < 4; ++i) active.add(i, points[i]);

  for (;;) {
    Vec3 normal = plane.normal;
    const double small = thinnest(active, origin, normal);
    if (!std::isfinite(small)) return kNoValue;
    const Extremes full = extremes_along(points, normal, origin);
    if (full.width <= small) return small;
    if (active.holds(full.low) && active.holds(full.high)) return full.width;
    if (!active.add(full.low, points[full.low]) || !active.add(full.high, points[full.high])) return kNoValue;
  }
}

}  // namespace slabd::algo
