// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "algo/algo.h"

/// Steps to which the coordinates of a scan were rounded before slabd read them: by a writer of few decimals, of whole
/// numbers with a scale, or of another unit.
namespace slabd::algo {

/// Coarsest step (mm) that a scan is measured with. At 0.2 mm the rounding alone makes the U of a jaw angle (a face of
/// 20 mm) larger than half of its tolerance of one degree; metres with four decimals (0.1 mm) are still of use.
inline constexpr double kCoordinateStepMax_mm = 0.15;
/// Finest step (mm) that is looked for. A finer one moves no item by a tenth of a scanner's noise.
inline constexpr double kCoordinateStepMin_mm = 0.002;
/// Entries of `scratch`.
inline constexpr std::size_t kStepScratch = 16'384;

/// The step of each axis of the scanner frame, mm. 0 along an axis without a step, along two axes that are the
/// scanner's own raster, and along the way of a line profiler (X or Y): there every point lies where it is said to lie.
/// No heap; the same answer on every machine. 1 ms; up to 5 ms more where axes may be a profiler's way, or a raster
/// that is not the grid of an organised scan.
[[nodiscard]] Vec3 find_coordinate_step(const Cloud& cloud, std::span<std::uint32_t> scratch);

}  // namespace slabd::algo
