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

/// Its bore was found: it has a centre, whatever its rim is like.
[[nodiscard]] inline bool is_located(const CasingFeature& casing) {
  return has_value(casing.radius_mm);
}

/// Bore-edge circle and rim height of one casing from the points around it. `cov_circle` comes from the scatter of the
/// edge's own points about the circle, times what rows shared by neighbours add; the radius is large by about a tenth
/// of the point pitch, which no scatter shows. Where part of the edge is hidden, the centre is known less well along
/// that direction and the covariance says so; and where a part of it is moved (its distances to the circle are alike
/// from sector to sector), less well along both.
///
/// Not located (no radius, no centre): less than half of the edge visible or not spread around it, no stable circle, a
/// radius off by more than a millimetre, or no hole in it. Located but not ok: the rim shows no height, since fewer
/// than 200 of its points were seen, it is no plane most of the way round, too tilted, or something on it stands over
/// the seat. No heap; 0.2 ms for 25 000 points.
[[nodiscard]] CasingFeature measure_casing(std::span<const SeatPoints> runs, const SeatFrame& frame,
                                           const CasingTask& task);
/// The same from points that are still in the cloud (all of them finite).
[[nodiscard]] CasingFeature measure_casing(const CloudPoints& points, const CasingTask& task);

}  // namespace slabd::algo
