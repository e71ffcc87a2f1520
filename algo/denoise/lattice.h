// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "algo/algo.h"
#include "base/team.h"

namespace slabd::algo {

/// Evenly spaced rays of a scan's points: parallel ones over x and y, or central ones from the origin over x / z and y
/// / z. Column of a point: floor((x or x / z - x0) * per_x); rows alike.
struct Lattice {
  bool central = false;
  float x0 = 0.0F, y0 = 0.0F;
  float per_x = 1.0F, per_y = 1.0F;
  float columns = 0.0F,
        rows = 0.0F;     ///< whole tiles of algo/denoise/denoise_grid.h; columns * rows <= limits::kScanPointsMax
  float away_mm = 1.0F;  ///< distance at which columns are away_mm / per_x apart

  [[nodiscard]] bool operator==(const Lattice&) const = default;
};

/// Maximum shares, one in N, of points outside the table and of points in a cell with a lower one.
inline constexpr std::uint64_t kOutsideShare = 2'000;
inline constexpr std::uint64_t kMetShare = 100;

/// Floats of memory for finding a lattice.
inline constexpr std::size_t kLatticeSampleMax = 1U << 14U;
inline constexpr std::size_t kLatticeFloats = 7 * kLatticeSampleMax;

/// Finds the lattice of a scan. The result does not depend on the order of the points. False if the scan has none.
/// `memory`: kLatticeFloats. One pass over the points.
[[nodiscard]] bool find_lattice(const Cloud& cloud, std::span<float> memory, Team& team, Lattice& lattice);

/// Memory for `order_points`. The arrays should begin on a cache line; otherwise it is slower.
struct OrderMemory {
  std::array<std::span<float>, 3> points;  ///< for slightly more than half of the cloud in all
  std::span<std::uint32_t> words;          ///< limits::kDenoiseCellsMax
};

/// True if consecutive points are near each other, as scanners export them. Tests a thousand places in the cloud.
[[nodiscard]] bool is_in_order(const Cloud& cloud, const Lattice& lattice);

/// Counts of `order_points`.
struct Ordered {
  std::size_t finite = 0;
  std::size_t met = 0;      ///< points that share their cell with a lower one
  std::size_t outside = 0;  ///< outside the lattice
};

/// Makes the cloud an organised scan: columns * rows cells of the lattice, each with its lowest point or NaN. The
/// remaining points follow, sorted by height: the other points of a cell, and those without one; then width and height
/// are 0. Points that lack a coordinate are dropped. The same points give the same cloud in any order. False if
/// `memory` or the cloud's buffer is too small, more than one point in 2 000 has no cell, a band of rows has more
/// points than cells, or more points share a cell than the memory holds. Then the cloud is unchanged, or all complete
/// points are sorted by height, which takes half a second. O(points), two passes.
[[nodiscard]] bool order_points(Cloud& cloud, const Lattice& lattice, const OrderMemory& memory, Team& team,
                                Ordered& found);

}  // namespace slabd::algo
