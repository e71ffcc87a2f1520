// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <bitset>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

#include "algo/features/cell_sums.h"
#include "algo/features/flatness.h"
#include "algo/features/seat_points.h"
#include "base/limits.h"
#include "base/team.h"

/// The cells of a seat: sums of their points without strays, and damaged cells.
namespace slabd::algo {

/// The cells of the evaluation region, row by row; a row runs along the rail.
struct CellGrid {
  std::size_t columns = 0;
  std::size_t rows = 0;
  const FlatnessRegion& region;

  explicit CellGrid(const FlatnessRegion& r) : region(r) {
    columns = static_cast<std::size_t>(std::ceil(2.0 * r.half_x_mm / r.cell_mm - 1e-9));
    rows = static_cast<std::size_t>(std::ceil(2.0 * r.half_s_mm / r.cell_mm - 1e-9));
  }
  [[nodiscard]] std::size_t cells() const { return columns * rows; }
  /// Centre of a cell along the rail and along the seat.
  [[nodiscard]] double x_of(std::size_t cell) const {
    return (static_cast<double>(cell % columns) + 0.5) * region.cell_mm - region.half_x_mm;
  }
  [[nodiscard]] double s_of(std::size_t cell) const {
    return (static_cast<double>(cell / columns) + 0.5) * region.cell_mm - region.half_s_mm;
  }
  /// True if all of this cell is in the region, clear of the casings.
  [[nodiscard]] bool expected(std::size_t cell) const {
    const double half = 0.5 * region.cell_mm;
    const double x = x_of(cell);
    const double s = s_of(cell);
    if (x + half > region.half_x_mm + 1e-9 || s + half > region.half_s_mm + 1e-9) return false;
    if (region.casing_clear_mm <= 0.0) return true;
    constexpr double kSqrtTwo = 1.4142135623730951;
    const double clear = region.casing_clear_mm + kSqrtTwo * half;
    const double beside = std::abs(s) - region.casing_s_mm;
    return x * x + beside * beside > clear * clear;
  }
};

/// State of a cell.
enum CellMark : std::uint32_t {
  kPlain,     ///< no mark
  kMeasured,  ///< has a mean
  kMissing,   ///< not seen
  kHigh,      ///< has a mean above the defect limit
  kLow,       ///< ... below it
};

/// Calls `group(cells)` for every connected component of cells marked `wanted`, corners included; `cells` has their
/// numbers. Removes the marks. `stack`: one entry per cell.
template <typename Group>
void for_each_group(const CellGrid& grid, CellMark wanted, std::span<std::uint32_t> mark,
                    std::span<std::uint32_t> stack, const Group& group) {
  for (std::size_t first = 0; first < grid.cells(); ++first) {
    if (mark[first] != wanted) continue;
    std::size_t found = 0;
    // The mark is removed when a cell is found, so each is found once; the list is also the queue.
    mark[first] = kPlain;
    stack[found++] = static_cast<std::uint32_t>(first);
    for (std::size_t next = 0; next < found; ++next) {
      const std::size_t column = stack[next] % grid.columns;
      const std::size_t row = stack[next] / grid.columns;
      for (std::size_t r = row - std::min<std::size_t>(row, 1); r <= std::min(row + 1, grid.rows - 1); ++r) {
        for (std::size_t c = column - std::min<std::size_t>(column, 1); c <= std::min(column + 1, grid.columns - 1);
             ++c) {
          const std::size_t neighbour = r * grid.columns + c;
          if (mark[neighbour] != wanted) continue;
          mark[neighbour] = kPlain;
          stack[found++] = static_cast<std::uint32_t>(neighbour);
        }
      }
    }
    group(std::span<const std::uint32_t>(stack.first(found)));
  }
}

// The surface as supported under a straightedge or a rail pad: pits narrower than its reach are bridged, everything
// else is unchanged. A morphological closing from above (ISO 16610-85, flat disc) finds the places below it. But a
// closing also fills the bottom of wide hollows, by up to a tenth of their depth, and these do affect a rail pad. So a
// sunk place is bridged only if it is compact and the surface around it, continued over it, does not lead down into it.
// Then its height is that of this surface, and never above the closing.

struct Closing {
  std::size_t pits = 0;  ///< number of bridged pits
};

/// A place counts as sunk from `least_mm` on, up to `most_mm` deep, and as compact up to `width_mm` across.
struct PitSize {
  double width_mm;
  double least_mm;
  double most_mm = std::numeric_limits<double>::infinity();
};

/// `cell` and `height` (mm above the fitted seat): the cells with a height, in ascending order. Writes the closed
/// height of each to `closed`. `mark` and `stack`: one entry per cell. No heap; 0.3 ms. With negated heights it levels
/// bumps.
Closing close_pits(const CellGrid& grid, std::span<const std::uint32_t> cell, std::span<const double> height,
                   const PitSize& size, std::span<std::uint32_t> mark, std::span<std::uint32_t> stack,
                   std::span<double> closed);

/// A point closer than this to its cell's median is not a stray: a cell may contain a slope or a step.
inline constexpr double kStrayMin_mm = 0.15;

/// Minimum number of points for a sparse cell to count.
[[nodiscard]] inline std::size_t few_of(std::uint32_t points_min) {
  return std::max<std::size_t>(1, (points_min + 2) / 3);
}

/// Statistics of a cell: mean position in the seat's frame, mean height above the fitted seat, scatter about it.
struct CellPoints {
  double x;
  double s;
  double height;
  double squares;  ///< of heights about their mean, mm^2

