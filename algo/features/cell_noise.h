// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "algo/features/cell_grid.h"

namespace slabd::algo {

/// How the heights of flatness cells scatter when the surface's own form is taken away.
struct CellNoise {
  bool ok = false;
  double cell_sigma_mm = kNoValue;   ///< standard deviation of a cell's mean
  double point_sigma_mm = kNoValue;  ///< of a single point
  double factor = kNoValue;          ///< variance of a mean over many cells, over what white noise would give; >= 1
};

/// Separates noise from form by wavelength (cell_noise.cpp says how). `heights`: of the cells' means above a plane, the
/// place of each in `cells`; `within_variance_mm2`: of single points about their cell's mean; `points_per_cell`: on
/// average. ok = false: fewer than 400 cells or less than 40 mm of seat either way; correlated
/// noise cannot then be told from form. Standard error of `factor` about 13 % on 100 x 150 mm. No heap, 0.1 ms.
[[nodiscard]] CellNoise noise_of_cells(const CellGrid& grid, std::span<const double> heights,
                                       std::span<const std::uint32_t> cells, double within_variance_mm2,
                                       double points_per_cell);

/// Expected range (largest minus smallest) of `count` independent standard normal values: twice the expected maximum by
/// Chen and Tyler 1999, Phi^-1(0.5264^(1/count)); within 1 % for count >= 5. 0 below 2.
[[nodiscard]] double expected_range(std::size_t count);

}  // namespace slabd::algo
