// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "base/base.h"

namespace slabd::algo {

/// Fewest seats of a row, and fewest that agree, before a parabola says something: it has three parameters.
inline constexpr std::size_t kParabolaSeatsMin = 5;
inline constexpr std::size_t kParabolaAgreeMin = 4;

/// One seat of a row: place along the slab and height over its nominal (mm).
struct RowHeight {
  double x_mm = 0.0;
  double z_mm = 0.0;
  bool counts = true;  ///< false: its height over the parabola is asked for, but it has no say in it
};

/// What is left of a row's heights after its warp was taken out.
struct RowParabola {
  bool ok = false;
  std::array<double, limits::kPairsMax> off_mm{};  ///< height over the parabola
  std::array<double, limits::kPairsMax> weight{};  ///< 1 in place .. 0 out of it
  /// d off[i] / d z[k].
  std::array<std::array<double, limits::kPairsMax>, limits::kPairsMax> response{};
};

/// Least-squares parabola through the seats that are in place. A seat counts with Tukey's weight of its own height over
/// the parabola, none from `reach_mm` on, so that a low seat is reported with all of its depth and its neighbours are
/// not lifted for it (with equal weights an end seat keeps 0.34 of its depth and the rest is put on the others). Among
/// the solutions the one with the smallest sum of Tukey's rho; of those that cost hardly more the one that leaves a
/// seat furthest off. Started from the plain parabola, those without one seat, and the best through three. `reach_mm`
/// NaN or infinite: plain least squares. ok = false: fewer than 5 seats that count, or fewer than 4 of them in place.
[[nodiscard]] RowParabola fit_row_parabola(std::span<const RowHeight> row, double reach_mm);

}  // namespace slabd::algo