  explicit CellPoints(const CellSum& sum) {
    const auto n = static_cast<double>(sum.points);
    x = sum.x() / n;
    s = sum.s() / n;
    height = sum.height() / n;
    squares = std::max(sum.squares() - sum.height() * height, 0.0);
  }
};

/// Set of cells by number.
using CellSet = std::bitset<limits::kFlatnessCellsMax>;

/// The cells' sums, and the heights of single points where sums are not enough. Uses `work`; no heap.
class SeatCells {
 public:
  SeatCells(std::span<const SeatPoints> runs, const CellLayout& layout, const FlatnessWorkspace& work);

  /// Sums the points in two halves, one per thread.
  void sum_up(Team& team);

  /// Removes the strays from the cells that may have some. If connected strays have at least half a cell's worth of
  /// points and are further from the seat than the rest, they become the cell's height and the rest is removed. `mark`:
  /// one entry per cell.
  void remove_strays(const CellGrid& grid, std::span<std::uint32_t> mark);

  /// True under a drop of water: higher than the seat by less than 1.5 mm, but with few points, not wider
  /// than the bridged pits, and with a normal number of points around. The height of the concrete there is
  /// unknown.
  [[nodiscard]] bool is_wet(std::size_t cell) const { return wet_[cell]; }
  /// True if protruding or missing material determines the cell's height.
  [[nodiscard]] bool is_damage(std::size_t cell) const { return high_[cell] || low_[cell]; }
  /// True for damage on both sides; the larger deviation determines the height.
  [[nodiscard]] bool is_damage_of_both_sides(std::size_t cell) const { return high_[cell] && low_[cell]; }

  /// Sum of a damaged cell's remaining points, or of its smaller damage if both sides are damaged.
  [[nodiscard]] const CellSum& beside_damage(std::size_t cell) const { return rest_[cell]; }

  [[nodiscard]] std::size_t size() const { return sums_.size(); }
  [[nodiscard]] const CellSum& operator[](std::size_t cell) const { return sums_[cell]; }
  /// Empty if they were not fetched.
  [[nodiscard]] std::span<const float> heights(const CellSum& sum) const {
    if (sum.heights_at == CellSum::kNowhere) return {};
    return work_.heights.subspan(sum.heights_at, sum.heights);
  }
  /// Number of all points of a cell, including strays.
  [[nodiscard]] std::uint32_t points_in(std::size_t cell) const {
    return sums_[cell].heights_at == CellSum::kNowhere ? sums_[cell].points : sums_[cell].heights;
  }

 private:
  static constexpr float kAny = std::numeric_limits<float>::max();

  /// The strays on one side of a cell.
  struct StrayGroups {
    std::uint32_t points = 0;
    double sum = 0.0;  ///< of their heights, mm

    [[nodiscard]] double height_mm() const { return sum / static_cast<double>(points); }
  };

  [[nodiscard]] CellSum& rest_of(const CellSum& sum) const;
  /// Fetches the heights of the cells that may contain strays.
  void fetch_heights(const CellGrid& grid);
  /// Typical (median) scatter of the points in full cells.
  [[nodiscard]] double scatter_in_full_cells(std::uint32_t points_min) const;
  [[nodiscard]] StrayGroups strays_in(const CellSum& sum, CellMark side) const;
  void find_drops(double usual_points, const CellGrid& grid, std::span<std::uint32_t> mark);
  /// Adds to `damage` the connected cells with together at least `points_min` strays of one side.
  void find_damage(CellMark side, double points_min, const CellGrid& grid, std::span<std::uint32_t> mark,
                   CellSet& damage);
  /// Sets which heights of a cell count in its sum and which in that of its rest, once its damage is known.
  void divide(CellSum& sum);
  /// Calls f(sum, x, s, height) for every point of the cells for which chosen(sum) is true. Most groups contain no such
  /// point and are skipped.
  template <typename Chosen, typename F>
  void for_points_of(const Chosen& chosen, const F& f);

  std::span<const SeatPoints> runs_;
  const CellLayout& layout_;
  const FlatnessWorkspace& work_;
  std::span<CellSum> sums_;
  std::span<CellSum> rest_;  ///< for the cells with strays; initially the sums of the second half
  CellSet high_;             ///< cells with connected strays above
  CellSet low_;              ///< ... below
  CellSet wet_;
  CellSet beside_wet_;  ///< possibly wet in part
};

}  // namespace slabd::algo
