// SPDX-License-Identifier: Apache-2.0
#pragma once

/// How rare a sum of squares is. Internal to the room.
namespace slabd::calib {

/// |z| of a normal variable that is as rare as chi-square `x` with `freedom` >= 1 degrees of freedom. Also where the
/// probability is far below the smallest double.
[[nodiscard]] double normal_sigmas(double x, int freedom);

/// Median of chi-square with `freedom` degrees of freedom, to a per cent.
[[nodiscard]] double chi_square_median(int freedom);

}  // namespace slabd::calib
