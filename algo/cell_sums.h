// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

#include "algo/seat_points.h"
#include "base/limits.h"

/// The one pass of flatness over all points: what each cell's points add up to.
namespace slabd::algo {

/// What the points of a cell add up to. A cache line of its own.
struct alignas(64) CellSum {
  double x = 0.0;  ///< sums, of places in the seat's frame ...
  double s = 0.0;
  double height = 0.0;   ///< ... of heights above the fitted seat ...
  double squares = 0.0;  ///< ... and of their squares
  float low = std::numeric_limits<float>::infinity();
  float high = -std::numeric_limits<float>::infinity();
  std::uint32_t points = 0;

  /// Where flatness.cpp keeps the heights of a cell whose single points it looks at, and which of them it keeps.
  static constexpr std::uint32_t kNowhere = 0xffff'ffff;
  std::uint32_t heights_at = kNowhere;
  std::uint32_t heights = 0;
  float keep_low = 0.0F;
  float keep_high = 0.0F;

  void add(float x_mm, float s_mm, float h_mm) {
    const auto h = static_cast<double>(h_mm);
    x += static_cast<double>(x_mm);
    s += static_cast<double>(s_mm);
    height += h;
    squares += h * h;
    low = std::min(low, h_mm);
    high = std::max(high, h_mm);
    ++points;
  }
  void add(const CellSum& other) {
    x += other.x;
    s += other.s;
    height += other.height;
    squares += other.squares;
    low = std::min(low, other.low);
    high = std::max(high, other.high);
    points += other.points;
  }
};

/// Where the cells are and what height is measured from. Plain and sixteen-lane code do the same float operations.
struct CellLayout {
  float half_x_mm = 0.0F;
  float half_s_mm = 0.0F;
  float cell_mm = 1.0F;
  std::int32_t columns = 0;
  std::int32_t rows = 0;
  /// Height above the fitted seat: by_x x + by_s s + by_h h + offset.
  float by_x = 0.0F;
  float by_s = 0.0F;
  float by_h = 1.0F;
  float offset_mm = 0.0F;

  /// The cell of a place; places outside count to the border.
  [[nodiscard]] std::size_t cell(float x, float s) const {
    const float column = std::min(std::max((x + half_x_mm) / cell_mm, 0.0F), static_cast<float>(columns - 1));
    const float row = std::min(std::max((s + half_s_mm) / cell_mm, 0.0F), static_cast<float>(rows - 1));
    return static_cast<std::size_t>(static_cast<std::int32_t>(row) * columns + static_cast<std::int32_t>(column));
  }
  [[nodiscard]] float height(float x, float s, float h) const { return by_x * x + by_s * s + by_h * h + offset_mm; }
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
/// perhaps smaller. About 1.3 ns a point.
void add_to_cells(const SeatPoints& points, const CellLayout& layout, std::span<CellSum> cells,
                  std::span<CellRange> ranges);

/// Cell number and height of up to kCellGroup points; both arrays have room for kCellGroup.
void place_in_cells(const SeatPoints& points, const CellLayout& layout, std::span<std::int32_t> cells,
                    std::span<float> heights);

}  // namespace slabd::algo
