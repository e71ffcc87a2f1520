// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

#include "algo/features/flatness.h"

namespace slabd::algo {

/// The cells of the evaluation region, row by row; a row runs along the rail.
struct CellGrid {
  std::size_t columns = 0;
  std::size_t rows = 0;
  const FlatnessRegion& region;

  explicit CellGrid(const FlatnessRegion& r) : region(r) {
    columns = static_cast<std::size_t>(std::ceil(2.0 * r.half_x_mm / r.cell_mm - 1e-9));
    rows = static_cast<std::size_t>(std::ceil(2.0 * r.half_s_mm / r.cell_mm - 1e-9));
  }
  [[nodiscard]] std::size_t cells() const { return columns * rows; }
  /// Centre of a cell along the rail and along the seat.
  [[nodiscard]] double x_of(std::size_t cell) const {
    return (static_cast<double>(cell % columns) + 0.5) * region.cell_mm - region.half_x_mm;
  }
  [[nodiscard]] double s_of(std::size_t cell) const {
    return (static_cast<double>(cell / columns) + 0.5) * region.cell_mm - region.half_s_mm;
  }
  /// Does all of this cell belong to the region, clear of the casings?
  [[nodiscard]] bool expected(std::size_t cell) const {
    const double half = 0.5 * region.cell_mm;
    const double x = x_of(cell);
    const double s = s_of(cell);
    if (x + half > region.half_x_mm + 1e-9 || s + half > region.half_s_mm + 1e-9) return false;
    if (region.casing_clear_mm <= 0.0) return true;
    constexpr double kSqrtTwo = 1.4142135623730951;
    const double clear = region.casing_clear_mm + kSqrtTwo * half;
    const double beside = std::abs(s) - region.casing_s_mm;
    return x * x + beside * beside > clear * clear;
  }
};

/// What a cell came to.
enum CellMark : std::uint32_t {
  kPlain,     ///< nothing to be said about it
  kMeasured,  ///< has a mean
  kMissing,   ///< not seen
  kHigh,      ///< has a mean above the defect limit
  kLow,       ///< ... below it
};

/// Calls `group(cells)` for every group of cells marked `wanted` that touch, corners included; `cells` holds their
/// numbers. Takes the marks off. `stack`: room for one entry per cell.
template <typename Group>
void for_each_group(const CellGrid& grid, CellMark wanted, std::span<std::uint32_t> mark,
                    std::span<std::uint32_t> stack, const Group& group) {
  for (std::size_t first = 0; first < grid.cells(); ++first) {
    if (mark[first] != wanted) continue;
    std::size_t found = 0;
    // Marks go when a cell is found: each is found once, and the list of them is the queue as well.
    mark[first] = kPlain;
    stack[found++] = static_cast<std::uint32_t>(first);
    for (std::size_t next = 0; next < found; ++next) {
      const std::size_t column = stack[next] % grid.columns;
      const std::size_t row = stack[next] / grid.columns;
      for (std::size_t r = row - std::min<std::size_t>(row, 1); r <= std::min(row + 1, grid.rows - 1); ++r) {
        for (std::size_t c = column - std::min<std::size_t>(column, 1); c <= std::min(column + 1, grid.columns - 1);
             ++c) {
          const std::size_t neighbour = r * grid.columns + c;
          if (mark[neighbour] != wanted) continue;
          mark[neighbour] = kPlain;
          stack[found++] = static_cast<std::uint32_t>(neighbour);
        }
      }
    }
    group(std::span<const std::uint32_t>(stack.first(found)));
  }
}

// The surface that a straightedge or a rail pad feels: pits narrower than it reaches across are bridged, everything
// else stands as it is. A morphological closing from above (ISO 16610-85, flat disc) finds what
// lies below it; but a closing also fills the bottom of wide hollows, by up to a tenth of their depth, and these a
// rail pad does feel. So a sunk place is bridged only if it is compact and the surface around it, continued over it,
// does not lead down into it; then it is as high as that surface, and never higher than the closing.

struct Closing {
  std::size_t pits = 0;  ///< bridged
};

/// A place counts as sunk from `least_mm` on, up to `most_mm` deep, and as compact up to `width_mm` across.
struct PitSize {
  double width_mm;
  double least_mm;
  double most_mm = std::numeric_limits<double>::infinity();
};

/// `cell` and `height` (mm above the fitted seat): the cells that have one, in ascending order. Writes to `closed` what
/// each is as high as. `mark` and `stack`: room for one entry per cell. No heap; 0.3 ms. Of heights with their sign
/// changed it levels bumps.
Closing close_pits(const CellGrid& grid, std::span<const std::uint32_t> cell, std::span<const double> height,
                   const PitSize& size, std::span<std::uint32_t> mark, std::span<std::uint32_t> stack,
                   std::span<double> closed);

}  // namespace slabd::algo
