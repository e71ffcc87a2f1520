// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "algo/algo.h"

namespace slabd::algo {

/// The surface in one cell: height at level cells, slope at tilted ones, NaN where there is none.
struct CellSurface {
  float level_mm;
  float slope_x;
  float slope_y;
};

/// Memory for `remove_isolated`, owned by the inspector.
struct DenoiseWorkspace {
  std::span<std::uint32_t> order;       ///< >= points
  std::span<std::uint8_t> keep;         ///< >= points
  std::span<std::uint32_t> cell_start;  ///< limits::kDenoiseCellsMax + 1
  std::span<CellSurface> surface;       ///< limits::kDenoiseCellsMax
};

/// Drops points that are not finite and points that no surface goes through; compacts `cloud` in place, order kept.
/// Fills `counts`. The same points are kept in whatever order they come. O(points), 100 ns each at most on scans; a
/// cloud made to be slow is bounded by O(1024 * points).
void remove_isolated(Cloud& cloud, const DenoiseWorkspace& work, ScanCounts& counts);

}  // namespace slabd::algo
