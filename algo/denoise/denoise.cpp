// SPDX-License-Identifier: Apache-2.0
//
// Problem: which points are noise? Having neighbours is not the criterion: a reflection a millimetre off the seat has
// hundreds, and a good point of a coarse scan on a steep face has two. Noise is a point without a surface through it. A
// surface is a sheet: around each of its points, a large share of all points is in one plane with it, whatever the
// plane's slope. Lengths are measured in the scan's own pitch. A speck smaller than about three pitches is noise, a
// larger object is not. A strip may be narrower: noise connected over a length is kept, even if one grid line wide
// (algo/denoise/denoise.h).
#include "algo/denoise/denoise.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cassert>
#include <cmath>
#include <cstdint>

#include "algo/denoise/denoise_grid.h"

namespace slabd::algo {
namespace {

/// Points to be removed, listed first. Their addresses are unpredictable for the hardware, so each is prefetched a few
/// points ahead.
class NoiseList {
 public:
  explicit NoiseList(float* xyz) : xyz_(xyz) {}

  /// Adds the points of a mask word whose first bit is point `first`. Words have zero to three bits at random, and a
  /// branch on their number would mispredict often; more than three are rare.
  void add(std::size_t first, std::uint64_t noise) {
    for (int k = 0; k < kUnasked; ++k) note(first, noise);
    while (noise != 0) note(first, noise);
    if (count_ >= kFull) take_out();
  }
  /// Sets the listed points to NaN.
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

  /// Writes an entry unconditionally; counts it only if a bit is left.
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

/// Step 3 for one band; returns the number of removed points.
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
    // Later stages must not use the wrong shape either.
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
  // A scan whose header declares a grid but whose points are not in one is processed like any other cloud.
  if (denoise_grid(cloud, work, team, counts) || denoise_lattice(cloud, work, team, counts)) return true;
  return denoise_cloud(cloud, work, counts);
}

// Denoising of an organised scan, between step 2 and step 3 (algo/denoise/denoise_grid.cpp): noise connected over a
// length is damage, and is kept so that flatness measures it (algo/denoise/denoise.h). The rules are applied one after
// the other, each to the remainder of the one before.
//
// Few points are noise and two of them hardly ever touch, so this costs one test of their bits, 48 at a time. In a
// group of three or more, some point touches two others; groups are followed from such points. At most 31 x 31 points
// fit into a group that is too short, so following ends after that number of steps, and a list of that length is
// enough. A point of a short group belongs to no other group. A point of a long group marks every group that reaches it
// as long. So each point is followed about once, however large the groups are.
//
// Invariants: a group is a connected component, so order, threads and bands do not change the result. Here
// `off` is free; around the starts of groups it is reused for noise that may still belong to a long group. Only `off`
// and `noise` change. Points that are in `off` and no longer in `noise` were found to be damage.

namespace {

/// Bits with at least two of their eight neighbours set. The outer bits of `middle` lack some neighbours.
std::uint64_t touching_two(std::uint64_t above, std::uint64_t middle, std::uint64_t below) {
  std::uint64_t one = 0;
  std::uint64_t two = 0;
  for (const std::uint64_t beside :
       {above << 1U, above, above >> 1U, middle << 1U, middle >> 1U, below << 1U, below, below >> 1U}) {
    two |= one & beside;
    one |= beside;
  }
  return middle & two;
}

class NoiseGroups {
 public:
  NoiseGroups(const GridLayout& grid, GridWork& work) : grid_(grid), work_(work) {}

  /// Calls f(column, row) for each point that touches two others in a row of the mask; f may change the mask.
  template <typename F>
  void for_each_start(const GridMask& mask, int row, F&& f) const {
    constexpr int kStep = GridMask::kInner;
    constexpr std::uint64_t kInner = ((std::uint64_t{1} << static_cast<unsigned>(kStep)) - 1) << 8U;
    for (int column = 0; column < static_cast<int>(grid_.columns); column += kStep) {
      const std::uint64_t above = mask.wide(column, row - 1);
      const std::uint64_t middle = mask.wide(column, row);
      const std::uint64_t below = mask.wide(column, row + 1);
      // Nearly always no points touch. This branch predicts better than one on whether there is any noise.
      const std::uint64_t any = above | middle | below;
      if ((middle & kInner & (above | below | any << 1U | any >> 1U)) == 0) continue;
      for (std::uint64_t left = touching_two(above, middle, below) & kInner; left != 0; left &= left - 1)
        f(column - 8 + std::countr_zero(left), row);
    }
  }

