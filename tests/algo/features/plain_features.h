// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "algo/features/casing.h"
#include "algo/features/flatness.h"
#include "algo/features/seat_noise.h"

/// Flatness, cell noise and casings by definition: point by point, in double, every cell sorted, every angle an
/// arctangent. Reference for algo, ten to thirty times slower.
namespace slabd::algo::plain {

struct FlatnessMemory {
  std::span<std::uint32_t> cell_start;  ///< limits::kFlatnessCellsMax + 1
  std::span<std::uint32_t> cell_next;   ///< limits::kFlatnessCellsMax
  std::span<Vec3> cell_mean;            ///< limits::kFlatnessCellsMax
};

/// Re-orders `index`.
[[nodiscard]] Flatness measure_flatness(const float* xyz, std::span<std::uint32_t> index,
                                        const FastTransform& T_block_scanner, const Vec3& along_seat,
                                        const PlaneFit& seat, const FlatnessRegion& region, const FlatnessMemory& work);
[[nodiscard]] CellNoise noise_of_cells(const CellGrid& grid, std::span<const double> heights,
                                       std::span<const std::uint32_t> cells, double within_variance_mm2,
                                       double points_per_cell);
[[nodiscard]] CasingFeature measure_casing(const CloudPoints& points, const CasingTask& task);

}  // namespace slabd::algo::plain
