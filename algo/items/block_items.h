// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "algo/block_model.h"
#include "base/base.h"

namespace slabd::algo {

/// Adds the block-scope items to `result`, without values; optional ones only if the recipe names them. The station of
/// `result` selects the seat of the design.
void blank_block_items(const Recipe& recipe, const SlabDesign& design, BlockResult& result);

/// Computes the items' values from the measured features of `result`; items that were not measured stay without a
/// value. Also computes seat.normal_datum. Features are in the registered block frame.
void compute_block_items(const BlockModel& model, BlockResult& result);

/// Fills `result.observation` (base frame) from the features and T_base_block = base <- registered block frame, with
/// the uncertainties inside this scan (uncertainty.h). With caps, the seat's reference point is the registered block's
/// middle on the seat, as accurate as the registration, instead of the middle between the casings.
void compute_observation(const BlockModel& model, CasingKind casings, const Pose& T_base_block, BlockResult& result);

/// Tilt of a plane about X in rad: positive if it rises towards +Y. `n` in the datum frame.
[[nodiscard]] double slope_about_x_rad(const Vec3& n);

}  // namespace slabd::algo
