// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "calib/adjustment.h"
#include "calib/hand_eye.h"

/// Steps of the hand-eye solver: what views determine, what they share, how noisy they really are, and which figures
/// forbid the use of a calibration. Internal to the room.
namespace slabd::calib {

// ---- which figures forbid the use, and what to tell people

/// What the figures alone do not show.
struct Circumstances {
  ArtefactKind kind{};
  std::span<const View> views;
  StatedNoise noise;
  bool converged = false;
  std::size_t places = 0;  ///< different flange poses among the views kept
  std::string weakest;     ///< the direction that is determined worst, in words
  double median_flange_mm = kNoValue;
  double median_target_mm = kNoValue;
  DeclaredFormats declared;
  SameTarget same_target;
  double scale_off_max = kScaleOffMax;
};

/// Whether the figures so far give reason to doubt that the poses mean what was stated.
[[nodiscard]] bool needs_convention_test(const HandEye& result);

/// Fills `reasons`, `warnings` and `ok` from the figures of `result`.
void judge(const Circumstances& circumstances, HandEye& result);

// ---- what a set of views determines, and what it does not

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

// ---- views from one place of the flange, and what they are worth together.
//
// A robot that stands still, or comes back, is wrong there by what it was wrong before: views of one place share that
// error, and only what each of them errs by itself averages out. How much is shared shows in how little they scatter.

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

// ---- how noisy positions, the robot's rotations and the target's rotations really are

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
