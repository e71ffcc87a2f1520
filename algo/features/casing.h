// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "algo/features/seat_points.h"
#include "algo/points.h"
#include "base/base.h"

namespace slabd::algo {

/// What is known about a casing before it is measured.
struct CasingTask {
  Vec3 centre;  ///< nominal, block frame
  double bore_radius_mm;
  double rim_radius_mm;
  double rim_height_mm;   ///< nominal, along the seat normal
  double edge_margin_mm;  ///< kept clear on both sides of the rim where its height is taken
  const PlaneFit& seat;   ///< fitted
};

/// Bore-edge circle and rim height of one casing from the points around it. `cov_circle` comes from the scatter of the
/// edge's own points about the circle, times what rows shared by neighbours add; the radius is large by about a tenth
/// of the point pitch, which no scatter shows. ok = false: less than half of the edge visible or not spread around it,
/// no stable circle, a radius off by more than a millimetre, or fewer than 200 points on the rim. Where part of the
/// edge is hidden, the centre is known less well along that direction and the covariance says so; and where a part of
/// it is moved (its distances to the circle are alike from sector to sector), less well along both. No heap; 0.13 ms
/// for 25 000 points.
[[nodiscard]] CasingFeature measure_casing(std::span<const SeatPoints> runs, const SeatFrame& frame,
                                           const CasingTask& task);
/// The same from points that are still in the cloud (all of them finite).
[[nodiscard]] CasingFeature measure_casing(const CloudPoints& points, const CasingTask& task);

}  // namespace slabd::algo
