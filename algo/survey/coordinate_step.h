// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "algo/algo.h"

/// Detects steps to which the coordinates of a scan were rounded before slabd read them: by a writer of few decimals,
/// of integers with a scale, or of another unit.
namespace slabd::algo {

/// Coarsest step (mm) with which a scan is measured. At 0.2 mm the rounding alone makes the U of a jaw angle (a face of
/// 20 mm) larger than half of its tolerance of one degree; metres with four decimals (0.1 mm) are still useful.
inline constexpr double kCoordinateStepMax_mm = 0.15;
/// Finest step (mm) searched. A finer one changes no item by a tenth of a scanner's noise.
inline constexpr double kCoordinateStepMin_mm = 0.002;
/// Entries of `scratch`.
inline constexpr std::size_t kStepScratch = 16'384;

/// The step of each axis of the scanner frame, mm. 0 along an axis without a step, along two axes that are the
/// scanner's own raster, and along the travel of a line profiler (X or Y): there the coordinates are exact. No heap;
/// the same result on every machine. 1 ms; up to 5 ms more if axes may be a profiler's travel, or a
/// raster that is not the grid of an organised scan.
[[nodiscard]] Vec3 find_coordinate_step(const Cloud& cloud, std::span<std::uint32_t> scratch);

}  // namespace slabd::algo
