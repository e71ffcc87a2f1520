// SPDX-License-Identifier: Apache-2.0
//
// Which points are noise? Not those without neighbours: a reflection a millimetre off the seat has hundreds of them,
// and on a steep face a good point of a coarse scan has two. Noise is what no surface goes through: a surface is a
// sheet, and around each of its points a good part of all points lies in one plane with it, whatever the plane's slope.
// The yardstick is the scan's own pitch. A speck smaller than about three pitches is noise, an object is not.
#include "algo/denoise.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cassert>

#include "algo/denoise_cloud.h"
#include "algo/denoise_grid.h"
#include "algo/denoise_lattice.h"

namespace slabd::algo {
namespace {

/// Step 3 for one band; returns how many points it took out.
std::uint64_t take_out(const GridLayout& grid, GridWork& work, std::size_t band) {
  std::uint64_t taken = 0;
  const std::size_t first = band * GridLayout::kBandTileRows * GridLayout::kTileRows;
  const std::size_t last = std::min(first + GridLayout::kBandTileRows * GridLayout::kTileRows, grid.rows);
  for (std::size_t row = first; row < last; ++row) {
    for (int tc = 0; tc < grid.tile_columns; ++tc) {
      std::uint32_t noise = work.noise.tile(tc, static_cast<int>(row));
      taken += static_cast<std::uint64_t>(std::popcount(noise));
      for (; noise != 0; noise &= noise - 1) {
        const std::size_t column =
            static_cast<std::size_t>(GridLayout::kTileColumns * tc) + static_cast<std::size_t>(std::countr_zero(noise));
        std::fill_n(work.xyz + 3 * (row * grid.columns + column), 3, kNoPlane);
      }
    }
  }
  return taken;
}

}  // namespace

bool judge_grid(const GridLayout& grid, GridWork& work, Team& team) {
  team.run(grid.bands(), [&](std::size_t band) { find_grid_planes(grid, work, band); });
  if (2 * work.with_plane < work.finite) return false;
  team.run(grid.bands(), [&](std::size_t band) { judge_grid_points(grid, work, band); });
  return true;
}

bool denoise_grid(Cloud& cloud, const DenoiseWorkspace& memory, Team& team, ScanCounts& counts) {
  if (cloud.width < GridLayout::kColumnsMin || cloud.height < GridLayout::kRowsMin) return false;
  if (cloud.width * cloud.height != cloud.points) return false;
  const GridLayout grid(cloud.width, cloud.height);
  if (2 * grid.tiles() > memory.surface.size() || 2 * grid.mask_bytes() > memory.keep.size()) return false;
  GridWork work(grid, cloud.xyz.data(), nullptr, memory);
  work.measure_pitch(grid);
  if (!judge_grid(grid, work, team)) return false;
  std::atomic<std::uint64_t> taken{0};
  team.run(grid.bands(), [&](std::size_t band) { taken += take_out(grid, work, band); });
  counts.points_finite = work.finite;
  counts.isolated_removed = taken;
  counts.points_kept = counts.points_finite - counts.isolated_removed;
  return true;
}

void remove_isolated(Cloud& cloud, const DenoiseWorkspace& work, Team& team, ScanCounts& counts) {
  assert(cloud.points <= work.keep.size());
  counts = ScanCounts{};
  counts.points_read = cloud.points;
  // A scan whose header says grid and whose points do not lie in one is a cloud like any other.
  if (denoise_grid(cloud, work, team, counts)) return;
  if (!denoise_lattice(cloud, work, team, counts)) denoise_cloud(cloud, work, counts);
}

}  // namespace slabd::algo