  /// Marks the band's tile rows in which a group may start.
  void find_starts(std::size_t band) const {
    for (int tr = grid_.first_tile_row(band); tr < grid_.first_tile_row(band + 1); ++tr) {
      bool any = false;
      for_rows(tr, [&](int row) { for_each_start(work_.noise, row, [&](int, int) { any = true; }); });
      work_.marks.of(0, tr) = any ? TileMarks::kStarts : std::uint8_t{0};
    }
  }

  void keep_long_ones(const noise_group::Rule& rule) {
    // A group affects nothing further than this from its start.
    const int tile_rows_around = (rule.length + GridLayout::kTileRows - 1) / GridLayout::kTileRows;
    int copied = 0;
    for (int tr = 0; tr < grid_.tile_rows; ++tr) {
      if (work_.marks.of(0, tr) != TileMarks::kStarts) continue;
      const int from = std::max(copied, tr - tile_rows_around);
      copied = std::min(tr + tile_rows_around + 1, grid_.tile_rows);
      work_.off.copy(work_.noise, GridLayout::kTileRows * from, GridLayout::kTileRows * copied);
      for_rows(tr, [&](int row) {
        for_each_start(work_.off, row, [&](int column, int r) {
          if (work_.off.bit(column, r)) follow(column, r, rule);
        });
      });
    }
  }

 private:
  static constexpr int kShortSide = noise_group::kRules[1].length - 1;
  static_assert(noise_group::kRules[0].length - 1 <= kShortSide);
  static constexpr std::size_t kShort = std::size_t{kShortSide} * kShortSide;
  struct Place {
    int column, row;
  };

  template <typename F>
  void for_rows(int tr, F&& f) const {
    const int end = std::min(GridLayout::kTileRows * (tr + 1), static_cast<int>(grid_.rows));
    for (int row = GridLayout::kTileRows * tr; row < end; ++row) f(row);
  }
  [[nodiscard]] float height(int column, int row) const {
    const std::size_t i = static_cast<std::size_t>(row) * grid_.columns + static_cast<std::size_t>(column);
    return work_.z != nullptr ? work_.z[i] : work_.xyz[3 * i + 2];
  }

  /// Decides about the point and about the visited points. All its neighbours are visited, so a point with only one
  /// neighbour is decided together with that neighbour.
  void follow(int column, int row, const noise_group::Rule& rule) {
    // The last visited point may add its eight neighbours.
    std::array<Place, kShort + 8> group;
    std::size_t size = 0;
    Place low{column, row};
    Place high = low;
    bool is_long = !work_.noise.bit(column, row);
    const auto add = [&](int c, int r) {
      work_.off.clear(c, r);
      group[size++] = {c, r};
      low = {std::min(low.column, c), std::min(low.row, r)};
      high = {std::max(high.column, c), std::max(high.row, r)};
      is_long = is_long || std::max(high.column - low.column, high.row - low.row) >= rule.length - 1;
    };
    add(column, row);
    for (std::size_t i = 0; i < size && (i == 0 || !is_long); ++i) {
      const Place at = group[i];
      const float z = height(at.column, at.row);
      for (int r = at.row - 1; r <= at.row + 1; ++r) {
        for (int c = at.column - 1; c <= at.column + 1; ++c) {
          if (!work_.off.bit(c, r) || !(std::abs(height(c, r) - z) <= rule.step_mm)) continue;
          if (work_.noise.bit(c, r))
            add(c, r);
          else
            is_long = true;
        }
      }
    }
    if (!is_long) return;
    for (std::size_t i = 0; i < size; ++i) {
      work_.off.set_bit(group[i].column, group[i].row);
      work_.noise.clear(group[i].column, group[i].row);
    }
  }

  const GridLayout grid_;
  GridWork& work_;
};

}  // namespace

void keep_noise_groups(const GridLayout& grid, GridWork& work, Team& team) {
  NoiseGroups groups(grid, work);
  team.run(grid.bands(), [&](std::size_t band) { groups.find_starts(band); });
  for (const noise_group::Rule& rule : noise_group::kRules) groups.keep_long_ones(rule);
}

}  // namespace slabd::algo
