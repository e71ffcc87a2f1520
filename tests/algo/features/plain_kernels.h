// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "algo/features/casing_points.h"
#include "algo/features/cell_sums.h"
#include "algo/features/face_points.h"
#include "algo/features/plane_zone.h"
#include "algo/moments.h"

/// The passes over listed points by definition: one point after the other. Where floats decide which points
/// count they are the same floats as in algo, so that exactly the same points count; the sums are in
/// double.
namespace slabd::algo::plain {

// ---- algo/features/plane_zone.h
// ---------------------------------------------------------------------------------------------

struct ZoneSums {
  TiltedSums sums;
  std::array<double, 9> sizes{};  ///< sums of absolute values, for the rounding tolerance
};
[[nodiscard]] ZoneSums tilted_sums(std::span<const SeatPoints> runs, const Tilt& tilt, float within_mm);

/// Moments of `plane` by ZonedPoints sorted around `sorted_around`.
[[nodiscard]] PointMoments zoned_within(const ListedPoints& points, const FlatPlane& sorted_around,
                                        const FlatPlane& plane, double threshold);

// ---- algo/features/cell_sums.h
// ----------------------------------------------------------------------------------------------

struct PlainCell {
  std::array<double, 4> sums{};   ///< of positions, heights and their squares
  std::array<double, 4> sizes{};  ///< sums of absolute values
  float low = std::numeric_limits<float>::infinity();
  float high = -std::numeric_limits<float>::infinity();
  std::uint32_t points = 0;
};
/// The cell of a position; positions outside belong to the border.
[[nodiscard]] std::int32_t cell_of(const CellLayout& layout, float x, float s);
[[nodiscard]] float height_in_cell(const CellLayout& layout, float x, float s, float h);
void add_to_cells(const SeatPoints& points, const CellLayout& layout, std::span<PlainCell> cells,
                  std::span<CellRange> ranges);

// ---- algo/features/casing_points.h
// ------------------------------------------------------------------------------------------

/// A point in the casing's frame, x and y from the ring's centre.
struct RingPoint {
  float x = 0.0F, y = 0.0F, height = 0.0F, radius2 = 0.0F;
  bool in = false;
};
[[nodiscard]] RingPoint in_ring(const CasingAxes& axes, const CasingRing& ring, float x, float s, float h);
/// Direction anticlockwise from the x axis, 0 <= turn < 48.
[[nodiscard]] double turn_in_sectors(const RingPoint& point);
void find_innermost(const SeatPoints& points, const CasingAxes& axes, const CasingRing& ring, Innermost& innermost);
[[nodiscard]] std::vector<float> heights_in_ring(const SeatPoints& points, const CasingAxes& axes,
                                                 const CasingRing& ring);

}  // namespace slabd::algo::plain
