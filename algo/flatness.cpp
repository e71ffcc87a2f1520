// SPDX-License-Identifier: Apache-2.0
//
// How flat is the seat? The peak to valley of single points is mostly noise (0.27 mm of it on a perfect plane scanned
// with 0.03 mm noise), so heights are averaged over cells of 1.5 mm first, a box filter, and the peak to valley of the
// cell means against their own least-squares plane is the flatness; the minimum zone stands beside it. Averaging must
// not hide a chip: single-point extremes are reported too, and a cell mean leaves out only what disagrees with the
// majority of its own cell.
//
// Nobody knows how flat a place is that was not seen, so flatness is not measured (no value, hence no pass) when
//   - fewer than half of the cells hold cell_points_min points,
//   - more than cells_missing_max of the cells are missing, or
//   - missing cells that touch make a hole of more than 100 mm^2.
// A cell is missing when it holds less than a third of cell_points_min, or fewer than cell_points_min that disagree
// with what the full cells show. A coarse scan has many cells a few points short of the limit, in rows and columns:
// those are not holes, as their points say that the seat is there. Cells at casings and cut by the border do not count.
#include "algo/flatness.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "algo/algo.h"
#include "algo/moments.h"

namespace slabd::algo {
namespace {

/// Points of one cell that take part in its median; a cell of a dense scan holds about 80.
constexpr std::size_t kCellSampleMax = 512;
/// A stray is this many robust deviations from its cell's median ...
constexpr double kStraySigmas = 5.0;
/// ... and at least this far: a slope or step within a cell is not a stray.
constexpr double kStrayMin_mm = 0.15;
/// A hole in the data that may hide a defect worth finding: 10 x 10 mm.
constexpr double kHole_mm2 = 100.0;

constexpr double kSqrtTwo = 1.4142135623730951;

struct Grid {
  std::size_t columns = 0;
  std::size_t rows = 0;
  const FlatnessRegion& region;

