// SPDX-License-Identifier: Apache-2.0
//
// Definition of flatness. The peak to valley of single points is mostly noise (0.27 mm of it on a perfect plane with
// 0.03 mm noise). So heights are averaged over cells of 1.5 mm first, a box filter, and flatness is the peak to valley
// of the cell means to their own least-squares plane; the minimum zone is reported as well. Averaging must not hide a
// chip: single-point extremes are reported too. A cell mean leaves out only points that disagree with the majority of
// their own cell and are not connected. Strays are single. A fin, a ridge or a crack, however narrow, touches many
// cells, and from half a cell's worth of points on it is the height of those cells: averaged with the surface next to
// it, a fin of 2 mm would read half a millimetre. A crack with raised lips counts as both its depth and its lips.
//
// Places that were not seen have no known flatness, so flatness is not measured (no value, hence no pass) if
//   - fewer than half of the cells contain cell_points_min points,
//   - more than cells_missing_max of the cells are missing, or
//   - missing cells that touch make a hole of more than 100 mm^2.
// A cell is missing if it contains less than a third of cell_points_min. A coarse scan has many cells a few points
// below the limit, in rows and columns, and one of two exposures may have missed half of the seat. Those are not holes:
// their points show the seat, or a chip, which returns few points in the shadow of its own rim. They are sparse and
// count like any other cell; their mean is less certain, which can only increase a peak to valley. Cells at casings and
// cells cut by the border do not count.
//
// The seat was fitted to points, and a dark or wet surface, or one seen in only one of two merged views, returns fewer
// points per mm^2. Cells have equal areas: they give the share of the area on the fitted seat, and its change if areas
// had weight. Both planes are fitted to the same cells, so damage and noise cancel in their difference.
//
// Flatness is one number, and a small chip affects it no more than a long bow. So cells outside the noise are also
// grouped by contact, and the largest group on one side is reported with its position: the defect channel. It contains
// only places that returned points; a chip so deep or steep that it returned none is a hole. Damaged cells are excluded
// from the noise estimate: ridges in every fourth cell would look like noise of three times their own height.
#include "algo/features/flatness.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>

#include "algo/algo.h"
#include "algo/features/seat_cells.h"
#include "algo/features/seat_noise.h"
#include "algo/median.h"

namespace slabd::algo {
namespace {

/// A cell is in a pit if it is this far below the closed surface; grain, ripple and dust are smaller.
constexpr double kPit_mm = 0.05;
/// ... or by this many standard deviations of a cell, from noise or grain: the range of seven by seven cells.
constexpr double kPitSigmas = 6.0;
/// A burr, a grain of dust or a drop of mortar is at most this high. Anything higher is damage and counts fully.
constexpr double kBump_mm = 0.4;
/// The paper's flatness leaves out a tenth of its points (3.1, 5.2).
constexpr double kTrimmed = 0.9;
/// A cell closer to the seat than this is never a defect, even in a quiet scan: the resolution of float coordinates is
/// a tenth of it.
constexpr double kDefectMin_mm = 0.001;
/// A hole in the data that may hide a relevant defect: 10 x 10 mm.
constexpr double kHole_mm2 = 100.0;
/// Cosine of the tilt relative to the nominal seat: a plane at 60 degrees is not a seat.
constexpr float kUprightMin = 0.5F;

/// All cells that have a mean.
struct CellHeights {
  std::array<double, limits::kFlatnessCellsMax> height;  ///< of the mean above the seat, mm
  std::array<std::uint32_t, limits::kFlatnessCellsMax> cell;
  std::size_t size = 0;
  double points = 0.0;   ///< sum over all of them
  double squares = 0.0;  ///< of single points about their cell's mean, mm^2

