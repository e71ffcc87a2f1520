// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "algo/features/face_points.h"
#include "algo/features/flatness.h"
#include "algo/features/seat_cells.h"
#include "algo/features/seat_points.h"
#include "base/limits.h"
#include "base/noise_print.h"
#include "base/team.h"

namespace slabd::algo {

/// Scatter of the heights of flatness cells without the surface's own form.
struct CellNoise {
  bool ok = false;
  double cell_sigma_mm = kNoValue;   ///< standard deviation of a cell's mean
  double point_sigma_mm = kNoValue;  ///< of a single point
  double factor = kNoValue;          ///< variance of a mean over many cells relative to white noise; >= 1
};

/// Separates noise from form by wavelength (method in seat_noise.cpp). `heights`: of the cells' means above a plane, at
/// the positions `cells`; `within_variance_mm2`: of single points about their cell's mean; `points_per_cell`: on
/// average. ok = false: fewer than 400 cells or less than 40 mm of seat in either direction, because correlated noise
/// cannot then be separated from form. Standard error of `factor` about 13 % on 100 x 150 mm. No heap, 0.1 ms.
[[nodiscard]] CellNoise noise_of_cells(const CellGrid& grid, std::span<const double> heights,
                                       std::span<const std::uint32_t> cells, double within_variance_mm2,
                                       double points_per_cell);

/// Expected range (largest minus smallest) of `count` independent standard normal values: twice the expected maximum by
/// Chen and Tyler 1999, Phi^-1(0.5264^(1/count)); within 1 % for count >= 5. 0 below 2.
[[nodiscard]] double expected_range(std::size_t count);

// The noise of one exposure over the seat (base/noise_print.h).

/// Sums of a cell's points. Integers, so the order does not matter.
struct NoiseCell {
  std::int32_t height = 0;  ///< sum of heights above the fitted seat, in 10 nm
  std::uint32_t points = 0;
};

/// Cells of both grids: the fine one, then the coarse one.
inline constexpr std::size_t kNoiseFineCells = 4 * limits::kNoiseWindowX_mm * limits::kNoiseWindowS_mm;
inline constexpr std::size_t kNoiseCoarseCells =
    (limits::kNoiseWindowX_mm * 4 / 3) * (limits::kNoiseWindowS_mm * 4 / 3);
inline constexpr std::size_t kNoiseCells = kNoiseFineCells + kNoiseCoarseCells;

/// Signs of the noise of the points in `runs` above the fitted seat plane `seat` (block frame), per place of `region`.
/// `cells`: kNoiseCells. Empty if the seat is vertical or too few places have points. The same result for any order of
/// the points, with one or two threads. No heap; 1.5 ns a point and 0.2 ms.
void make_noise_print(std::span<const SeatPoints> runs, const SeatFrame& frame, const PlaneFit& seat,
                      const FlatnessRegion& region, std::span<NoiseCell> cells, Team& team, NoisePrint& out);

/// Amplitude (mm, along the seat's normal) of a periodic error across the track, as in scanners that project fringes.
/// Computed from periods of up to 12 mm in the seat's profile along s, in three strips along the rail so that a skewed
/// scanner does not matter. Noise is subtracted; the median ignores pores, which are not periodic. Waves of concrete
/// are 50 mm and longer. 0 if nothing was found. From at most 65 536 of the points. No heap; 0.15 ms.
[[nodiscard]] double ripple_amplitude_mm(const ListedPoints& seat);

}  // namespace slabd::algo
