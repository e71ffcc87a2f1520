// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <span>

#include "algo/algo.h"
#include "base/base.h"

namespace slabd::algo {

/// One seat as measured (base frame) and in the slab model (slab frame).
struct SeatInModel {
  Vec3 p_base;
  Vec3 n_base;
  Vec3 p_slab;
  Vec3 n_slab;
  /// Standard uncertainties of the measured values in slab axes; NaN = unknown: the fit's smallest scale counts.
  Vec3 sigma_p_mm = Vec3::Constant(kNoValue);
  Vec3 sigma_n_rad = Vec3::Constant(kNoValue);
};

/// A small motion of a frame: translation (mm), rotation (rad), both in slab axes about the slab's origin.
using FrameVector = Eigen::Matrix<double, 6, 1>;

/// Response of the fit to an error of one seat: coordinates q in the slab frame change by t + w x q, where (t, w) = sum
/// of by_p[axis] dp[axis] + by_n[axis] dn[axis]. The derivative of the robust fit at its solution.
struct FrameResponse {
  std::array<FrameVector, 3> by_p{FrameVector::Zero(), FrameVector::Zero(), FrameVector::Zero()};
  std::array<FrameVector, 2> by_n{FrameVector::Zero(), FrameVector::Zero()};
};

/// Rigid fit of the seats to the slab model: IRLS with Tukey weights per component, so that a seat displaced in one
/// direction loses its weight in that direction only. The weight of a component is 1 / (s^2 + sigma^2): its own
/// uncertainty, and the scatter of the seats beyond theirs (median absolute residual). Fills `seats`, iterations, rms,
/// plain rms and T_base_slab; ok = false with a note if it does not converge. Needs at least three seats that are not
/// on a line. `response`: empty, or one per seat. No heap.
[[nodiscard]] SlabFitReport fit_slab(std::span<const SeatInModel> seats, std::span<FrameResponse> response);

/// Minimum number of seats of a row, and of consistent ones, for a parabola, which has three parameters.
inline constexpr std::size_t kParabolaSeatsMin = 5;
inline constexpr std::size_t kParabolaAgreeMin = 4;

/// One seat of a row: position along the slab and height above its nominal (mm).
struct RowHeight {
  double x_mm = 0.0;
  double z_mm = 0.0;
  bool counts = true;  ///< false: its height above the parabola is computed, but it has no weight in the fit
};

/// Heights of a row after its warp was subtracted.
struct RowParabola {
  bool ok = false;
  std::array<double, limits::kPairsMax> off_mm{};  ///< height above the parabola
  std::array<double, limits::kPairsMax> weight{};  ///< 1 if in place .. 0 if out of place
  /// d off[i] / d z[k].
  std::array<std::array<double, limits::kPairsMax>, limits::kPairsMax> response{};
};

/// Least-squares parabola through the seats that are in place. A seat has Tukey's weight of its own height above the
/// parabola, none from `reach_mm` on, so that a low seat is reported with its full depth and its neighbours are not
/// raised (with equal weights an end seat keeps 0.34 of its depth and the others get the rest). Selects the solution
/// with the smallest sum of Tukey's rho; among those of hardly higher cost, the one with the largest distance of a
/// seat. Started from the plain parabola, those without one seat, and the best through three. `reach_mm` NaN or
/// infinite: plain least squares. ok = false: fewer than 5 seats that count, or fewer than 4 of them in place.
[[nodiscard]] RowParabola fit_row_parabola(std::span<const RowHeight> row, double reach_mm);

}  // namespace slabd::algo
