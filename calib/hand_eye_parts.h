// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "calib/adjustment.h"
#include "calib/hand_eye.h"

/// Steps of the hand-eye solver: determined directions, shared errors, actual noise, and the figures that prevent the
/// use of a calibration. Internal to the room.
namespace slabd::calib {

// ---- figures that prevent the use, and their texts

/// Inputs of the judgement in addition to the figures.
struct JudgementInputs {
  ArtefactKind kind{};
  std::span<const View> views;
  StatedNoise noise;
  bool converged = false;
  std::size_t places = 0;  ///< number of different flange poses among the kept views
  std::string weakest;     ///< description of the worst determined direction
  double median_flange_mm = kNoValue;
  double median_target_mm = kNoValue;
  DeclaredFormats declared;
  SameTarget same_target;
  double scale_off_max = kScaleOffMax;
};

/// True if the figures so far suggest that the poses do not have the stated meaning.
[[nodiscard]] bool needs_convention_test(const HandEye& result);

/// Sets `reasons`, `warnings` and `ok` from the figures of `result`.
void judge(const JudgementInputs& circumstances, HandEye& result);

// ---- directions that a set of views determines

/// Covariance of the parameters from the chosen views, by the eigenvalues of the normal matrix (rotations scaled by 500
/// mm). An undetermined direction has no variance here, so check `degeneracy_of` first.
[[nodiscard]] Eigen::MatrixXd parameter_covariance(const Equations& equations, std::span<const std::size_t> chosen,
                                                   const Linearised& linear);

struct Degeneracy {
  double condition =
      kNoValue;  ///< largest over smallest singular value of the whitened Jacobian; infinite if that is 0
  double smallest = kNoValue;
  std::string text;  ///< description of the worst direction
};
/// Computes the degeneracy from the singular values of the Jacobian itself, rotations scaled by 500 mm.
[[nodiscard]] Degeneracy degeneracy_of(const Equations& equations, std::span<const std::size_t> chosen,
                                       const Linearised& linear);

// ---- views from one place of the flange, and their shared error
//
// A robot that stands still or returns has the same error at that place again. Views of one place share that error, and
// only the independent part averages out. The shared part is estimated from their scatter.

/// Groups the chosen views by place (same_place() as the place's first view), in the order they were chosen.
[[nodiscard]] std::vector<std::vector<std::size_t>> places_of(const Equations& equations,
                                                              std::span<const std::size_t> chosen);

/// Errors of views when those of one place share a part.
struct SharedErrors {
  bool repeats = false;  ///< true if any place has more than one view; otherwise the values below are meaningless
  double size = 1.0;     ///< size of the whitened residuals: 1 if the noise used for whitening is right
  /// Share of the variance common to all views of a place: 0 = independent, 1 = copies.
  double rotation_share = 0.0;
  double position_share = 0.0;
  /// Average number of views equivalent to one with an independent error: 1 + (views of a place - 1) share.
  double design_effect = 1.0;
};
/// Computes the shares by analysis of variance, as an intraclass correlation. The scatter within places gives the
/// independent part, the whole residuals the total. Without redundant equations between places, all of it counts as
/// shared.
[[nodiscard]] SharedErrors shared_errors(const Equations& equations, std::span<const std::size_t> chosen,
                                         const Linearised& linear);

/// Covariance of all parameters estimated from the chosen views, whitened by `weighing` (as is `linear`). The errors
/// are those of `errors` with the shares of `shared`. It is N^-1 (sum over places of G G') N^-1, where the scores G of
/// a place are summed before squaring.
[[nodiscard]] Eigen::MatrixXd covariance_of_estimate(const Equations& equations, std::span<const std::size_t> chosen,
                                                     const Linearised& linear, const State& state,
                                                     const Weighing& weighing, const Weighing& errors,
                                                     const SharedErrors& shared);

// ---- actual noise of positions, of the robot's rotations and of the target's rotations

/// Variance components by restricted maximum likelihood, for a `pose` adjustment at its solution. A rotation error of
/// the flange moves the target over the lever arm, a rotation error of the target does not. Therefore robot and target
/// errors can be separated. `gain` is twice the log likelihood ratio against the stated noise with one common factor.
/// By chance it exceeds 11.8 in 3 of 1000 sets. Only the noise of `stated` and its lever flag are used; without the
/// lever robot and target share the rotation noise.
struct Components {
  Weighing weighing;
  double gain = 0.0;
};
[[nodiscard]] Components estimate_components(const Equations& equations, std::span<const std::size_t> kept,
                                             const State& state, const Weighing& stated);

}  // namespace slabd::calib
