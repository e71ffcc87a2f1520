// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <string>

#include "calib/adjustment.h"

/// What a set of views determines, and what it does not. Internal to the room.
namespace slabd::calib {

/// Covariance of the parameters from the chosen views, by the eigenvalues of the normal matrix (rotations scaled by
/// 500 mm). A direction that is not determined has no variance here: ask `weakness_of` first.
[[nodiscard]] Eigen::MatrixXd parameter_covariance(const Equations& equations, std::span<const std::size_t> chosen,
                                                   const Linearised& linear);

struct Weakness {
  double condition =
      kNoValue;  ///< largest over smallest singular value of the whitened Jacobian; infinite if that is 0
  double smallest = kNoValue;
  std::string text;  ///< the worst direction in words
};
/// By the singular values of the Jacobian itself, rotations scaled by 500 mm.
[[nodiscard]] Weakness weakness_of(const Equations& equations, std::span<const std::size_t> chosen,
                                   const Linearised& linear);

}  // namespace slabd::calib
