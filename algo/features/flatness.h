// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "algo/features/cell_sums.h"
#include "algo/features/seat_points.h"
#include "base/base.h"
#include "base/team.h"

namespace slabd::algo {

/// Width of the thinnest pair of parallel planes that contains all `points` (ISO 1101 minimum zone), exact. NaN for
/// fewer than four points, or if the search does not reach its stop condition (never a wrong number). No heap.
[[nodiscard]] double minimum_zone_mm(std::span<const Vec3> points);

/// Memory for `measure_flatness`, owned by the inspector.
struct FlatnessWorkspace {
  std::span<CellSum> sums;         ///< 2 * limits::kFlatnessCellsMax
  std::span<CellRange> ranges;     ///< limits::kCellGroupsMax
  std::span<float> heights;        ///< limits::kSeatPointsMax
  std::span<std::uint32_t> mark;   ///< limits::kFlatnessCellsMax
  std::span<std::uint32_t> stack;  ///< limits::kFlatnessCellsMax + 1
  std::span<Vec3> cell_mean;       ///< limits::kFlatnessCellsMax
};

/// The evaluation region: (x, s) in [-half_x, half_x] x [-half_s, half_s], s along the seat.
struct FlatnessRegion {
  double half_x_mm;
  double half_s_mm;
  double cell_mm;
  std::uint32_t cell_points_min;
  double cells_missing_max = 0.05;  ///< share of the cells
  double casing_s_mm = 0.0;         ///< around both casings, at x = 0 and |s| = this, no points are expected ...
  double casing_clear_mm = 0.0;     ///< ... within this radius
  double closing_mm = 10.0;         ///< pits up to this width are bridged in the closed surface
  double defect_sigmas = 5.0;       ///< cells further than this from the seat form the defect channel
};

struct Flatness {
  bool ok = false;
  /// Share of the seen area that is on `seat`. An area share, because a half that returns five times as many points as
  /// the other has nearly all points. NaN if the cells could not be summed.
  double seat_share = kNoValue;
  PlaneShift by_area;       ///< change of `seat` if areas had weight instead of points
  std::uint32_t cells = 0;  ///< with enough points
  std::uint32_t cells_missing = 0;
  double hole_mm2 = 0.0;     ///< the largest connected group of missing cells
  double lsq_mm = kNoValue;  ///< peak to valley of the cell means to their least-squares plane
  double min_zone_mm = kNoValue;
  double closed_mm = kNoValue;  ///< the same two for the surface closed from above (seat_cells.h)
  double closed_min_zone_mm = kNoValue;
  double bumps_mm = 0.0;           ///< contribution of narrow low bumps to closed_mm
  double trimmed_mm = kNoValue;    ///< of the nine tenths of the cell means closest to their plane (paper 5.2)
  double std_cells_mm = kNoValue;  ///< of the cell means to their least-squares plane, n - 3
  double raw_low_mm = kNoValue;    ///< extremes of single points relative to `seat`
  double raw_high_mm = kNoValue;
  double noise_factor = kNoValue;  ///< see SeatFeature; NaN if noise and form could not be separated
  double noise_mm = kNoValue;      ///< reading of a flat seat: expected range of the cell means from noise alone
  SurfaceDefect defect;            ///< of the seen area, also if `ok` is false
};

/// Flatness of the points in `runs` (all seen points over the region, at any height) around the fitted seat plane
/// `seat` (block frame). A cell's height is the mean of its points without strays. Connected strays of at least half a
/// cell's worth of points are its height instead.
/// A cell belongs to the defect channel if it is further than defect_sigmas times the noise from `seat`. The noise is
/// the robust standard deviation of all cells, at least std_mm / sqrt(points in the cell). A place without any points
/// is a hole, not a defect. ok = false: more points, runs or cells than limits.h allows, a vertical seat, or too little
/// of the region was seen (rule in flatness.cpp). The result is the same with one or two threads. No heap; 1.2 ns a
/// point and 0.8 ms.
[[nodiscard]] Flatness measure_flatness(std::span<const SeatPoints> runs, const SeatFrame& frame, const PlaneFit& seat,
                                        const FlatnessRegion& region, const FlatnessWorkspace& work, Team& team);

}  // namespace slabd::algo
