// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "algo/features/cell_sums.h"
#include "algo/features/seat_points.h"
#include "base/base.h"
#include "base/team.h"

namespace slabd::algo {

/// Width of the thinnest pair of parallel planes that holds all `points` (ISO 1101 minimum zone), exact. NaN when
/// fewer than four points, or when the search does not reach its stop condition (never a wrong number). No heap.
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
  double casing_s_mm = 0.0;         ///< round both casings, at x = 0 and |s| here, nothing is expected ...
  double casing_clear_mm = 0.0;     ///< ... within this radius
  double closing_mm = 10.0;         ///< pits up to this width are bridged in the closed surface
  double defect_sigmas = 5.0;       ///< cells further than this from the seat form the defect channel
};

struct Flatness {
  bool ok = false;
  /// Of the area that was seen, the share that lies on `seat`: where one half returns five times as many points as the
  /// other, that half is nearly all of the points. NaN when the cells could not be summed up.
  double seat_share = kNoValue;
  PlaneShift by_area;       ///< what `seat` would be if areas had weighed instead of points
  std::uint32_t cells = 0;  ///< with enough points
  std::uint32_t cells_missing = 0;
  double hole_mm2 = 0.0;     ///< the largest connected group of missing cells
  double lsq_mm = kNoValue;  ///< peak to valley of the cell means to their least-squares plane
  double min_zone_mm = kNoValue;
  double closed_mm = kNoValue;  ///< the same two of the surface that is closed from above (seat_cells.h)
  double closed_min_zone_mm = kNoValue;
  double bumps_mm = 0.0;           ///< by so much narrow low bumps make closed_mm larger
  double trimmed_mm = kNoValue;    ///< of the nine tenths of the cell means nearest to their plane (paper 5.2)
  double std_cells_mm = kNoValue;  ///< of the cell means to their least-squares plane, n - 3
  double raw_low_mm = kNoValue;    ///< extremes of single points to `seat`
  double raw_high_mm = kNoValue;
  double noise_factor = kNoValue;  ///< see SeatFeature; NaN when it could not be told from form
  double noise_mm = kNoValue;      ///< what a flat seat would read: expected range of the cell means from noise alone
  SurfaceDefect defect;            ///< of what was seen, also when `ok` is false
};

/// Flatness of the points in `runs` (everything seen over the region, at whatever height) around the fitted seat plane
/// `seat` (block frame). A cell's height is the mean of its points without strays; strays that hang together over half
/// a cell's worth of points are its height instead. A cell
/// belongs to the defect channel when it lies further than defect_sigmas times the noise from `seat`; the noise is the
/// robust standard deviation of all cells, not below std_mm / sqrt(points in the cell). What returned no points at all
/// is a hole, not a defect. ok = false: more points, runs or cells than limits.h allows, a seat that stands on end, or
/// too little of the region was seen (the rule stands in flatness.cpp). The answer is the same on one thread and two.
/// No heap; 1.2 ns a point and 0.8 ms.
[[nodiscard]] Flatness measure_flatness(std::span<const SeatPoints> runs, const SeatFrame& frame, const PlaneFit& seat,
                                        const FlatnessRegion& region, const FlatnessWorkspace& work, Team& team);

}  // namespace slabd::algo
