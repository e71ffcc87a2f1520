// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
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
/// (noise_group), to NaN, in place. A point without z is a missing one; what lacks another coordinate
/// was made so by whoever read the scan (hal/scan/scan_points.h). Fills `counts`. An organised scan (width and height
/// set) is judged by its grid, any other gets its grid back if its rays are evenly spaced, or is judged by the points'
/// places in XY. A width and height that are not so are taken away from `cloud`. Order decides nothing and stays, with
/// number, width and height, unless consecutive points lie anywhere: with evenly spaced rays, and room for their grid,
/// such a cloud becomes an organised scan (algo/denoise/lattice.h). `order` and `keep` of limits::kScanPointsMax
/// hold every grid. Threads and instruction set decide nothing either. False: given up, because a scan in which no
/// surface is found took more looks at its points than limits::kDenoiseLooksMax, or because of `give_up`; the points
/// are as they were but for missing ones, and `counts` is not complete.
[[nodiscard]] bool remove_isolated(Cloud& cloud, const DenoiseWorkspace& work, Team& team, ScanCounts& counts);

/// Denoises points in whatever order they come; see remove_isolated.
[[nodiscard]] bool denoise_cloud(Cloud& cloud, const DenoiseWorkspace& work, ScanCounts& counts);

/// Denoises a scan that has lost its grid but not its lattice: whose points, in whatever order, still lie on evenly
/// spaced rays, parallel or through the scanner's origin. The same points are kept whatever their order; points in no
/// order are brought into that of the lattice (algo/denoise/lattice.h). Needs order and keep as large as the
/// lattice (limits::kScanPointsMax is enough for every scan). False, and no point that has all coordinates lost, when
/// there is no such lattice.
[[nodiscard]] bool denoise_lattice(Cloud& cloud, const DenoiseWorkspace& memory, Team& team, ScanCounts& counts);

// When noise hangs together, it is none. A fin or a crack two grid lines wide holds less than half of what is around
// its points, so no surface goes through them by the rule of shares, however long and high it is. Outliers stand
// alone or in clumps at random heights, and what touches in the grid and in height is never long; damage is. What
// leans or is torn, a wire or a broken edge, rises more from point to point; where it may, chance makes groups longer.

namespace noise_group {

struct Rule {
  /// Rows, columns or pitches from the first to the last of a group, ends counted, from which on it is damage.
  int length;
  /// Neighbours hang together if their heights are so near.
  float step_mm;
};
/// In the order in which they are asked, each of what those before it left: an outlier beside a fin is not a part of
/// it.
inline constexpr std::array<Rule, 2> kRules = {{
    // Noise, and a rise at which a rough crack still is one thing: the gate of a level surface that goes on (0.6 of
    // 0.6 mm). Clumps of five in a row are as long only when four touch that chance has put at the same height.
    {16, 0.36F},
    // So high no edge is torn from line to line; and what stood steeper would be 100 mm high before it is as long.
    {32, 3.0F},
}};

}  // namespace noise_group

}  // namespace slabd::algo