  [[nodiscard]] double points_per_cell() const { return points / static_cast<double>(size); }
  [[nodiscard]] double within_variance_mm2() const { return squares / (points - static_cast<double>(size)); }
};

/// Removes damaged cells from the noise estimate; `damaged` by index in `cells`.
void leave_out(const CellSet& damaged, const SeatCells& sums, CellHeights& cells) {
  if (damaged.none()) return;
  std::size_t left = 0;
  cells.points = cells.squares = 0.0;
  for (std::size_t k = 0; k < cells.size; ++k) {
    if (damaged[k]) continue;
    const CellSum& sum = sums[cells.cell[k]];
    cells.points += static_cast<double>(sum.points);
    cells.squares += CellPoints(sum).squares;
    cells.height[left] = cells.height[k];
    cells.cell[left++] = cells.cell[k];
  }
  cells.size = left;
}

/// Difference of adjacent cells as a standard deviation: grain and the remaining noise.
double grain_mm(const CellGrid& grid, const CellHeights& cells) {
  std::array<double, limits::kFlatnessCellsMax> size;
  std::size_t count = 0;
  for (std::size_t k = 1; k < cells.size; ++k)
    if (cells.cell[k] == cells.cell[k - 1] + 1 && cells.cell[k] % grid.columns != 0)
      size[count++] = std::abs(cells.height[k] - cells.height[k - 1]);
  // Converts the median difference to a standard deviation of one cell.
  constexpr double kPerMedian = 1.4826 / 1.4142;
  return count > 0 ? kPerMedian * median_of(std::span(size).first(count)) : 0.0;
}

/// Expected range of `count` means from noise alone, in standard deviations of a cell. `quiet` are cells without damage
/// and give the number of points per mean. Means of few points scatter further, so a part of the cells may have a
/// larger range than all of them would if they were alike.
double noise_range(std::size_t count, const CellHeights& quiet, const SeatCells& sums) {
  // Cells with less than 2^k points, k from 0 on.
  std::array<double, 33> cells{};
  std::array<double, 33> variance{};
  double all = 0.0;
  for (std::size_t k = 0; k < quiet.size; ++k) {
    const std::uint32_t points = sums[quiet.cell[k]].points;
    const auto size = static_cast<std::size_t>(std::bit_width(points));
    cells[size] += 1.0;
    variance[size] += 1.0 / static_cast<double>(points);
    all += 1.0 / static_cast<double>(points);
  }
  const auto quiet_cells = static_cast<double>(quiet.size);
  double range = expected_range(count);
  double few = 0.0;
  double of_few = 0.0;
  for (std::size_t k = 0; k < cells.size() && few + cells[k] < quiet_cells; ++k) {
    if (cells[k] == 0.0) continue;
    few += cells[k];
    of_few += variance[k];
    const double wider = std::sqrt(of_few / few * quiet_cells / all);
    range = std::fmax(range, expected_range(static_cast<std::size_t>(few)) * wider);
  }
  return range;
}

/// Marks the cells of the defect channel and returns its limit. In a coarse scan some cells have few points; these have
/// more noise and a larger limit.
template <typename PointsIn>
double mark_defects(const CellHeights& cells, const PointsIn& points_in, double seat_std_mm, double sigmas,
                    std::span<std::uint32_t> mark) {
  std::array<double, limits::kFlatnessCellsMax> size;
  for (std::size_t k = 0; k < cells.size; ++k) size[k] = std::abs(cells.height[k]);
  const double robust = 1.4826 * median_of(std::span(size).first(cells.size));
  const double usual = seat_std_mm / std::sqrt(cells.points_per_cell());
  const double least = std::fmax(sigmas * robust, kDefectMin_mm);
  for (std::size_t k = 0; k < cells.size; ++k) {
    if (std::abs(cells.height[k]) <= least) continue;  // every limit is at least this
    const double own = seat_std_mm / std::sqrt(static_cast<double>(points_in(cells.cell[k])));
    const double limit = std::fmax(sigmas * std::fmax(robust * std::fmax(own / usual, 1.0), own), kDefectMin_mm);
    if (cells.height[k] > limit) mark[cells.cell[k]] = kHigh;
    if (cells.height[k] < -limit) mark[cells.cell[k]] = kLow;
  }
  return std::fmax(sigmas * std::fmax(robust, usual), kDefectMin_mm);
}

/// Finds the largest group of cells marked `side`, if it is larger than the one in `defect`.
void find_defect(const CellGrid& grid, CellMark side, const CellHeights& cells, std::span<std::uint32_t> mark,
                 std::span<std::uint32_t> stack, SurfaceDefect& defect) {
  for_each_group(grid, side, mark, stack, [&](std::span<const std::uint32_t> group) {
    if (group.size() <= defect.cells) return;
    defect.cells = static_cast<std::uint32_t>(group.size());
    defect.area_mm2 = static_cast<double>(group.size()) * grid.region.cell_mm * grid.region.cell_mm;
    defect.height_mm = defect.x_mm = defect.s_mm = 0.0;
    for (const std::uint32_t cell : group) {
      defect.x_mm += grid.x_of(cell) / static_cast<double>(group.size());
      defect.s_mm += grid.s_of(cell) / static_cast<double>(group.size());
      const auto end = cells.cell.begin() + static_cast<std::ptrdiff_t>(cells.size);
      const auto k = std::lower_bound(cells.cell.begin(), end, cell) - cells.cell.begin();
      const double height = cells.height[static_cast<std::size_t>(k)];
      if (std::abs(height) > std::abs(defect.height_mm)) defect.height_mm = height;
    }
  });
}

/// Plane fit through heights: h = a0 + a1 x + a2 s.
class HeightsFit {
 public:
  void add(double x, double s, double h, double weight) {
    A_(0, 0) += weight;
    A_(0, 1) += weight * x;
    A_(0, 2) += weight * s;
    A_(1, 1) += weight * x * x;
    A_(1, 2) += weight * x * s;
    A_(2, 2) += weight * s * s;
    b_ += weight * h * Vec3(1.0, x, s);
  }
  /// False if the positions do not determine a tilt.
  [[nodiscard]] bool solve(Vec3& a) const {
    Mat3 A = A_;
    A(1, 0) = A(0, 1);
    A(2, 0) = A(0, 2);
    A(2, 1) = A(1, 2);
    a = A.ldlt().solve(b_);
    return a.allFinite();
  }

