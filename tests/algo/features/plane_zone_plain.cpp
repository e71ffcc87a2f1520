// SPDX-License-Identifier: Apache-2.0
//
// Points within a distance of a plane, one by one; the zone is described in algo/features/plane_zone.
#include <cmath>

#include "plain_kernels.h"

namespace slabd::algo::plain {
namespace {

/// Half width of the zone in which points are kept, relative to the threshold.
constexpr double kEdgeShare = 1.0 / 12.0;

float above(const Tilt& tilt, float u, float v, float h) {
  return h - tilt.a0 - tilt.a1 * u - tilt.a2 * v;
}

}  // namespace

ZoneSums tilted_sums(std::span<const SeatPoints> runs, const Tilt& tilt, float within_mm) {
  ZoneSums found;
  for (const SeatPoints& run : runs) {
    for (std::size_t i = 0; i < run.size(); ++i) {
      if (!(std::abs(above(tilt, run.x[i], run.s[i], run.h[i])) <= within_mm)) continue;
      const auto u = static_cast<double>(run.x[i]);
      const auto v = static_cast<double>(run.s[i]);
      const auto h = static_cast<double>(run.h[i]);
      const std::array<double, 9> terms = {u, v, h, u * u, u * v, u * h, v * v, v * h, h * h};
      found.sums.count += 1.0;
      for (std::size_t k = 0; k < terms.size(); ++k) {
        found.sums.sums[k] += terms[k];
        found.sizes[k] += std::abs(terms[k]);
      }
    }
  }
  return found;
}

PointMoments zoned_within(const ListedPoints& points, const FlatPlane& sorted_around, const FlatPlane& plane,
                          double threshold) {
  const LocalPlane around(points.frame, sorted_around);
  const Tilt tilt = around.tilt();
  const auto surely_in_mm = static_cast<float>((1.0 - kEdgeShare) * threshold * around.stretch);
  const auto perhaps_in_mm = static_cast<float>((1.0 + kEdgeShare) * threshold * around.stretch);
  const LocalPlane asked(points.frame, plane);
  const Tilt between = {static_cast<float>(asked.a0 - static_cast<double>(tilt.a0)),
                        static_cast<float>(asked.a1 - static_cast<double>(tilt.a1)),
                        static_cast<float>(asked.a2 - static_cast<double>(tilt.a2))};
  const auto within_mm = static_cast<float>(threshold * asked.stretch);

  PointMoments moments(points.frame.origin);
  for (const SeatPoints& run : points.runs) {
    for (std::size_t i = 0; i < run.size(); ++i) {
      const float r = above(tilt, run.x[i], run.s[i], run.h[i]);
      const bool surely = std::abs(r) <= surely_in_mm;
      const bool perhaps = std::abs(r) <= perhaps_in_mm && std::abs(above(between, run.x[i], run.s[i], r)) <= within_mm;
      if (surely || perhaps)
        moments.add(points.frame.in_block(static_cast<double>(run.x[i]), static_cast<double>(run.s[i]),
                                          static_cast<double>(run.h[i])));
    }
  }
  moments.close_block();
  return moments;
}

}  // namespace slabd::algo::plain
