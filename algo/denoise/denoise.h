// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <span>

#include "algo/algo.h"
#include "base/team.h"

namespace slabd::algo {

/// A plane z over the points of a tile: height at its middle and slopes. NaN if the tile has none.
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
  const std::atomic<bool>* give_up = nullptr;  ///< becomes true when the caller cancels
};

/// Sets noise points to NaN, in place. Noise has no surface through it and is not connected to a long strip of its like
/// (noise_group). A point without z is a missing one; the scan reader already marks points that lack another coordinate
/// (hal/scan/scan_points.h). Fills `counts`. An organised scan (width and height set) is judged by its grid. Any other
/// scan gets its grid back if its rays are evenly spaced; otherwise it is judged by the points' positions in XY. A
/// wrong width and height are removed from `cloud`. The result does not depend on the order. Order, number, width and
/// height stay, unless consecutive points are far apart: with evenly spaced rays, and room for their grid, such a cloud
/// becomes an organised scan (algo/denoise/lattice.h). `order` and `keep` of limits::kScanPointsMax hold every grid.
/// Threads and instruction set do not change the result. False if it gave up, because a scan without surfaces took more
/// point visits than limits::kDenoiseLooksMax, or because of `give_up`. Then the points are unchanged except missing
/// ones, and `counts` is incomplete.
[[nodiscard]] bool remove_isolated(Cloud& cloud, const DenoiseWorkspace& work, Team& team, ScanCounts& counts);

/// Denoises points in any order; see remove_isolated.
[[nodiscard]] bool denoise_cloud(Cloud& cloud, const DenoiseWorkspace& work, ScanCounts& counts);

/// Denoises a scan that lost its grid but not its lattice: its points, in any order, are still on evenly spaced rays,
/// parallel or through the scanner's origin. The same points are kept in any order; unordered points are sorted into
/// the order of the lattice (algo/denoise/lattice.h). `order` and `keep` must hold the lattice
/// (limits::kScanPointsMax is enough for every scan). False if the scan has no such lattice; then no point that has
/// all coordinates is lost.
[[nodiscard]] bool denoise_lattice(Cloud& cloud, const DenoiseWorkspace& memory, Team& team, ScanCounts& counts);

// Connected noise is kept. A fin or a crack two grid lines wide contains less than half of the points around it, so the
// share rule finds no surface, however long and high it is. Outliers are single or in clumps at random heights, so
// groups connected in grid and height are short; damage is long. A leaning or torn object, a wire or a broken edge,
// rises more per point. With a larger step, random groups are longer.

namespace noise_group {

struct Rule {
  /// Rows, columns or pitches from the first to the last of a group, both counted, from which it is damage.
  int length;
  /// Neighbours are connected if their heights differ by at most this.
  float step_mm;
};
/// Applied in this order, each to the remainder of the rules before it, so that an outlier next to a fin does not join
/// the fin.
inline constexpr std::array<Rule, 2> kRules = {{
    // Noise, and the rise within one rough crack: the gate by which a level surface continues (0.6 of 0.6 mm). Clumps
    // of five in a row reach this length only if four of them touch at the same height by chance.
    {16, 0.36F},
    // No edge is torn so high from line to line. A steeper object would be 100 mm high before it is as long.
    {32, 3.0F},
}};

}  // namespace noise_group

}  // namespace slabd::algo
