// SPDX-License-Identifier: Apache-2.0
//
// Which points are noise? A point of a surface has neighbours; a reflection or a speck in the air has none.
//
// The radius is 0.95 mm: at 0.42 mm pitch, the coarsest expected, a point on an 80 degree face still has its two
// neighbours on either side along the contour line (0.84 mm), while the next row down the face is already 2.4 mm away;
// and a speck 1 mm off a level surface is alone. Three of those four suffice, so that one missing point does no harm.
//
// One method for organised and unorganised scans: points are sorted (counting sort of their indices) into square
// cells over the scanner's XY, and each looks through the 3 x 3 cells around its own until it has found three
// neighbours. On a surface that is soon; only specks look at everything.
//
// Invariants: cells are never smaller than the radius, and clamping to the border never moves two points further
// apart in cells, so no neighbour is missed however far a stray point lies.
#include "algo/denoise.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>

namespace slabd::algo {
namespace {

constexpr float kCell_mm = 1.0F;
static_assert(kCell_mm >= kNeighbourRadius_mm, "3 x 3 cells must hold the whole neighbourhood");
/// A point that has looked at so many others is given up; keeps a hostile cloud (all in one cell) bounded.
constexpr int kLookedAtMax = 4096;
/// Points from which the extent of the field is judged.
constexpr std::size_t kExtentSample = 4096;

struct Grid {
  float x0 = 0.0F;
  float y0 = 0.0F;
  float per_mm = 1.0F;
  int width = 1;
  int height = 1;