 private:
  Mat3 A_ = Mat3::Zero();
  Vec3 b_ = Vec3::Zero();
};

/// The seat by area: each cell has the same weight, independent of its number of points.
class SeatByArea {
 public:
  /// Distance within which a cell is on the seat. The fit took points within three of its noise; a bow at which it
  /// converged is as wide as three standard deviations of the residuals.
  explicit SeatByArea(const PlaneFit& seat)
      : reach_mm_(std::max(has_value(seat.std_mm) ? 3.0 * seat.std_mm : 0.0, kStrayMin_mm)) {}

  /// Adds a cell of `points` points; `share` of them are at its height, the others on the seat.
  void add(double x, double s, double height, std::uint32_t points, double share) {
    seen_ += 1.0;
    if (std::abs(height) > reach_mm_) {
      on_seat_ += 1.0 - share;
      return;
    }
    on_seat_ += 1.0;
    by_area_.add(x, s, height, 1.0);
    by_points_.add(x, s, height, static_cast<double>(points));
  }
  [[nodiscard]] double share() const { return seen_ > 0.0 ? on_seat_ / seen_ : kNoValue; }
  /// Difference between the fit with equal points per mm^2 and the actual fit.
  [[nodiscard]] PlaneShift shift(const SeatFrame& frame, const PlaneFit& seat) const {
    Vec3 area;
    Vec3 points;
    if (!by_area_.solve(area) || !by_points_.solve(points)) return {};
    const Vec3 a = area - points;
    const Vec3 at = frame.in_seat(seat.centroid);
    const Vec3 uphill = a[1] * frame.along_rail + a[2] * frame.along_seat;
    return {seat.normal.dot(uphill) * seat.normal - uphill, a[0] + a[1] * at[0] + a[2] * at[1]};
  }

