// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

#include "algo/features/seat_points.h"
#include "base/limits.h"

/// The one pass of flatness over all points: what each cell's points add up to.
namespace slabd::algo {

/// What the points of a cell add up to. A cache line of its own.
struct alignas(64) CellSum {
  /// Sums: of places in the seat's frame, of heights above the fitted seat, of the squares of these (taken in float).
  std::array<double, 4> sums{};
  /// The lowest height, and the highest one with its sign changed: one minimum serves both.
  std::array<float, 2> ends = {std::numeric_limits<float>::infinity(), std::numeric_limits<float>::infinity()};
  std::uint32_t points = 0;

  /// Where seat_cells.cpp keeps the heights of a cell whose single points it looks at, and which of them it keeps.
  static constexpr std::uint32_t kNowhere = 0xffff'ffff;
  std::uint32_t heights_at = kNowhere;
  std::uint32_t heights = 0;
  float keep_low = 0.0F;
  float keep_high = 0.0F;

  [[nodiscard]] double x() const { return sums[0]; }
  [[nodiscard]] double s() const { return sums[1]; }
  [[nodiscard]] double height() const { return sums[2]; }
  [[nodiscard]] double squares() const { return sums[3]; }
  [[nodiscard]] float low() const { return ends[0]; }
  [[nodiscard]] float high() const { return -ends[1]; }

  void add(float x_mm, float s_mm, float h_mm) {
    const std::array<float, 4> terms = {x_mm, s_mm, h_mm, h_mm * h_mm};
    for (std::size_t k = 0; k < terms.size(); ++k) sums[k] += static_cast<double>(terms[k]);
    ends[0] = std::min(ends[0], h_mm);
    ends[1] = std::min(ends[1], -h_mm);
    ++points;
  }
  void add(const CellSum& other) {
    for (std::size_t k = 0; k < sums.size(); ++k) sums[k] += other.sums[k];
    for (std::size_t k = 0; k < ends.size(); ++k) ends[k] = std::min(ends[k], other.ends[k]);
    points += other.points;
  }
};

/// Where the cells are and what height is measured from; all of it in float. Column of a place:
/// (x + half_x_mm) cells_per_mm, rows alike; places outside count to the border. Cells are numbered row by row.
struct CellLayout {
  float half_x_mm = 0.0F;
  float half_s_mm = 0.0F;
  float cells_per_mm = 1.0F;
  std::int32_t columns = 0;
  std::int32_t rows = 0;
  /// Height above the fitted seat: by_x x + by_s s + by_h h + offset.
  float by_x = 0.0F;
  float by_s = 0.0F;
  float by_h = 1.0F;
  float offset_mm = 0.0F;
};

/// Points are taken in groups; each remembers which cells it saw, so that whoever looks for the points of a few cells
/// later can leave most groups out: neighbours in the scan are neighbours on the seat.
inline constexpr std::size_t kCellGroup = 64;
struct CellRange {
  std::uint16_t first = 0;
  std::uint16_t last = 0;
};
static_assert(sizeof(CellSum) == 64);
static_assert(limits::kCellGroupsMax * kCellGroup >= limits::kSeatPointsMax);
static_assert(limits::kFlatnessCellsMax < 65'536, "cells are numbered in 16 bits here");

/// Adds `points` to `cells` (columns * rows of them) and writes the range of each kCellGroup of them, the last one
/// perhaps smaller. About 1.1 ns a point.
void add_to_cells(const SeatPoints& points, const CellLayout& layout, std::span<CellSum> cells,
                  std::span<CellRange> ranges);

/// Cell number and height of up to kCellGroup points; both arrays have room for kCellGroup.
void place_in_cells(const SeatPoints& points, const CellLayout& layout, std::span<std::int32_t> cells,
                    std::span<float> heights);

}  // namespace slabd::algo
