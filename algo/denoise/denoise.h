// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <span>

#include "algo/algo.h"
#include "base/team.h"

namespace slabd::algo {

/// A plane z over the points of a tile: height in its middle and rise; NaN where there is none.
struct TilePlane {
  float z;
  float per_column;  ///< mm per grid column, or mm per mm along x
  float per_row;     ///< ... row, or along y
};

/// Memory for `remove_isolated`, owned by the inspector.
struct DenoiseWorkspace {
  std::span<std::uint32_t> order;              ///< >= points
  std::span<std::uint8_t> keep;                ///< >= points
  std::span<std::uint32_t> cell_start;         ///< limits::kDenoiseCellsMax + 1
  std::span<TilePlane> surface;                ///< limits::kDenoiseCellsMax
  const std::atomic<bool>* give_up = nullptr;  ///< becomes true when the caller does not want to wait any longer
};

/// Sets points that no surface goes through, and that hang together with no long strip of their like
/// (algo/denoise/noise_group.h), to NaN, in place. A point without z is a missing one; what lacks another coordinate
/// was made so by whoever read the scan (hal/scan/scan_points.h). Fills `counts`. An organised scan (width and height
/// set) is judged by its grid, any other gets its grid back if its rays are evenly spaced, or is judged by the points'
/// places in XY. A width and height that are not so are taken away from `cloud`. Order decides nothing and stays, with
/// number, width and height, unless consecutive points lie anywhere: with evenly spaced rays, and room for their grid,
/// such a cloud becomes an organised scan (algo/denoise/lattice_order.h). `order` and `keep` of limits::kScanPointsMax
/// hold every grid. Threads and instruction set decide nothing either. False: given up, because a scan in which no
/// surface is found took more looks at its points than limits::kDenoiseLooksMax, or because of `give_up`; the points
/// are as they were but for missing ones, and `counts` is not complete.
[[nodiscard]] bool remove_isolated(Cloud& cloud, const DenoiseWorkspace& work, Team& team, ScanCounts& counts);

}  // namespace slabd::algo
