// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "algo/algo.h"

namespace slabd::algo {

/// One seat as measured (base frame) and where the slab model has it (slab frame).
struct SeatSighting {
  Vec3 p_base;
  Vec3 n_base;
  Vec3 p_slab;
  Vec3 n_slab;
};

/// Rigid fit of the seats to the slab model: IRLS with Tukey weights, component by component, so that a seat that is
/// displaced in one direction loses its say in that direction only. `sigma` sets the smallest scale. `seats`,
/// iterations, rms, plain rms and T_base_slab are filled; ok = false with a note when it does not settle. Needs at
/// least three seats that are not on a line. No heap.
[[nodiscard]] SlabFitReport fit_slab(std::span<const SeatSighting> seats, const StationSigma& sigma);

}  // namespace slabd::algo
