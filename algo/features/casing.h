// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "algo/features/seat_points.h"
#include "algo/points.h"
#include "base/base.h"

namespace slabd::algo {

/// Nominal data of a casing before it is measured.
struct CasingTask {
  Vec3 centre;  ///< nominal, block frame
  double bore_radius_mm;
  double rim_radius_mm;
  double rim_height_mm;   ///< nominal, along the seat normal
  double edge_margin_mm;  ///< excluded on both sides of the rim when its height is measured
  const PlaneFit& seat;   ///< fitted
};

/// True if the bore was found: the casing has a centre, even if its rim has no height.
[[nodiscard]] inline bool is_located(const CasingFeature& casing) {
  return has_value(casing.radius_mm);
}

/// Bore-edge circle and rim height of one casing from the points around it. `cov_circle` comes from the scatter of the
/// edge points about the circle, with an allowance for rows shared by neighbours. The radius is too large by about a
/// tenth of the point pitch, which the scatter does not show. If part of the edge is hidden, the covariance is larger
/// along that direction. If a part of it is displaced (its distances to the circle are correlated from sector to
/// sector), the covariance is larger along both.
///
/// Not located (no radius, no centre) if less than half of the edge is visible or it is not spread around, the circle
/// is not stable, the radius is off by more than a millimetre, or it contains no hole. Located but not ok if the rim
/// has no valid height: fewer than 200 of its points were seen, most of it is not one plane, it is too tilted, or an
/// object on it is higher than the seat. No heap; 0.2 ms for 25 000 points.
[[nodiscard]] CasingFeature measure_casing(std::span<const SeatPoints> runs, const SeatFrame& frame,
                                           const CasingTask& task);
/// The same from points that are still in the cloud (all of them finite).
[[nodiscard]] CasingFeature measure_casing(const CloudPoints& points, const CasingTask& task);

}  // namespace slabd::algo
