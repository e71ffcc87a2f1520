// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

#include "algo/features/cell_grid.h"

/// The surface that a straightedge or a rail pad feels: pits narrower than it reaches across are bridged, everything
/// else stands as it is. A morphological closing from above (ISO 16610-85, flat disc) finds what
/// lies below it; but a closing also fills the bottom of wide hollows, by up to a tenth of their depth, and these a
/// rail pad does feel. So a sunk place is bridged only if it is compact and the surface around it, continued over it,
/// does not lead down into it; then it is as high as that surface, and never higher than the closing.
namespace slabd::algo {

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
