// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "calib/adjustment.h"

/// Views from one place of the flange, and what they are worth together. Internal to the room.
///
/// A robot that stands still, or comes back, is wrong there by what it was wrong before: views of one place share that
/// error, and only what each of them errs by itself averages out. How much is shared shows in how little they scatter.
namespace slabd::calib {

/// The chosen views by place (same_place() as the place's first view), in the order they were chosen.
[[nodiscard]] std::vector<std::vector<std::size_t>> places_of(const Equations& equations,
                                                              std::span<const std::size_t> chosen);

/// Errors of views when those of one place share a part.
struct SharedErrors {
  bool repeats = false;  ///< any place has more than one view; else nothing below says anything
  double size = 1.0;     ///< of the whitened residuals: 1 when the noise they were whitened by is right
  /// Of the variance, what all views of a place have in common: 0 = each errs anew, 1 = they are copies.
  double rotation_share = 0.0;
  double position_share = 0.0;
  /// How many views it takes on average to say what one would that errs by itself: 1 + (views of a place - 1) share.
  double design_effect = 1.0;
};
/// By analysis of variance, as an intraclass correlation: the scatter within places says what is drawn anew, the whole
/// residuals what there is in all. Where no equations are left over between places, all counts as shared.
[[nodiscard]] SharedErrors shared_errors(const Equations& equations, std::span<const std::size_t> chosen,
                                         const Linearised& linear);

/// Covariance of all parameters, as they are estimated from the chosen views whitened by `weighing` (`linear` is of the
/// same), when the errors are those of `errors` and views of one place share of them what `shared` says:
/// N^-1 (sum over places of G G') N^-1, the scores G of a place summed before they are squared.
[[nodiscard]] Eigen::MatrixXd covariance_of_estimate(const Equations& equations, std::span<const std::size_t> chosen,
                                                     const Linearised& linear, const State& state,
                                                     const Weighing& weighing, const Weighing& errors,
                                                     const SharedErrors& shared);

}  // namespace slabd::calib