  explicit Grid(const FlatnessRegion& r) : region(r) {
    columns = static_cast<std::size_t>(std::ceil(2.0 * r.half_x_mm / r.cell_mm - 1e-9));
    rows = static_cast<std::size_t>(std::ceil(2.0 * r.half_s_mm / r.cell_mm - 1e-9));
  }
  [[nodiscard]] std::size_t cells() const { return columns * rows; }
  [[nodiscard]] std::size_t cell(const Vec3& p) const {
    const double column = (p.x() + region.half_x_mm) / region.cell_mm;
    const double row = (region.along_seat.dot(p) + region.half_s_mm) / region.cell_mm;
    const std::size_t c = std::min(static_cast<std::size_t>(std::max(column, 0.0)), columns - 1);
    const std::size_t r = std::min(static_cast<std::size_t>(std::max(row, 0.0)), rows - 1);
    return r * columns + c;
  }
  /// Does all of this cell belong to the region, clear of the casings?
  [[nodiscard]] bool expected(std::size_t cell) const {
    const double x0 = static_cast<double>(cell % columns) * region.cell_mm - region.half_x_mm;
    const double s0 = static_cast<double>(cell / columns) * region.cell_mm - region.half_s_mm;
    if (x0 + region.cell_mm > region.half_x_mm + 1e-9 || s0 + region.cell_mm > region.half_s_mm + 1e-9) return false;
    const double half = 0.5 * region.cell_mm;
    const double from_casing = std::hypot(x0 + half, std::abs(s0 + half) - region.casing_s_mm);
    return region.casing_clear_mm <= 0.0 || from_casing > region.casing_clear_mm + kSqrtTwo * half;
  }
};

/// Sorts `index` by cell in place: every entry goes straight to the next free place of its cell.
template <typename CellOf>
void sort_by_cell(std::span<std::uint32_t> index, std::size_t cells, const FlatnessWorkspace& work,
                  const CellOf& cell_of) {
  const std::span<std::uint32_t> start = work.cell_start.first(cells + 1);
  std::fill(start.begin(), start.end(), 0U);
  for (const std::uint32_t i : index) ++start[cell_of(i) + 1];
  for (std::size_t c = 0; c < cells; ++c) start[c + 1] += start[c];
  std::copy_n(start.begin(), cells, work.cell_next.begin());
  for (std::size_t c = 0; c < cells; ++c) {
    while (work.cell_next[c] < start[c + 1]) {
      std::uint32_t& here = index[work.cell_next[c]];
      const std::size_t home = cell_of(here);
      if (home == c)
        ++work.cell_next[c];
      else
        std::swap(here, index[work.cell_next[home]++]);
    }
  }
}

/// Median and robust deviation of up to kCellSampleMax heights, evenly taken.
struct CellCentre {
  double median;
  double sigma;
};
template <typename HeightOf>
CellCentre centre_of(std::span<const std::uint32_t> index, const HeightOf& height_of) {
  std::array<double, kCellSampleMax> h{};
  const std::size_t m = std::min(index.size(), h.size());
  for (std::size_t i = 0; i < m; ++i) h[i] = height_of(index[i * index.size() / m]);
  const auto end = h.begin() + static_cast<std::ptrdiff_t>(m);
  const auto middle = h.begin() + static_cast<std::ptrdiff_t>(m / 2);
  std::nth_element(h.begin(), middle, end);
  const double median = *middle;
  for (std::size_t i = 0; i < m; ++i) h[i] = std::abs(h[i] - median);
  std::nth_element(h.begin(), middle, end);
  return {median, 1.4826 * *middle};
}

/// Mean point of a cell without its strays; false when too few are left.
template <typename PointOf>
bool cell_mean(std::span<const std::uint32_t> index, const PointOf& point_of, const PlaneFit& seat,
               std::uint32_t points_min, Vec3& mean) {
  if (index.empty() || index.size() < points_min) return false;
  const auto height_of = [&](std::uint32_t i) { return seat.normal.dot(point_of(i)) - seat.offset_mm; };
  const CellCentre centre = centre_of(index, height_of);
  const double reach = std::max(kStraySigmas * centre.sigma, kStrayMin_mm);
  Vec3 sum = Vec3::Zero();
  std::uint32_t used = 0;
  for (const std::uint32_t i : index) {
    const Vec3 p = point_of(i);
    if (std::abs(seat.normal.dot(p) - seat.offset_mm - centre.median) > reach) continue;
    sum += p;
    ++used;
  }
  if (used < points_min || used == 0) return false;
  mean = sum / static_cast<double>(used);
  return true;
}

/// Do the few points of a sparse cell lie where the full cells, from `low` to `high`, say the seat is?
template <typename HeightOf>
bool agrees(std::span<const std::uint32_t> cell, const HeightOf& height_of, std::uint32_t points_min, double low,
            double high) {
  const std::size_t few = std::max<std::size_t>(1, (points_min + 2) / 3);
  if (cell.size() < few) return false;
  const double median = centre_of(cell, height_of).median;
  return median >= low - kStrayMin_mm && median <= high + kStrayMin_mm;
}

/// What a cell came to, while holes are sought.
enum CellMark : std::uint32_t { kSeen, kMissing };

/// Cells of the largest group of missing ones that touch, corners included. Takes the marks off. `stack`: one per cell.
std::size_t largest_hole(const Grid& grid, std::span<std::uint32_t> mark, std::span<std::uint32_t> stack) {
  std::size_t largest = 0;
  for (std::size_t first = 0; first < grid.cells(); ++first) {
    if (mark[first] != kMissing) continue;
    std::size_t group = 0;
    std::size_t waiting = 0;
    // Marks go when a cell is put on the stack: each is put there once.
    mark[first] = kSeen;
    stack[waiting++] = static_cast<std::uint32_t>(first);
    while (waiting > 0) {
      const std::size_t cell = stack[--waiting];
      ++group;
      const std::size_t column = cell % grid.columns;
      const std::size_t row = cell / grid.columns;
      for (std::size_t r = row - std::min<std::size_t>(row, 1); r <= std::min(row + 1, grid.rows - 1); ++r) {
        for (std::size_t c = column - std::min<std::size_t>(column, 1); c <= std::min(column + 1, grid.columns - 1);
             ++c) {
          const std::size_t next = r * grid.columns + c;
          if (mark[next] != kMissing) continue;
          mark[next] = kSeen;
          stack[waiting++] = static_cast<std::uint32_t>(next);
        }
      }
    }
    largest = std::max(largest, group);
  }
  return largest;
}

}  // namespace

Flatness measure_flatness(const float* xyz, std::span<std::uint32_t> index, const FastTransform& T_block_scanner,
                          const PlaneFit& seat, const FlatnessRegion& region, const FlatnessWorkspace& work) {
  Flatness result;
  const Grid grid(region);
  if (index.empty() || grid.cells() == 0 || grid.cells() > work.cell_mean.size()) return result;
  const auto point_of = [&](std::uint32_t i) { return T_block_scanner(xyz + 3 * std::size_t{i}); };

  const auto height_of = [&](std::uint32_t i) { return seat.normal.dot(point_of(i)) - seat.offset_mm; };

  double low = std::numeric_limits<double>::infinity();
  double high = -low;
  for (const std::uint32_t i : index) {
    const double h = height_of(i);
    low = std::min(low, h);
    high = std::max(high, h);
  }
  result.raw_low_mm = low;
  result.raw_high_mm = high;

  sort_by_cell(index, grid.cells(), work, [&](std::uint32_t i) { return grid.cell(point_of(i)); });
  const auto points_in = [&](std::size_t c) -> std::span<const std::uint32_t> {
    return index.subspan(work.cell_start[c], work.cell_start[c + 1] - work.cell_start[c]);
  };
  // Sorting is done with cell_next; from here on it holds the marks.
  const std::span<std::uint32_t> mark = work.cell_next.first(grid.cells());
  std::size_t expected = 0;
  low = std::numeric_limits<double>::infinity();
  high = -low;
  for (std::size_t c = 0; c < grid.cells(); ++c) {
    mark[c] = kSeen;
    const bool wanted = grid.expected(c);
    if (wanted) ++expected;
    Vec3 mean;
    if (cell_mean(points_in(c), point_of, seat, region.cell_points_min, mean)) {
      work.cell_mean[result.cells++] = mean;
      const double h = seat.normal.dot(mean) - seat.offset_mm;
      low = std::min(low, h);
      high = std::max(high, h);
    } else if (wanted) {
      mark[c] = kMissing;
    }
  }
  for (std::size_t c = 0; c < grid.cells(); ++c) {
    if (mark[c] != kMissing) continue;
    if (agrees(points_in(c), height_of, region.cell_points_min, low, high))
      mark[c] = kSeen;
    else
      ++result.cells_missing;
  }
  // The cells' starts have served too: they lend their room to the search.
  result.hole_mm2 = static_cast<double>(largest_hole(grid, mark, work.cell_start)) * region.cell_mm * region.cell_mm;
  const double missing_max = region.cells_missing_max * static_cast<double>(expected);
  if (2 * std::size_t{result.cells} < expected || static_cast<double>(result.cells_missing) > missing_max ||
      result.hole_mm2 > kHole_mm2)
    return result;

  const std::span<const Vec3> means(work.cell_mean.data(), result.cells);
  const PlaneFit plane = fit_plane_lsq(means, seat.normal);
  if (!plane.ok) return result;
  low = std::numeric_limits<double>::infinity();
  high = -low;
  for (const Vec3& p : means) {
    const double h = plane.normal.dot(p) - plane.offset_mm;
    low = std::min(low, h);
    high = std::max(high, h);
  }
  result.ok = true;
  result.lsq_mm = high - low;
  result.std_cells_mm = plane.std_mm;
  result.min_zone_mm = minimum_zone_mm(means);
  return result;
}

}  // namespace slabd::algo
