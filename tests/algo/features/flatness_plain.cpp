// SPDX-License-Identifier: Apache-2.0
//
// Flatness with the points sorted by cell; the rules are described in algo/features/flatness.cpp.
#include "plain_features.h"

#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <vector>

#include "algo/algo.h"
#include "algo/features/seat_cells.h"
#include "algo/features/seat_noise.h"
#include "algo/moments.h"

namespace slabd::algo::plain {
namespace {

/// Maximum number of points of a cell for its median; a cell of a dense scan contains about 80.
constexpr std::size_t kCellSampleMax = 512;
/// A stray is this many robust deviations from its cell's median ...
constexpr double kStraySigmas = 5.0;
/// ... and at least this far: a slope or step within a cell is not a stray.
constexpr double kStrayMin_mm = 0.15;
/// Scatter of a cell up to this factor above that of most cells counts as noise.
constexpr double kNoisierCell = 3.0;
/// A cell closer to the seat than this is never a defect, even in a quiet scan: the resolution of float coordinates is
/// a tenth of it.
constexpr double kDefectMin_mm = 0.001;
/// A hole in the data that may hide a relevant defect: 10 x 10 mm.
constexpr double kHole_mm2 = 100.0;

/// Sorts `index` by cell in place: every entry moves directly to the next free place of its cell.
template <typename CellOf>
void sort_by_cell(std::span<std::uint32_t> index, std::size_t cells, const FlatnessMemory& work,
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

/// Median and robust deviation of up to kCellSampleMax heights, sampled evenly.
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

/// Minimum number of points for a cell to be seen.
std::size_t few_of(std::uint32_t points_min) {
  return std::max<std::size_t>(1, (points_min + 2) / 3);
}

/// A cell's mean point without strays, and the scatter of its points about it.
struct CellPoints {
  Vec3 mean = Vec3::Zero();
  std::uint32_t used = 0;
  double squares = 0.0;  ///< of heights about their mean, mm^2
};

/// Range of heights that count in a cell.
struct Window {
  double low = -std::numeric_limits<double>::infinity();
  double high = std::numeric_limits<double>::infinity();
  bool damage = false;    ///< for connected points that would otherwise be strays
  bool both = false;      ///< damage on the other side as well
  double rest_low = 0.0;  ///< with damage: heights of the other points without strays of the other side, or that side's
  double rest_high = 0.0;
};

/// Mean point of a cell's points in the window. False if too few remain.
template <typename PointOf>
bool cell_mean(std::span<const std::uint32_t> index, const PointOf& point_of, const PlaneFit& seat,
               std::uint32_t points_min, const Window& window, CellPoints& cell) {
  if (index.empty() || index.size() < points_min) return false;
  const auto height_of = [&](std::uint32_t i) { return seat.normal.dot(point_of(i)) - seat.offset_mm; };
  Vec3 sum = Vec3::Zero();
  std::vector<double> kept;
  for (const std::uint32_t i : index) {
    if (height_of(i) < window.low || height_of(i) > window.high) continue;
    sum += point_of(i);
    kept.push_back(height_of(i));
  }
  cell.used = static_cast<std::uint32_t>(kept.size());
  if (cell.used == 0 || (cell.used < points_min && !window.damage)) return false;
  cell.mean = sum / static_cast<double>(cell.used);
  ScalarMoments heights(0.0);
  for (const double h : kept) heights.add(h - kept[0]);
  heights.close_block();
  cell.squares = cell.used > 1 ? heights.variance(1) * static_cast<double>(cell.used - 1) : 0.0;
  return true;
}

/// The usual scatter of the points of a full cell, from a sample of 512 cells.
template <typename PointsIn, typename HeightOf>
double scatter_in_full_cells(const CellGrid& grid, const PointsIn& points_in, const HeightOf& height_of,
                             std::uint32_t points_min) {
  std::vector<double> sigma;
  for (std::size_t c = 0; c < grid.cells(); c += grid.cells() / 512 + 1) {
    const auto cell = points_in(c);
    if (cell.size() < std::max(points_min, 2U)) continue;
    ScalarMoments heights(0.0);
    for (const std::uint32_t i : cell) heights.add(height_of(i));
    heights.close_block();
    sigma.push_back(std::sqrt(heights.variance(1)));
  }
  if (sigma.empty()) return kNoValue;
  const auto middle = sigma.begin() + static_cast<std::ptrdiff_t>(sigma.size() / 2);
  std::nth_element(sigma.begin(), middle, sigma.end());
  return *middle;
}

/// The windows of all cells: strays are excluded. If half a cell's worth of them or more is connected, the rest is.
template <typename PointsIn, typename HeightOf>
std::vector<Window> windows_of(const CellGrid& grid, const PointsIn& points_in, const HeightOf& height_of,
                               std::uint32_t points_min) {
  std::vector<Window> windows(grid.cells());
  double points = 0.0;
  double full = 0.0;
  const double usual = scatter_in_full_cells(grid, points_in, height_of, points_min);
  for (std::size_t c = 0; c < grid.cells(); ++c) {
    const auto cell = points_in(c);
    const bool is_full = !cell.empty() && cell.size() >= points_min;
    if (is_full) {
      points += static_cast<double>(cell.size());
      full += 1.0;
    } else if (!grid.expected(c) || cell.size() < few_of(points_min)) {
      continue;
    }
    const CellCentre centre = centre_of(cell, height_of);
    const double sigma = std::fmin(centre.sigma, (is_full ? kNoisierCell : 1.0) * usual);
    const double reach = std::max(kStraySigmas * sigma, kStrayMin_mm);
    windows[c] = {centre.median - reach, centre.median + reach};
  }
  struct Side {
    std::vector<int> strays;
    std::vector<double> height;  ///< sum over them
    std::vector<bool> damage;
  };
  const auto damage_of = [&](CellMark side) {
    Side found{std::vector<int>(grid.cells()), std::vector<double>(grid.cells()), std::vector<bool>(grid.cells())};
    std::vector<std::uint32_t> mark(grid.cells());
    std::vector<std::uint32_t> stack(grid.cells() + 1);
    for (std::size_t c = 0; c < grid.cells(); ++c) {
      // A point closer to the seat than the cell's median is the seat.
      const double median = 0.5 * (windows[c].low + windows[c].high);
      for (const std::uint32_t i : points_in(c)) {
        const double h = height_of(i);
        const bool out = side == kHigh ? h > windows[c].high && h > -median : h < windows[c].low && h < -median;
        found.strays[c] += out ? 1 : 0;
        found.height[c] += out ? h : 0.0;
      }
      const double many = std::fmax(2.0, 0.05 * static_cast<double>(points_in(c).size()));
      mark[c] = found.strays[c] >= many ? side : kPlain;
    }
    for_each_group(grid, side, mark, stack, [&](std::span<const std::uint32_t> group) {
      double together = 0.0;
      for (const std::uint32_t c : group) together += found.strays[c];
      if (together < 0.5 * points / full) return;
      for (const std::uint32_t c : group) found.damage[c] = true;
    });
    return found;
  };
  const Side above = damage_of(kHigh);
  const Side below = damage_of(kLow);
  for (std::size_t c = 0; c < grid.cells(); ++c) {
    const Window middle = windows[c];
    const Window high{middle.high + 1e-9, Window{}.high, true, false, middle.low, middle.high};
    const Window low{Window{}.low, middle.low - 1e-9, true, false, middle.low, middle.high};
    if (above.damage[c] && below.damage[c]) {
      const bool up = above.height[c] / above.strays[c] >= -below.height[c] / below.strays[c];
      windows[c] = up ? Window{high.low, high.high, true, true, low.low, low.high}
                      : Window{low.low, low.high, true, true, high.low, high.high};
    } else if (above.damage[c] || below.damage[c]) {
      windows[c] = above.damage[c] ? high : low;
    }
  }
  return windows;
}

/// All cells that have a mean.
struct CellHeights {
  std::array<double, limits::kFlatnessCellsMax> height;  ///< of the mean above the seat, mm
  std::array<std::uint32_t, limits::kFlatnessCellsMax> cell;
  std::size_t size = 0;
  double points = 0.0;   ///< sum over all of them
  double squares = 0.0;  ///< of single points about their cell's mean, mm^2

  [[nodiscard]] double points_per_cell() const { return points / static_cast<double>(size); }
};

/// Marks the cells of the defect channel and returns its limit. In a coarse scan some cells have few points; these have
/// more noise and a larger limit.
template <typename PointsIn>
double mark_defects(const CellHeights& cells, const PointsIn& points_in, double seat_std_mm, double sigmas,
                    std::span<std::uint32_t> mark) {
  std::array<double, limits::kFlatnessCellsMax> size;
  for (std::size_t k = 0; k < cells.size; ++k) size[k] = std::abs(cells.height[k]);
  const auto middle = size.begin() + static_cast<std::ptrdiff_t>(cells.size / 2);
  std::nth_element(size.begin(), middle, size.begin() + static_cast<std::ptrdiff_t>(cells.size));
  const double robust = 1.4826 * *middle;
  const double usual = seat_std_mm / std::sqrt(cells.points_per_cell());
  for (std::size_t k = 0; k < cells.size; ++k) {
    const double own = seat_std_mm / std::sqrt(static_cast<double>(points_in(cells.cell[k]).size()));
    const double limit = std::fmax(sigmas * std::fmax(robust * std::fmax(own / usual, 1.0), own), kDefectMin_mm);
    if (cells.height[k] > limit) mark[cells.cell[k]] = kHigh;
    if (cells.height[k] < -limit) mark[cells.cell[k]] = kLow;
  }
  return std::fmax(sigmas * std::fmax(robust, usual), kDefectMin_mm);
}

/// Finds the largest group of cells marked `side`, if it is larger than the one in `defect`: each cell takes the lowest
/// number of its neighbours, corners included, until none changes. Removes the marks.
void find_defect(const CellGrid& grid, CellMark side, const CellHeights& cells, std::span<std::uint32_t> mark,
                 SurfaceDefect& defect) {
  std::map<std::uint32_t, std::uint32_t> group_of;
  std::map<std::uint32_t, double> height_of;
  for (std::size_t k = 0; k < cells.size; ++k) {
    const std::uint32_t cell = cells.cell[k];
    if (mark[cell] != side) continue;
    mark[cell] = kPlain;
    group_of[cell] = cell;
    height_of[cell] = cells.height[k];
  }
  const auto adjacent = [&](std::uint32_t a, std::uint32_t b) {
    const auto apart = [](std::size_t m, std::size_t n) { return std::max(m, n) - std::min(m, n); };
    return apart(a % grid.columns, b % grid.columns) <= 1 && apart(a / grid.columns, b / grid.columns) <= 1;
  };
  for (bool changed = true; changed;) {
    changed = false;
    for (auto& [cell, group] : group_of) {
      for (const auto& [other, lower] : group_of) {
        if (lower >= group || !adjacent(cell, other)) continue;
        group = lower;
        changed = true;
      }
    }
  }
  std::map<std::uint32_t, std::vector<std::uint32_t>> groups;
  for (const auto& [cell, group] : group_of) groups[group].push_back(cell);
  for (const auto& [first, group] : groups) {
    if (group.size() <= defect.cells) continue;
    const auto n = static_cast<double>(group.size());
    defect = {.limit_mm = defect.limit_mm};
    defect.cells = static_cast<std::uint32_t>(group.size());
    defect.area_mm2 = n * std::pow(grid.region.cell_mm, 2);
    for (const std::uint32_t cell : group) {
      defect.x_mm += grid.x_of(cell) / n;
      defect.s_mm += grid.s_of(cell) / n;
      if (std::abs(height_of[cell]) > std::abs(defect.height_mm)) defect.height_mm = height_of[cell];
    }
  }
}

/// Expected range of `count` means. Those of few points may have a larger range than all would if they were alike.
double noise_range(std::size_t count, std::vector<double> variance) {
  const auto mean_of = [](const std::vector<double>& v) {
    double sum = 0.0;
    for (const double x : v) sum += x;
    return sum / static_cast<double>(v.size());
  };
  double range = expected_range(count);
  for (double below = 1.0; below < 1e9; below *= 2.0) {
    std::vector<double> few;
    for (const double v : variance)
      if (v > 1.0 / below * (1.0 + 1e-12)) few.push_back(v);
    if (few.empty() || few.size() == variance.size()) continue;
    range = std::fmax(range, expected_range(few.size()) * std::sqrt(mean_of(few) / mean_of(variance)));
  }
  return range;
}

/// Position and height of a cell, its number of points, and the share of its points at that height.
struct SeenCell {
  double x, s, height, points, share;
};

/// Share of the cells on the seat, and change of the plane if all of these have equal weight.
void weigh_by_area(const std::vector<SeenCell>& cells, const Vec3& along_seat, const PlaneFit& seat, Flatness& result) {
  const double reach = std::max(3.0 * seat.std_mm, kStrayMin_mm);
  std::vector<SeenCell> on;
  double share = 0.0;
  for (const SeenCell& cell : cells) {
    const bool there = std::abs(cell.height) <= reach;
    share += there ? 1.0 : 1.0 - cell.share;
    if (there) on.push_back(cell);
  }
  result.seat_share = share / static_cast<double>(cells.size());
  const auto fit = [&](bool by_area) {
    Eigen::MatrixXd A(static_cast<Eigen::Index>(on.size()), 3);
    Eigen::VectorXd b(A.rows());
    for (Eigen::Index i = 0; i < A.rows(); ++i) {
      const SeenCell& cell = on[static_cast<std::size_t>(i)];
      const double root = by_area ? 1.0 : std::sqrt(cell.points);
      A.row(i) << root, root * cell.x, root * cell.s;
      b[i] = root * cell.height;
    }
    return Vec3(A.colPivHouseholderQr().solve(b));
  };
  const Vec3 a = fit(true) - fit(false);
  const Vec3 uphill = a[1] * Vec3::UnitX() + a[2] * along_seat;
  result.by_area.normal = seat.normal.dot(uphill) * seat.normal - uphill;
  result.by_area.height_mm = a[0] + a[1] * seat.centroid.x() + a[2] * along_seat.dot(seat.centroid);
}

}  // namespace

Flatness measure_flatness(const float* xyz, std::span<std::uint32_t> index, const FastTransform& T_block_scanner,
                          const Vec3& along_seat, const PlaneFit& seat, const FlatnessRegion& region,
                          const FlatnessMemory& work) {
  Flatness result;
  const CellGrid grid(region);
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

  const auto cell_of = [&](const Vec3& p) {
    const double column = (p.x() + region.half_x_mm) / region.cell_mm;
    const double row = (along_seat.dot(p) + region.half_s_mm) / region.cell_mm;
    const std::size_t c = std::min(static_cast<std::size_t>(std::max(column, 0.0)), grid.columns - 1);
    const std::size_t r = std::min(static_cast<std::size_t>(std::max(row, 0.0)), grid.rows - 1);
    return r * grid.columns + c;
  };
  sort_by_cell(index, grid.cells(), work, [&](std::uint32_t i) { return cell_of(point_of(i)); });
  const auto points_in = [&](std::size_t c) -> std::span<const std::uint32_t> {
    return index.subspan(work.cell_start[c], work.cell_start[c + 1] - work.cell_start[c]);
  };
  // Sorting is done with cell_next; from here on it contains the marks.
  const std::span<std::uint32_t> mark = work.cell_next.first(grid.cells());
  const std::vector<Window> windows = windows_of(grid, points_in, height_of, region.cell_points_min);
  std::size_t expected = 0;
  std::vector<SeenCell> seen;
  CellHeights cells;
  std::vector<CellPoints> added;
  const auto add = [&](std::size_t c, const CellPoints& cell) {
    added.push_back(cell);
    work.cell_mean[cells.size] = cell.mean;
    cells.height[cells.size] = seat.normal.dot(cell.mean) - seat.offset_mm;
    cells.cell[cells.size++] = static_cast<std::uint32_t>(c);
    cells.points += static_cast<double>(cell.used);
    cells.squares += cell.squares;
  };
  for (std::size_t c = 0; c < grid.cells(); ++c) {
    mark[c] = kPlain;
    const bool wanted = grid.expected(c);
    if (wanted) ++expected;
    CellPoints cell;
    const bool full = cell_mean(points_in(c), point_of, seat, region.cell_points_min, windows[c], cell);
    const bool sparse = !full && wanted && points_in(c).size() >= few_of(region.cell_points_min) &&
                        cell_mean(points_in(c), point_of, seat, 1, windows[c], cell);
    if (full) ++result.cells;
    if (full || sparse) {
      add(c, cell);
      const auto used = static_cast<double>(cell.used);
      seen.push_back({cell.mean.x(), along_seat.dot(cell.mean), seat.normal.dot(cell.mean) - seat.offset_mm, used,
                      windows[c].damage ? used / static_cast<double>(points_in(c).size()) : 1.0});
    } else if (wanted) {
      mark[c] = kMissing;
      ++result.cells_missing;
    }
  }
  weigh_by_area(seen, along_seat, seat, result);
  if (cells.size > 0) result.defect.limit_mm = mark_defects(cells, points_in, seat.std_mm, region.defect_sigmas, mark);
  std::vector<Vec3> beside_damage;
  for (std::size_t k = 0; k < cells.size; ++k) {
    const Window& window = windows[cells.cell[k]];
    CellPoints rest;
    const std::uint32_t enough = window.both ? 1 : static_cast<std::uint32_t>(few_of(region.cell_points_min));
    if (window.damage &&
        cell_mean(points_in(cells.cell[k]), point_of, seat, enough, Window{window.rest_low, window.rest_high}, rest))
      beside_damage.push_back(rest.mean);
  }
  // Damage does not count as noise.
  CellHeights quiet;
  std::vector<double> variance;
  for (std::size_t k = 0; k < cells.size; ++k) {
    const std::uint32_t c = cells.cell[k];
    if (mark[c] != kPlain || windows[c].damage) continue;
    variance.push_back(1.0 / static_cast<double>(added[k].used));
    quiet.height[quiet.size] = cells.height[k];
    quiet.cell[quiet.size++] = c;
    quiet.points += static_cast<double>(added[k].used);
    quiet.squares += added[k].squares;
  }
  // The cells' starts are no longer needed: their memory is used for the search of groups.
  const std::span<std::uint32_t> stack = work.cell_start;
  std::size_t hole = 0;
  for_each_group(grid, kMissing, mark, stack,
                 [&](std::span<const std::uint32_t> group) { hole = std::max(hole, group.size()); });
  result.hole_mm2 = static_cast<double>(hole) * region.cell_mm * region.cell_mm;
  find_defect(grid, kHigh, cells, mark, result.defect);
  find_defect(grid, kLow, cells, mark, result.defect);
  const double missing_max = region.cells_missing_max * static_cast<double>(expected);
  if (2 * std::size_t{result.cells} < expected || static_cast<double>(result.cells_missing) > missing_max ||
      result.hole_mm2 > kHole_mm2)
    return result;

  const std::span<const Vec3> means(work.cell_mean.data(), cells.size);
  const PlaneFit plane = fit_plane_lsq(means, seat.normal);
  if (!plane.ok) return result;
  low = std::numeric_limits<double>::infinity();
  high = -low;
  const auto reach_to = [&](const Vec3& p) {
    const double h = plane.normal.dot(p) - plane.offset_mm;
    low = std::min(low, h);
    high = std::max(high, h);
  };
  for (const Vec3& p : means) reach_to(p);
  for (const Vec3& p : beside_damage) reach_to(p);
  result.ok = true;
  result.lsq_mm = high - low;
  result.std_cells_mm = plane.std_mm;
  result.min_zone_mm = minimum_zone_mm(means);
  const CellNoise noise =
      plain::noise_of_cells(grid, std::span(quiet.height).first(quiet.size), std::span(quiet.cell).first(quiet.size),
                            quiet.squares / (quiet.points - static_cast<double>(quiet.size)), quiet.points_per_cell());
  if (noise.ok) {
    result.noise_factor = noise.factor;
    result.noise_mm = noise_range(cells.size, variance) * noise.cell_sigma_mm;
  }
  return result;
}

}  // namespace slabd::algo::plain