 private:
  double reach_mm_;
  double seen_ = 0.0;
  double on_seat_ = 0.0;
  HeightsFit by_area_;
  HeightsFit by_points_;
};

CellLayout layout_of(const CellGrid& grid, const SeatFrame& frame, const PlaneFit& seat) {
  CellLayout layout;
  layout.half_x_mm = static_cast<float>(grid.region.half_x_mm);
  layout.half_s_mm = static_cast<float>(grid.region.half_s_mm);
  layout.cells_per_mm = static_cast<float>(1.0 / grid.region.cell_mm);
  layout.columns = static_cast<std::int32_t>(grid.columns);
  layout.rows = static_cast<std::int32_t>(grid.rows);
  layout.by_x = static_cast<float>(seat.normal.dot(frame.along_rail));
  layout.by_s = static_cast<float>(seat.normal.dot(frame.along_seat));
  layout.by_h = static_cast<float>(seat.normal.dot(frame.up));
  layout.offset_mm = static_cast<float>(seat.normal.dot(frame.origin) - seat.offset_mm);
  return layout;
}

/// Converts the height above the fitted seat back to a point of the block frame.
Vec3 in_block(const CellPoints& cell, const CellLayout& layout, const SeatFrame& frame) {
  const double along_plane = static_cast<double>(layout.by_x) * cell.x + static_cast<double>(layout.by_s) * cell.s;
  const double h =
      (cell.height - along_plane - static_cast<double>(layout.offset_mm)) / static_cast<double>(layout.by_h);
  return frame.in_block(cell.x, cell.s, h);
}

/// Peak to valley without the tenth of the cells furthest from the plane.
double trimmed_range_mm(std::span<const Vec3> means, const PlaneFit& plane) {
  std::array<double, limits::kFlatnessCellsMax> off;
  for (std::size_t k = 0; k < means.size(); ++k) off[k] = std::abs(plane.normal.dot(means[k]) - plane.offset_mm);
  const auto last = static_cast<std::ptrdiff_t>(kTrimmed * static_cast<double>(means.size() - 1));
  std::nth_element(off.begin(), off.begin() + last, off.begin() + static_cast<std::ptrdiff_t>(means.size()));
  const double reach = off[static_cast<std::size_t>(last)];
  double low = 0.0;
  double high = 0.0;
  for (const Vec3& p : means) {
    const double h = plane.normal.dot(p) - plane.offset_mm;
    if (std::abs(h) > reach) continue;
    low = std::min(low, h);
    high = std::max(high, h);
  }
  return high - low;
}

/// Peak to valley of the closed surface's cells without narrow low bumps; NaN if it has none. `means` are at the
/// heights `closed`, and at those of the level surface afterwards; `closed` is negated.
double range_without_bumps_mm(const CellGrid& grid, const CellHeights& cells, std::span<double> closed,
                              const PitSize& size, const Vec3& normal, std::span<Vec3> means,
                              const FlatnessWorkspace& work) {
  for (double& h : closed) h = -h;
  std::array<double, limits::kFlatnessCellsMax> memory;
  const std::span<double> level = std::span(memory).first(closed.size());
  const Closing bumps = close_pits(grid, std::span(cells.cell).first(cells.size), closed, size,
                                   work.mark.first(grid.cells()), work.stack, level);
  if (bumps.pits == 0) return kNoValue;
  for (std::size_t k = 0; k < means.size(); ++k) means[k] -= (level[k] - closed[k]) * normal;
  const PlaneFit plane = fit_plane_lsq(means, normal);
  if (!plane.ok) return kNoValue;
  double low = std::numeric_limits<double>::infinity();
  double high = -low;
  for (const Vec3& p : means) {
    const double h = plane.normal.dot(p) - plane.offset_mm;
    low = std::min(low, h);
    high = std::max(high, h);
  }
  return high - low;
}

/// True if all data fit the workspace, and the fitted seat is not too steep for heights above the nominal one.
bool can_be_measured(std::span<const SeatPoints> runs, const CellGrid& grid, const CellLayout& layout) {
  std::size_t points = 0;
  for (const SeatPoints& run : runs) points += run.size();
  return points > 0 && points <= limits::kSeatPointsMax && runs.size() <= limits::kSeatRunsMax && grid.cells() > 0 &&
         grid.cells() <= limits::kFlatnessCellsMax && layout.by_h > kUprightMin;
}

}  // namespace

Flatness measure_flatness(std::span<const SeatPoints> runs, const SeatFrame& frame, const PlaneFit& seat,
                          const FlatnessRegion& region, const FlatnessWorkspace& work, Team& team) {
  Flatness result;
  const CellGrid grid(region);
  const CellLayout layout = layout_of(grid, frame, seat);
  if (!can_be_measured(runs, grid, layout)) return result;

  SeatCells sums(runs, layout, work);
  sums.sum_up(team);
  double low = std::numeric_limits<double>::infinity();
  double high = -low;
  for (std::size_t c = 0; c < grid.cells(); ++c) {
    low = std::min(low, static_cast<double>(sums[c].low()));
    high = std::max(high, static_cast<double>(sums[c].high()));
  }
  result.raw_low_mm = low;
  result.raw_high_mm = high;
  const std::span<std::uint32_t> mark = work.mark.first(grid.cells());
  sums.remove_strays(grid, mark);

  const auto is_full = [&](std::size_t c) {
    return sums[c].points > 0 && sums.points_in(c) >= region.cell_points_min &&
           (sums[c].points >= region.cell_points_min || sums.is_damage(c));
  };
  std::size_t expected = 0;
  SeatByArea by_area(seat);
  CellHeights cells;
  const auto add = [&](std::size_t c, const CellPoints& cell) {
    work.cell_mean[cells.size] = in_block(cell, layout, frame);
    cells.height[cells.size] = cell.height;
    cells.cell[cells.size++] = static_cast<std::uint32_t>(c);
    cells.points += static_cast<double>(sums[c].points);
    cells.squares += cell.squares;
  };
  for (std::size_t c = 0; c < grid.cells(); ++c) {
    mark[c] = kPlain;
    const bool wanted = grid.expected(c);
    if (wanted) ++expected;
    const bool full = is_full(c) && !sums.is_wet(c);
    if (full) ++result.cells;
    if (full ||
        (wanted && !sums.is_wet(c) && sums[c].points > 0 && sums.points_in(c) >= few_of(region.cell_points_min))) {
      const CellPoints cell(sums[c]);
      add(c, cell);
      const auto points = static_cast<double>(sums[c].points);
      by_area.add(cell.x, cell.s, cell.height, sums[c].points,
                  sums.is_damage(c) ? points / static_cast<double>(sums.points_in(c)) : 1.0);
    } else if (wanted) {
      mark[c] = kMissing;
      ++result.cells_missing;
    }
  }
  result.seat_share = by_area.share();
  result.by_area = by_area.shift(frame, seat);
  const auto points_in = [&](std::size_t c) { return sums.points_in(c); };
  if (cells.size > 0) result.defect.limit_mm = mark_defects(cells, points_in, seat.std_mm, region.defect_sigmas, mark);
  CellSet damaged;
  for (std::size_t k = 0; k < cells.size; ++k)
    damaged[k] = mark[cells.cell[k]] != kPlain || sums.is_damage(cells.cell[k]);
  std::size_t hole = 0;
  for_each_group(grid, kMissing, mark, work.stack,
                 [&](std::span<const std::uint32_t> group) { hole = std::max(hole, group.size()); });
  result.hole_mm2 = static_cast<double>(hole) * region.cell_mm * region.cell_mm;
  find_defect(grid, kHigh, cells, mark, work.stack, result.defect);
  find_defect(grid, kLow, cells, mark, work.stack, result.defect);
  const double missing_max = region.cells_missing_max * static_cast<double>(expected);
  if (2 * std::size_t{result.cells} < expected || static_cast<double>(result.cells_missing) > missing_max ||
      result.hole_mm2 > kHole_mm2)
    return result;

  const std::span<const Vec3> means(work.cell_mean.data(), cells.size);
  PlaneFit plane = fit_plane_lsq(means, seat.normal);
  if (!plane.ok) return result;
  low = std::numeric_limits<double>::infinity();
  high = -low;
  const auto reach_to = [&](const Vec3& p) {
    const double h = plane.normal.dot(p) - plane.offset_mm;
    low = std::min(low, h);
    high = std::max(high, h);
  };
  for (const Vec3& p : means) reach_to(p);
  // If every cell contains a ridge, the cell heights do not show how far it is above its surroundings; and a crack has
  // lips.
  const auto reach_beside = [&](const auto& counts) {
    for (std::size_t k = 0; k < cells.size; ++k) {
      const std::uint32_t c = cells.cell[k];
      const CellSum& beside = sums.beside_damage(c);
      const std::size_t enough = sums.is_damage_of_both_sides(c) ? 1 : few_of(region.cell_points_min);
      if (!sums.is_damage(c) || beside.points < enough) continue;
      if (const CellPoints rest(beside); counts(k, rest.height)) reach_to(in_block(rest, layout, frame));
    }
  };
  reach_beside([](std::size_t, double) { return true; });
  result.ok = true;
  result.lsq_mm = high - low;
  result.std_cells_mm = plane.std_mm;
  result.trimmed_mm = trimmed_range_mm(means, plane);
  result.min_zone_mm = minimum_zone_mm(means);
  const std::span<const double> heights = std::span(cells.height).first(cells.size);
  std::array<double, limits::kFlatnessCellsMax> closed;
  const double cell_mm = seat.std_mm / std::sqrt(cells.points_per_cell());
  PitSize size{region.closing_mm, std::fmax(kPit_mm, kPitSigmas * std::fmax(cell_mm, grain_mm(grid, cells)))};
  const Closing closing = close_pits(grid, std::span(cells.cell).first(cells.size), heights, size, mark, work.stack,
                                     std::span(closed).first(cells.size));
  result.closed_mm = result.lsq_mm;
  result.closed_min_zone_mm = result.min_zone_mm;
  if (closing.pits > 0) {
    for (std::size_t k = 0; k < cells.size; ++k) work.cell_mean[k] += (closed[k] - cells.height[k]) * seat.normal;
    const PlaneFit over = fit_plane_lsq(means, seat.normal);
    if (over.ok) {
      plane = over;
      low = std::numeric_limits<double>::infinity();
      high = -low;
      for (const Vec3& p : means) reach_to(p);
      // The wall of a pit is next to its bottom.
      reach_beside([&](std::size_t k, double height) { return closed[k] == cells.height[k] || height > closed[k]; });
      result.closed_mm = high - low;
      result.closed_min_zone_mm = minimum_zone_mm(means);
    }
  }
  size.most_mm = kBump_mm;
  const double level_mm = range_without_bumps_mm(grid, cells, std::span(closed).first(cells.size), size, seat.normal,
                                                 work.cell_mean.first(cells.size), work);
  if (level_mm < result.closed_mm) result.bumps_mm = result.closed_mm - level_mm;
  leave_out(damaged, sums, cells);
  const CellNoise noise =
      noise_of_cells(grid, std::span(cells.height).first(cells.size), std::span(cells.cell).first(cells.size),
                     cells.within_variance_mm2(), cells.points_per_cell());
  if (noise.ok) {
    result.noise_factor = noise.factor;
    result.noise_mm = noise_range(means.size(), cells, sums) * noise.cell_sigma_mm;
  }
  return result;
}

}  // namespace slabd::algo
