// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "algo/algo.h"
#include "base/team.h"

namespace slabd::algo {

/// Evenly spaced rays that a scan's points lie on: parallel ones over x and y, or ones from the origin over x / z and
/// y / z. Column of a point: floor((x or x / z - x0) * per_x); rows alike.
struct Lattice {
  bool central = false;
  float x0 = 0.0F, y0 = 0.0F;
  float per_x = 1.0F, per_y = 1.0F;
  float columns = 0.0F,
        rows = 0.0F;     ///< whole tiles of algo/denoise/denoise_grid.h; columns * rows <= limits::kScanPointsMax
  float away_mm = 1.0F;  ///< columns are away_mm / per_x apart there

  [[nodiscard]] bool operator==(const Lattice&) const = default;
};

/// With more points than one in so many outside of the table, or in a cell with a lower one, there is no lattice.
inline constexpr std::uint64_t kOutsideShare = 2'000;
inline constexpr std::uint64_t kMetShare = 100;

/// Floats of memory that finding a lattice takes.
inline constexpr std::size_t kLatticeSampleMax = 1U << 14U;
inline constexpr std::size_t kLatticeFloats = 7 * kLatticeSampleMax;

/// Finds the lattice of a scan in whatever order its points come: the same points, the same lattice. False when there
/// is none. `memory`: kLatticeFloats. One pass over the points.
[[nodiscard]] bool find_lattice(const Cloud& cloud, std::span<float> memory, Team& team, Lattice& lattice);

/// Memory for `order_points`: arrays that begin on a cache line, or it takes longer.
struct OrderMemory {
  std::array<std::span<float>, 3> points;  ///< for a little more than half of the cloud in all
  std::span<std::uint32_t> words;          ///< kOrderWords
};
inline constexpr std::size_t kOrderWords = limits::kDenoiseCellsMax;

/// Do consecutive points lie near each other, as a scanner exports them? Told from a thousand places in the cloud.
[[nodiscard]] bool is_in_order(const Cloud& cloud, const Lattice& lattice);

/// What `order_points` saw.
struct Ordered {
  std::size_t finite = 0;
  std::size_t met = 0;      ///< points that share their cell with a lower one
  std::size_t outside = 0;  ///< of the lattice
};

/// Makes the cloud an organised scan: columns * rows cells of the lattice, each with the lowest of its points or NaN.
/// What is left over follows in order of height: the other points of a cell, and those that have none; then width and
/// height are 0. Points that lack a coordinate are dropped. So the same points come to the same cloud, whatever their
/// order was. False where `memory` or the cloud's buffer is too small, more points than one in 2 000 have no cell, a
/// band of rows has more points than cells, or more points share a cell than there is memory for: then nothing has
/// changed, or all points that lacked nothing are sorted by height, which takes half a second. O(points), two passes.
[[nodiscard]] bool order_points(Cloud& cloud, const Lattice& lattice, const OrderMemory& memory, Team& team,
                                Ordered& found);

}  // namespace slabd::algo
