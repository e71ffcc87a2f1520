// SPDX-License-Identifier: Apache-2.0
#pragma once

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

}  // namespace slabd::algo
