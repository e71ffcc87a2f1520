// SPDX-License-Identifier: Apache-2.0
//
// Denoising of an organised scan, between step 2 and step 3 (algo/denoise/denoise_grid.cpp): noise that hangs together
// over a length is damage, and stays for flatness to measure (algo/denoise/noise_group.h). One rule after the other,
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
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>

#include "algo/denoise/denoise_grid.h"
#include "algo/denoise/noise_group.h"

namespace slabd::algo {
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