  [[nodiscard]] static int clamped(float cell, int count) {
    // Compared as float first: a stray coordinate of 1e30 has no int.
    if (!(cell > 0.0F)) return 0;
    if (cell >= static_cast<float>(count)) return count - 1;
    return static_cast<int>(cell);
  }
  [[nodiscard]] int column(const float* p) const { return clamped((p[0] - x0) * per_mm, width); }
  [[nodiscard]] int row(const float* p) const { return clamped((p[1] - y0) * per_mm, height); }
  [[nodiscard]] std::size_t cell(const float* p) const {
    return static_cast<std::size_t>(row(p)) * static_cast<std::size_t>(width) + static_cast<std::size_t>(column(p));
  }
};

bool finite(const float* p) {
  return std::isfinite(p[0]) && std::isfinite(p[1]) && std::isfinite(p[2]);
}

std::size_t drop_missing(Cloud& cloud) {
  float* xyz = cloud.xyz.data();
  std::size_t kept = 0;
  for (std::size_t i = 0; i < cloud.points; ++i) {
    const float* p = xyz + 3 * i;
    if (!finite(p)) continue;
    float* to = xyz + 3 * kept++;
    to[0] = p[0];
    to[1] = p[1];
    to[2] = p[2];
  }
  return kept;
}

/// Where nearly all points lie along one axis: the central 98 % of a sample and a twentieth more on each side. Strays
/// outside share the border cells.
void extent(const float* xyz, std::size_t points, std::size_t axis, float& low, float& high) {
  std::array<float, kExtentSample> sample;
  const std::size_t m = std::min(points, sample.size());
  for (std::size_t i = 0; i < m; ++i) sample[i] = xyz[3 * (i * points / m) + axis];
  const auto begin = sample.begin();
  const auto end = begin + static_cast<std::ptrdiff_t>(m);
  const auto low_at = begin + static_cast<std::ptrdiff_t>(m / 100);
  const auto high_at = begin + static_cast<std::ptrdiff_t>(m - 1 - m / 100);
  std::nth_element(begin, low_at, end);
  low = *low_at;
  std::nth_element(begin, high_at, end);
  high = *high_at;
  const float margin = 0.05F * (high - low) + kCell_mm;
  // A kilometre is no field of view; without this bound an absurd coordinate overflows the arithmetic of the grid.
  constexpr float kFar_mm = 1e6F;
  low = std::clamp(low - margin, -kFar_mm, kFar_mm);
  high = std::clamp(high + margin, -kFar_mm, kFar_mm);
}

Grid make_grid(const float* xyz, std::size_t points) {
  float x1 = 0.0F;
  float y1 = 0.0F;
  Grid grid;
  extent(xyz, points, 0, grid.x0, x1);
  extent(xyz, points, 1, grid.y0, y1);
  const double wide_mm = static_cast<double>(x1) - static_cast<double>(grid.x0);
  const double high_mm = static_cast<double>(y1) - static_cast<double>(grid.y0);
  // Two per cent larger than the area asks for, and then as large as the longer side asks for: never too many cells.
  const auto cells_max = static_cast<double>(limits::kDenoiseCellsMax);
  double cell_mm = std::max(static_cast<double>(kCell_mm), 1.02 * std::sqrt(wide_mm * high_mm / cells_max));
  cell_mm = std::max(cell_mm, 4.0 * std::max(wide_mm, high_mm) / cells_max);
  const auto count = [&](double length_mm) { return std::max(1, static_cast<int>(std::ceil(length_mm / cell_mm))); };
  grid.width = count(wide_mm);
  grid.height = count(high_mm);
  while (static_cast<std::size_t>(grid.width) * static_cast<std::size_t>(grid.height) > limits::kDenoiseCellsMax) {
    cell_mm *= 1.1;
    grid.width = count(wide_mm);
    grid.height = count(high_mm);
  }
  grid.per_mm = static_cast<float>(1.0 / cell_mm);
  return grid;
}

/// Counting sort of point indices by cell: cell c holds order[start[c] .. start[c + 1]), in the original order.
void sort_into_cells(const float* xyz, std::size_t points, const Grid& grid, const DenoiseWorkspace& work) {
  const std::size_t cells = static_cast<std::size_t>(grid.width) * static_cast<std::size_t>(grid.height);
  const std::span<std::uint32_t> start = work.cell_start.first(cells + 1);
  std::fill(start.begin(), start.end(), 0U);
  for (std::size_t i = 0; i < points; ++i) ++start[grid.cell(xyz + 3 * i) + 1];
  for (std::size_t c = 0; c < cells; ++c) start[c + 1] += start[c];
  // Filling moves each start to the next cell's; filling from the back moves it from its end to its start instead.
  for (std::size_t i = points; i-- > 0;) {
    const std::size_t c = grid.cell(xyz + 3 * i);
    work.order[--start[c + 1]] = static_cast<std::uint32_t>(i);
  }
  // start[c + 1] now holds the start of cell c: shift by one.
  for (std::size_t c = 0; c < cells; ++c) start[c] = start[c + 1];
  start[cells] = static_cast<std::uint32_t>(points);
}

bool has_neighbours(const float* xyz, std::uint32_t self, const Grid& grid, const DenoiseWorkspace& work) {
  constexpr float kRadius2 = kNeighbourRadius_mm * kNeighbourRadius_mm;
  const float* p = xyz + 3 * std::size_t{self};
  const int column = grid.column(p);
  const int row = grid.row(p);
  const auto first_column = static_cast<std::size_t>(std::max(column - 1, 0));
  const auto last_column = static_cast<std::size_t>(std::min(column + 1, grid.width - 1));
  int found = 0;
  int looked_at = 0;
  // The own row first: that is where a surface's neighbours usually are.
  for (const int step : {0, -1, 1}) {
    const int r = row + step;
    if (r < 0 || r >= grid.height) continue;
    const std::size_t base = static_cast<std::size_t>(r) * static_cast<std::size_t>(grid.width);
    const std::uint32_t end = work.cell_start[base + last_column + 1];
    for (std::uint32_t k = work.cell_start[base + first_column]; k < end; ++k) {
      if (++looked_at > kLookedAtMax) return false;
      const float* q = xyz + 3 * std::size_t{work.order[k]};
      const float dx = q[0] - p[0];
      const float dy = q[1] - p[1];
      const float dz = q[2] - p[2];
      if (dx * dx + dy * dy + dz * dz > kRadius2 || work.order[k] == self) continue;
      if (++found == kNeighboursMin) return true;
    }
  }
  return false;
}

}  // namespace

void remove_isolated(Cloud& cloud, const DenoiseWorkspace& work, ScanCounts& counts) {
  counts = ScanCounts{};
  counts.points_read = cloud.points;
  cloud.points = drop_missing(cloud);
  cloud.width = cloud.height = 0;
  counts.points_finite = cloud.points;
  if (cloud.points == 0) return;
  assert(cloud.points <= work.order.size() && cloud.points <= work.keep.size());

  float* xyz = cloud.xyz.data();
  const std::size_t points = cloud.points;
  const Grid grid = make_grid(xyz, points);
  sort_into_cells(xyz, points, grid, work);
  // In cell order: the neighbours are still in the cache from the point before.
  for (std::size_t k = 0; k < points; ++k) {
    const std::uint32_t i = work.order[k];
    work.keep[i] = has_neighbours(xyz, i, grid, work) ? 1 : 0;
  }
  std::size_t kept = 0;
  for (std::size_t i = 0; i < points; ++i) {
    if (work.keep[i] == 0) continue;
    std::copy_n(xyz + 3 * i, 3, xyz + 3 * kept);
    ++kept;
  }
  cloud.points = kept;
  counts.points_kept = kept;
  counts.isolated_removed = points - kept;
}

}  // namespace slabd::algo
