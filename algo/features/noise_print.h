// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "algo/features/flatness.h"
#include "algo/features/seat_points.h"
#include "base/limits.h"
#include "base/noise_print.h"
#include "base/team.h"

/// The noise of one exposure over the seat (base/noise_print.h).
namespace slabd::algo {

/// What the points of a cell add up to. Whole numbers: their order does not matter.
struct NoiseCell {
  std::int32_t height = 0;  ///< sum of heights over the fitted seat, in 10 nm
  std::uint32_t points = 0;
};

/// Cells of both grids: the fine one, then the coarse one.
inline constexpr std::size_t kNoiseFineCells = 4 * limits::kNoiseWindowX_mm * limits::kNoiseWindowS_mm;
inline constexpr std::size_t kNoiseCoarseCells =
    (limits::kNoiseWindowX_mm * 4 / 3) * (limits::kNoiseWindowS_mm * 4 / 3);
inline constexpr std::size_t kNoiseCells = kNoiseFineCells + kNoiseCoarseCells;

/// Signs of the noise of the points in `runs` over the fitted seat plane `seat` (block frame), place by place of
/// `region`. `cells`: kNoiseCells. Empty if the seat stands on end or too few places have points. The same answer for
/// any order of the points, on one thread and two. No heap; 1.5 ns a point and 0.2 ms.
void make_noise_print(std::span<const SeatPoints> runs, const SeatFrame& frame, const PlaneFit& seat,
                      const FlatnessRegion& region, std::span<NoiseCell> cells, Team& team, NoisePrint& out);

}  // namespace slabd::algo
