// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

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

/// Bore-edge circle and rim height of one casing from the points around it. ok = false: less than two thirds of the
/// edge visible, no stable circle, a radius off by more than a millimetre, or fewer than 200 points on the rim.
[[nodiscard]] CasingFeature measure_casing(const CloudPoints& points, const CasingTask& task);

}  // namespace slabd::algo
