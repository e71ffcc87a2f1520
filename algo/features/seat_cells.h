// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <bitset>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

#include "algo/features/cell_grid.h"
#include "algo/features/cell_sums.h"
#include "algo/features/flatness.h"
#include "algo/features/seat_points.h"
#include "base/limits.h"
#include "base/team.h"

/// The cells of a seat: what their points add up to, without strays, and which of them are damage.
namespace slabd::algo {

/// A point nearer than this to its cell's median is no stray: there may be a slope or step within a cell.
inline constexpr double kStrayMin_mm = 0.15;

/// Points a sparse cell needs to say where the seat is.
[[nodiscard]] inline std::size_t few_of(std::uint32_t points_min) {
  return std::max<std::size_t>(1, (points_min + 2) / 3);
}

/// What a cell comes to: mean place in the seat's frame, mean height above the fitted seat, scatter about it.
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

/// Cells by a number of theirs.
using CellSet = std::bitset<limits::kFlatnessCellsMax>;

/// The cells' sums, and the heights of single points where the sums do not say enough. Works in `work`; no heap.
class SeatCells {
 public:
  SeatCells(std::span<const SeatPoints> runs, const CellLayout& layout, const FlatnessWorkspace& work);

  /// Two halves, whoever does them.
  void sum_up(Team& team);

  /// Takes the strays out of the cells that may have some. Where they hang together over half a cell's worth of points
  /// and lie further from the seat than the rest, they are what the cell is: then everything else is taken out.
  /// `mark`: room for one entry per cell.
  void remove_strays(const CellGrid& grid, std::span<std::uint32_t> mark);

  /// Under a drop of water: it stands over the seat, by less than 1.5 mm, but returns few points, on a place no wider
  /// than the pits that are bridged and with a seat around it that returns as many as everywhere. Where the concrete
  /// lies there is not seen.
  [[nodiscard]] bool is_wet(std::size_t cell) const { return wet_[cell]; }
  /// What stands out of this cell, or is missing of it, took its place.
  [[nodiscard]] bool is_damage(std::size_t cell) const { return high_[cell] || low_[cell]; }
  /// Both: what reaches further took its place.
  [[nodiscard]] bool is_damage_of_both_sides(std::size_t cell) const { return high_[cell] && low_[cell]; }

  /// Of a cell that is damage: what is not, or the damage of the other side where there is such.
  [[nodiscard]] const CellSum& beside_damage(std::size_t cell) const { return rest_[cell]; }

  [[nodiscard]] std::size_t size() const { return sums_.size(); }
  [[nodiscard]] const CellSum& operator[](std::size_t cell) const { return sums_[cell]; }
  /// Empty where they were not fetched.
  [[nodiscard]] std::span<const float> heights(const CellSum& sum) const {
    if (sum.heights_at == CellSum::kNowhere) return {};
    return work_.heights.subspan(sum.heights_at, sum.heights);
  }
  /// All points of a cell, strays too.
  [[nodiscard]] std::uint32_t points_in(std::size_t cell) const {
    return sums_[cell].heights_at == CellSum::kNowhere ? sums_[cell].points : sums_[cell].heights;
  }

 private:
  static constexpr float kAny = std::numeric_limits<float>::max();

  /// The strays of one side in a cell.
  struct Strays {
    std::uint32_t points = 0;
    double sum = 0.0;  ///< of their heights, mm

    [[nodiscard]] double height_mm() const { return sum / static_cast<double>(points); }
  };

  [[nodiscard]] CellSum& rest_of(const CellSum& sum) const;
  /// Fetches the heights of the cells of which a point may be a stray.
  void fetch_heights(const CellGrid& grid);
  /// How the points of a full cell scatter, as most of them have it.
  [[nodiscard]] double scatter_in_full_cells(std::uint32_t points_min) const;
  [[nodiscard]] Strays strays_in(const CellSum& sum, CellMark side) const;
  void find_drops(double usual_points, const CellGrid& grid, std::span<std::uint32_t> mark);
  /// Strays of one side, in cells that touch, that are together `points_min` points or more: puts those into `damage`.
  void find_damage(CellMark side, double points_min, const CellGrid& grid, std::span<std::uint32_t> mark,
                   CellSet& damage);
  /// Which heights of a cell count in its sum and which in that of its rest, now that its damage is known.
  void divide(CellSum& sum);
  /// Calls f(sum, x, s, height) for every point of the cells for which chosen(sum); most groups hold none and are
  /// left out.
  template <typename Chosen, typename F>
  void for_points_of(const Chosen& chosen, const F& f);

  std::span<const SeatPoints> runs_;
  const CellLayout& layout_;
  const FlatnessWorkspace& work_;
  std::span<CellSum> sums_;
  std::span<CellSum> rest_;  ///< of the cells that have strays; the sums of the second half before
  CellSet high_;             ///< cells whose strays above hang together
  CellSet low_;              ///< ... below
  CellSet wet_;
  CellSet beside_wet_;  ///< in part, perhaps
};

}  // namespace slabd::algo
