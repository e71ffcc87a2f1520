// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "algo/algo.h"
#include "algo/items/slab_budget.h"

namespace slabd::algo {

/// What the slab's top says of the fitted frame's roll (about X). Seats cannot say it: a row that is too high looks to
/// them like a slab that is rolled.
struct RollWitness {
  bool seen = false;           ///< enough of the top is seen beside both rows
  double roll_rad = 0.0;       ///< of the top in the slab frame, nominally 0
  double explained_rad = 0.0;  ///< what chance and an ordinary slab may show
  double u_rad = 0.0;          ///< standard uncertainty of the frame's roll that follows
};

/// The top's roll is the mean of the two rows' medians: what both rows show alike in their own axes (a camber, slopes
/// that are too steep everywhere) cancels, and so does what a scanner that is turned round with the block shows. The
/// variance beyond what is explained counts: u^2 = roll^2 - explained^2, or 0.
///
/// `known`: the stations' uncertainties, as the fit takes them. No heap.
[[nodiscard]] RollWitness witness_roll(const Recipe& recipe, std::span<const BlockResult> blocks,
                                       const Pose& T_base_slab, const SlabBudget& known);

}  // namespace slabd::algo
