// SPDX-License-Identifier: Apache-2.0
//
// Points around a casing one by one, with an arctangent for each.
#include <algorithm>
#include <cmath>

#include "plain_kernels.h"

namespace slabd::algo::plain {

RingPoint in_ring(const CasingAxes& axes, const CasingRing& ring, float x, float s, float h) {
  const float dx = x - axes.x_mm;
  const float ds = s - axes.s_mm;
  const auto along = [&](const std::array<float, 3>& axis) { return axis[0] * dx + axis[1] * ds + axis[2] * h; };
  RingPoint point;
  point.x = along(axes.across) - ring.centre_x_mm;
  point.y = along(axes.along) - ring.centre_y_mm;
  point.height = along(axes.up) + axes.up_mm;
  point.radius2 = point.x * point.x + point.y * point.y;
  point.in = point.radius2 >= ring.inner_mm * ring.inner_mm && point.radius2 < ring.outer_mm * ring.outer_mm &&
             point.height >= ring.low_mm && point.height <= ring.high_mm;
  return point;
}

double turn_in_sectors(const RingPoint& point) {
  const double turn = std::atan2(static_cast<double>(point.y), static_cast<double>(point.x)) / (2.0 * kPi);
  return static_cast<double>(limits::kRimSectors) * (turn < 0.0 ? turn + 1.0 : turn);
}

void find_innermost(const SeatPoints& points, const CasingAxes& axes, const CasingRing& ring, Innermost& innermost) {
  for (std::size_t i = 0; i < points.size(); ++i) {
    const RingPoint point = in_ring(axes, ring, points.x[i], points.s[i], points.h[i]);
    if (!point.in) continue;
    const std::size_t sector = std::min(static_cast<std::size_t>(turn_in_sectors(point)), limits::kRimSectors - 1);
    if (point.radius2 >= innermost.radius2[sector]) continue;
    innermost.radius2[sector] = point.radius2;
    innermost.x[sector] = point.x + ring.centre_x_mm;
    innermost.y[sector] = point.y + ring.centre_y_mm;
  }
}

std::vector<float> heights_in_ring(const SeatPoints& points, const CasingAxes& axes, const CasingRing& ring) {
  std::vector<float> heights;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const RingPoint point = in_ring(axes, ring, points.x[i], points.s[i], points.h[i]);
    if (point.in) heights.push_back(point.height);
  }
  return heights;
}

}  // namespace slabd::algo::plain
