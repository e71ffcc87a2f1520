// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "algo/face_points.h"
#include "algo/moments.h"
#include "algo/plane_zone.h"

/// The passes over listed points written down as they are meant: one point after the other. Where floats decide which
/// points count they are the same floats as algo's, so that the same points count to the last one; what is summed up
/// is summed up in double.
namespace slabd::algo::plain {

// ---- algo/plane_zone.h ---------------------------------------------------------------------------------------------

struct ZoneSums {
  TiltedSums sums;
  std::array<double, 9> sizes{};  ///< of what was summed up, whatever its sign: for what rounding may do
};
[[nodiscard]] ZoneSums tilted_sums(std::span<const SeatPoints> runs, const Tilt& tilt, float within_mm);

/// What ZonedPoints, sorted around `sorted_around`, says of `plane`.
[[nodiscard]] PointMoments zoned_within(const ListedPoints& points, const FlatPlane& sorted_around,
                                        const FlatPlane& plane, double threshold);

}  // namespace slabd::algo::plain
