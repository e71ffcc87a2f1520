// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>

#include "algo/algo.h"
#include "algo/block_model.h"
#include "algo/survey/surface_raster.h"
#include "base/base.h"
#include "base/team.h"

/// Pores and damage everywhere on the block: seat, jaws and shoulders with their edges.
namespace slabd::algo {

/// Floats of memory that the search takes.
inline constexpr std::size_t kSurfaceFloats = 800'000;
/// A pit is a pore as long as its diameter is no larger than this many times the recipe's limit; then it is damage.
inline constexpr double kPoreReserve = 1.25;

/// Fills `result.findings`, `result.pores`, `result.edges`, and the items surface_pores and block_damage where `result`
/// has them, from the raster of a registered scan whose seat plane was fitted; `map` says how far the scan reaches.
/// What lies beyond the scan's field of view is not missing, nor is what nearly all of its like do not return. The same
/// answer on one thread and two. No heap; 1.5 ms.
void find_pores_and_damage(const BlockModel& model, const SurfaceTable& table, std::span<const SurfaceCell> cells,
                           const DeviationMap& map, std::span<float> memory, Team& team, BlockResult& result);

}  // namespace slabd::algo
