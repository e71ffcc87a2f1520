// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "calib/adjustment.h"

/// How noisy positions, the robot's rotations and the target's rotations really are. Internal to the room.
namespace slabd::calib {

/// Variance components by restricted maximum likelihood, of a `pose` adjustment at its solution. Robot and target can
/// be told apart because a flange that is turned by mistake carries the target with it over the lever arm, a target
/// that is seen turned does not move. `gain`: twice the logarithm of how much more likely the residuals are with them
/// than with the stated noise times one common factor; by chance above 11.8 in 3 of 1000 sets. Of `stated` the noise
/// and whether it acts over the lever count; without it robot and target share what rotations there are.
struct Components {
  Weighing weighing;
  double gain = 0.0;
};
[[nodiscard]] Components estimate_components(const Equations& equations, std::span<const std::size_t> kept,
                                             const State& state, const Weighing& stated);

}  // namespace slabd::calib
