// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "algo/block_model.h"
#include "base/base.h"

namespace slabd::algo {

/// Puts the block-scope items into `result`, without values; optional ones only where the recipe names them.
void blank_block_items(const Recipe& recipe, BlockResult& result);

/// Fills the items' values from the measured features of `result`; what was not measured stays without a value.
/// Also seat.normal_datum. Features are in the registered block frame.
void compute_block_items(const BlockModel& model, BlockResult& result);

/// Fills `result.observation` (base frame) from the features and T_base_block = base <- registered block frame, with
/// the uncertainties inside this scan (uncertainty.h). Under caps the seat's reference point is not between the casings,
/// but the registered block's own middle on the seat, as well as the registration has it.
void compute_observation(const BlockModel& model, CasingKind casings, const Pose& T_base_block, BlockResult& result);

/// Tilt of a plane about X: positive when it climbs towards +Y. rad. `n` in the datum frame.
[[nodiscard]] double slope_about_x_rad(const Vec3& n);

}  // namespace slabd::algo
