// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <span>

#include "algo/algo.h"

namespace slabd::algo {

/// One seat as measured (base frame) and where the slab model has it (slab frame).
struct SeatSighting {
  Vec3 p_base;
  Vec3 n_base;
  Vec3 p_slab;
  Vec3 n_slab;
  /// Standard uncertainties of the measured ones along the slab's axes; NaN = unknown, the fit's smallest scale counts.
  Vec3 sigma_p_mm = Vec3::Constant(kNoValue);
  Vec3 sigma_n_rad = Vec3::Constant(kNoValue);
};

/// A small motion of a frame: translation (mm), rotation (rad), both in slab axes about the slab's origin.
using FrameVector = Eigen::Matrix<double, 6, 1>;

/// How the fit answers to an error of one seat: coordinates q of anything in the slab frame change by t + w x q, where
/// (t, w) = sum of by_p[axis] dp[axis] + by_n[axis] dn[axis]. The derivative of the robust fit at its solution.
struct FrameResponse {
  std::array<FrameVector, 3> by_p{FrameVector::Zero(), FrameVector::Zero(), FrameVector::Zero()};
  std::array<FrameVector, 2> by_n{FrameVector::Zero(), FrameVector::Zero()};
};

/// Rigid fit of the seats to the slab model: IRLS with Tukey weights, component by component, so that a seat that is
/// displaced in one direction loses its say in that direction only. A component counts with 1 / (s^2 + sigma^2): its
/// own uncertainty, and what the seats scatter beyond theirs (median absolute residual). `seats`, iterations, rms,
/// plain rms and T_base_slab are filled; ok = false with a note when it does not settle. Needs at least three seats
/// that are not on a line. `response`: empty, or one per seat. No heap.
[[nodiscard]] SlabFitReport fit_slab(std::span<const SeatSighting> seats, std::span<FrameResponse> response);

}  // namespace slabd::algo
