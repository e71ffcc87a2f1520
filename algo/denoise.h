// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "algo/algo.h"

namespace slabd::algo {

/// Memory for `remove_isolated`, owned by the inspector.
struct DenoiseWorkspace {
  std::span<std::uint32_t> order;       ///< >= points
  std::span<std::uint8_t> keep;         ///< >= points
  std::span<std::uint32_t> cell_start;  ///< limits::kDenoiseCellsMax + 1
};

/// Drops points that are not finite and points with fewer than three others within 0.95 mm; compacts `cloud` in
/// place, order kept. Fills `counts`. About O(points); bounded by O(4096 * points) on the worst input.
void remove_isolated(Cloud& cloud, const DenoiseWorkspace& work, ScanCounts& counts);

/// What "isolated" means (used by the tests' brute force too).
inline constexpr float kNeighbourRadius_mm = 0.95F;
inline constexpr int kNeighboursMin = 3;

}  // namespace slabd::algo
