// SPDX-License-Identifier: Apache-2.0
//
// Which points are noise? Not those without neighbours: a reflection a millimetre off the seat has hundreds of them,
// and on a steep face a good point of a coarse scan has two. Noise is what no surface goes through: a surface is a
// sheet, and around each of its points a good part of all points lies in one plane with it, whatever the plane's slope.
// The yardstick is the scan's own pitch. A speck smaller than about three pitches is noise, an object is not. A strip
// may be narrower: what hangs together over a length is no noise, be it one grid line wide
// (algo/denoise/noise_group.h).
#include "algo/denoise/denoise.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cassert>

#include "algo/denoise/denoise_cloud.h"
#include "algo/denoise/denoise_grid.h"
#include "algo/denoise/denoise_lattice.h"

namespace slabd::algo {
namespace {

/// Points to be taken out, noted before they are. Each lies in memory of its own that nobody foresees, so it is fetched
/// a few points before its turn.
class NoiseList {
 public:
  explicit NoiseList(float* xyz) : xyz_(xyz) {}

  /// The points of a word of a mask whose first bit is point `first`. Words with none, one, two or three come as chance
  /// will have it, and to ask each of them how many it has would be foreseen wrongly time and again; more are rare.
  void add(std::size_t first, std::uint64_t noise) {
    for (int k = 0; k < kUnasked; ++k) note(first, noise);
    while (noise != 0) note(first, noise);
    if (count_ >= kFull) take_out();
  }
  /// Sets them to NaN.
  void take_out() {
    for (std::size_t k = 0; k < kAhead; ++k) place_[count_ + k] = place_[0];
    for (std::size_t k = 0; k < count_; ++k) {
      __builtin_prefetch(xyz_ + 3 * place_[k + kAhead], 1);
      std::fill_n(xyz_ + 3 * place_[k], 3, kNoPlane);
    }
    taken_ += count_;
    count_ = 0;
  }
  [[nodiscard]] std::uint64_t taken() const { return taken_; }

 private:
  static constexpr int kUnasked = 3;
  static constexpr std::size_t kFull = 512;
  static constexpr std::size_t kWordBits = 64;
  static constexpr std::size_t kAhead = 16;

  /// Writes a place, be there a bit or not; only counts it if there is.
  void note(std::size_t first, std::uint64_t& noise) {
    place_[count_] = first + static_cast<std::size_t>(std::countr_zero(noise));
    count_ += noise != 0 ? 1U : 0U;
    noise &= noise - 1;
  }

  float* xyz_;
  std::array<std::size_t, kFull + kWordBits + kAhead> place_{};
  std::size_t count_ = 0;
  std::uint64_t taken_ = 0;
};

/// Step 3 for one band; returns how many points it took out.
std::uint64_t take_out(const GridLayout& grid, GridWork& work, std::size_t band) {
  NoiseList list(work.xyz);
  const std::size_t first = band * GridLayout::kBandTileRows * GridLayout::kTileRows;
  const std::size_t last = std::min(first + GridLayout::kBandTileRows * GridLayout::kTileRows, grid.rows);
  for (std::size_t row = first; row < last; ++row)
    for (std::size_t column = 0; column < grid.columns; column += 64)
      list.add(row * grid.columns + column, work.noise.sixtyfour(column, row));
  list.take_out();
  return list.taken();
}

}  // namespace

bool judge_grid(const GridLayout& grid, GridWork& work, Team& team) {
  team.run(grid.bands(), [&](std::size_t band) { find_grid_planes(grid, work, band); });
  if (2 * work.with_plane < work.finite) return false;
  team.run(grid.bands(), [&](std::size_t band) {
    const int first = grid.first_tile_row(band);
    const int last = grid.first_tile_row(band + 1) - 1;
    judge_tile_row(grid, work, first);
    if (last != first) judge_tile_row(grid, work, last);
  });
  return true;
}

std::uint64_t take_out_noise(const GridLayout& grid, GridWork& work, Team& team) {
  std::atomic<std::uint64_t> taken{0};
  team.run(grid.bands(), [&](std::size_t band) { taken += take_out(grid, work, band); });
  return taken;
}

bool denoise_grid(Cloud& cloud, const DenoiseWorkspace& memory, Team& team, ScanCounts& counts) {
  if (cloud.width < GridLayout::kColumnsMin || cloud.height < GridLayout::kRowsMin) return false;
  if (cloud.width * cloud.height != cloud.points) return false;
  const GridLayout grid(cloud.width, cloud.height);
  if (!grid.fits(memory)) return false;
  GridWork work(grid, cloud.xyz.data(), nullptr, memory);
  work.measure_pitch(grid);
  if (!work.neighbours_are_near(grid) || !judge_grid(grid, work, team)) {
    // Nobody behind may believe the shape either.
    cloud.width = cloud.height = 0;
    return false;
  }
  keep_noise_groups(grid, work, team);
  counts.points_finite = work.finite;
  counts.isolated_removed = take_out_noise(grid, work, team);
  counts.points_kept = counts.points_finite - counts.isolated_removed;
  return true;
}

bool remove_isolated(Cloud& cloud, const DenoiseWorkspace& work, Team& team, ScanCounts& counts) {
  assert(cloud.points <= work.keep.size());
  counts = ScanCounts{};
  counts.points_read = cloud.points;
  // A scan whose header says grid and whose points do not lie in one is a cloud like any other.
  if (denoise_grid(cloud, work, team, counts) || denoise_lattice(cloud, work, team, counts)) return true;
  return denoise_cloud(cloud, work, counts);
}

}  // namespace slabd::algo
