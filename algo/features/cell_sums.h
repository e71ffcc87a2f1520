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

/// The only pass of flatness over all points: sums per cell.
namespace slabd::algo {

/// Sums of a cell's points. It has its own cache line.
struct alignas(64) CellSum {
  /// Sums of x, s (seat's frame), height above the fitted seat, and squared height (squared in float).
  std::array<double, 4> sums{};
  /// The lowest height, and the negated highest one: one minimum instruction updates both.
  std::array<float, 2> ends = {std::numeric_limits<float>::infinity(), std::numeric_limits<float>::infinity()};
  std::uint32_t points = 0;

  /// For cells examined point by point (seat_cells.cpp): index of the cell's heights, and the range of heights kept.
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

/// Cell layout and reference of the heights, in float. Column of a point: (x + half_x_mm) cells_per_mm, rows alike;
/// points outside belong to the border cells. Cells are numbered row by row.
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

/// Points are processed in groups. Each group stores the range of its cells, so that a later search for the points of a
/// few cells skips most groups: neighbours in the scan are neighbours on the seat.
inline constexpr std::size_t kCellGroup = 64;
struct CellRange {
  std::uint16_t first = 0;
  std::uint16_t last = 0;
};
static_assert(sizeof(CellSum) == 64);
static_assert(limits::kCellGroupsMax * kCellGroup >= limits::kSeatPointsMax);
static_assert(limits::kFlatnessCellsMax < 65'536, "cells are numbered in 16 bits here");

/// Adds `points` to `cells` (columns * rows) and writes the cell range of each kCellGroup points; the last group may be
/// smaller. About 1.1 ns a point.
void add_to_cells(const SeatPoints& points, const CellLayout& layout, std::span<CellSum> cells,
                  std::span<CellRange> ranges);

/// Cell number and height of up to kCellGroup points; both arrays have space for kCellGroup.
void place_in_cells(const SeatPoints& points, const CellLayout& layout, std::span<std::int32_t> cells,
                    std::span<float> heights);

}  // namespace slabd::algo
