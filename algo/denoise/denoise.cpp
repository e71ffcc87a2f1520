// SPDX-License-Identifier: Apache-2.0
//
// Which points are noise? Not those without neighbours: a reflection a millimetre off the seat has hundreds of them,
// and on a steep face a good point of a coarse scan has two. Noise is what no surface goes through: a surface is a
// sheet, and around each of its points a good part of all points lies in one plane with it, whatever the plane's slope.
// The yardstick is the scan's own pitch. A speck smaller than about three pitches is noise, an object is not. A strip
// may be narrower: what hangs together over a length is no noise, be it one grid line wide
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

// Denoising of an organised scan, between step 2 and step 3 (algo/denoise/denoise_grid.cpp): noise that hangs together
// over a length is damage, and stays for flatness to measure (algo/denoise/denoise.h). One rule after the other,
// each for what the one before it left.
//
// Few points are noise and hardly two of them touch, so this costs no more than a look at their bits, 48 at a time. In
// a group of three or more some point touches two others; from such points groups are followed. No more than 31 x 31
// points fit a group that is too short, so following one ends after so many steps, and a list that is not longer will
// do. A point that a short group had belongs to no other; a point that a long one had says of every group that comes
// upon it that it is the same one. So each point is followed about once, however large the groups.
//
// Invariants: a group is what hangs together, whoever finds it, so neither order nor threads nor bands decide anything.
// `off` is no longer needed and says, around where groups start, which noise may still belong to a long one; it and
// `noise` alone change. What is in `off` and no longer in `noise` was found to be damage.

namespace {

/// Bits with at least two of the eight around them set; the outer ones of `middle` lack theirs.
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

  /// Calls f(column, row) for what touches two others in a row of the mask, which f may change.
  template <typename F>
  void for_each_start(const GridMask& mask, int row, F&& f) const {
    constexpr int kStep = GridMask::kInner;
    constexpr std::uint64_t kInner = ((std::uint64_t{1} << static_cast<unsigned>(kStep)) - 1) << 8U;
    for (int column = 0; column < static_cast<int>(grid_.columns); column += kStep) {
      const std::uint64_t above = mask.wide(column, row - 1);
      const std::uint64_t middle = mask.wide(column, row);
      const std::uint64_t below = mask.wide(column, row + 1);
      // Nearly always nothing touches, which a machine foresees better than whether there is noise at all.
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
    // No further from where it is followed does a group say anything.
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

  /// Decides about the point, and about those that are met on the way. Those beside it are always among them: so what
  /// touches but one other is decided with that one.
  void follow(int column, int row, const noise_group::Rule& rule) {
    // The last one that is asked may add its eight neighbours.
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
