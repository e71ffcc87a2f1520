// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "base/base.h"
#include "calib/conventions.h"
#include "calib/observations.h"

/// Hand-eye calibration: X = T_flange_scanner from views of a fixed artefact, its uncertainty, and all reasons not to
/// use it. Pure computation on the heap; runs on maintenance only. The same views give the same bits.
namespace slabd::calib {

/// Part of the scanner's view for which the error is predicted: 3 x 3 x 3 points.
struct FieldOfView {
  double half_x_mm = 100.0;
  double half_y_mm = 100.0;
  double near_mm = 420.0;
  double far_mm = 580.0;
};

/// Default of SolveSettings::scale_off_max. A robot with a smooth error of 0.7 mm appears as 0.33 % (worst of 60 sets
/// of 20 views).
inline constexpr double kScaleOffMax = 0.005;
/// A scale is reported if it differs from 1 by more than this number of its standard deviations.
inline constexpr double kScaleSigmas = 3.0;

struct SolveSettings {
  FieldOfView fov;
  /// Limit of predicted_point_sigma_mm. NaN: `kPointSigmaPerNoise` times the stated position error, a limit that a well
  /// arranged set meets with any robot.
  double point_sigma_mm_max = kNoValue;
  bool convention_test = true;  ///< false is faster, for repeated solutions of the same views
  DeclaredFormats declared;     ///< formats declared in the tables of the views
  /// Largest accepted relative error of the scanner's scale (lambda - 1), if the views determine one.
  double scale_off_max = kScaleOffMax;
};
inline constexpr double kPointSigmaPerNoise = 6.0;

// Limits of refusals, each with its reason code below.
inline constexpr std::size_t kViewsMin = 6;
inline constexpr std::size_t kViewsAdvised = 10;
inline constexpr double kRotationSpreadMin_deg = 5.0;  ///< second principal value: two axes determine everything
inline constexpr double kRotationSpreadAdvised_deg = 15.0;
inline constexpr double kConditionMax = 50.0;
inline constexpr double kConditionDegenerate = 1e4;  ///< above it a direction is not determined at all
inline constexpr double kBallSpreadMin_mm = 25.0;
inline constexpr double kRejectedShareMax = 0.25;
inline constexpr double kS0Min = 0.1;
/// Below this ratio a warning is given, not a refusal. If the stated noise is too large, the views get equal weights
/// and the predicted error is too large, which is safe. A robot's accuracy also appears as a smaller noise within a
/// small volume, because neighbouring poses share the error.
inline constexpr double kS0Said = 0.3;
inline constexpr double kS0Max = 3.0;
inline constexpr double kLeaveOneOutRatioMax = 4.0;
inline constexpr double kScannerArmMax_mm =
    1000.0;  ///< a larger distance between scanner and flange is a mistake of frames or units

/// Reason why a calibration is rejected. The words returned by `name` are stable; scripts may test them.
enum class Refusal : std::uint8_t {
  too_few_views,       ///< fewer than kViewsMin, in total or kept
  one_orientation,     ///< the scanner was never rotated
  one_rotation_axis,   ///< rotated about one axis only
  rotation_too_small,  ///< rotated by kRotationSpreadMin_deg about fewer than two axes
  ball_in_one_place,   ///< the ball was always at one place of the view
  ball_on_a_line,      ///< ... on a line, such as the optical axis
  ill_conditioned,     ///< condition above kConditionMax; the text contains the undetermined direction
  convention,          ///< another reading of the poses fits; the text contains it
  units,               ///< another unit on one side fits
  too_many_rejected,   ///< more than kRejectedShareMax of the views do not fit the others
  noise_above_stated,  ///< s0 above kS0Max
  noise_below_stated,  ///< s0 below kS0Min
  leave_one_out,       ///< a single view decides: leave-one-out max above kLeaveOneOutRatioMax medians
  predicted_error,     ///< predicted point error above its limit
  not_converged,       ///< the adjustment did not converge
  implausible,         ///< a scanner farther than kScannerArmMax_mm from its flange
  ball_radius,         ///< the scans contain balls of another radius than certified
  same_target,         ///< the target is the same in views with different flange poses
  handedness,          ///< an axis of the scanner is mirrored
  pairing,             ///< targets belong to flange poses on other lines
  scale,               ///< the difference between the scanner's and the robot's scale exceeds the limit
};
[[nodiscard]] std::string_view name(Refusal refusal);

struct Reason {
  Refusal code{};
  std::string text;  ///< description with figure and limit
  std::string cure;  ///< remedy
};

/// NaN without values.
struct Spread {
  double median = kNoValue;
  double rms = kNoValue;
  double max = kNoValue;
};

/// Fit of one view.
struct ViewFit {
  std::size_t number = 0;              ///< number of the view, from 1
  double residual_mm = kNoValue;       ///< |A X c - p|, or for the artefact's origin; rms over the balls of a view
  double residual_deg = kNoValue;      ///< pose: angle between A X B and Z
  double leave_one_out_mm = kNoValue;  ///< residual_mm of the solution without this view; kept views
  double leave_one_out_deg = kNoValue;
  double sigmas = kNoValue;  ///< residual over its own standard deviation, as a normal variable of equal probability
  bool kept = true;
};

struct HandEye {
  bool ok = false;  ///< false: rejected, with `reasons`; the figures are set nevertheless
  std::vector<Reason> reasons;
  std::vector<std::string> warnings;  ///< sentences; a warning does not prevent the use

  bool determined = false;    ///< false: a direction is not determined; pose, target and sigmas are NaN
  Pose T_flange_scanner;      ///< maps scanner coordinates to flange coordinates
  std::vector<Pose> targets;  ///< in the base frame: one per ball (identity rotation), or the artefact's pose

  std::vector<ViewFit> views;         ///< one per view given
  std::vector<std::size_t> rejected;  ///< indices of the views that do not fit, ascending
  std::size_t worst_view = 0;         ///< kept view with the largest `sigmas`
  Spread residual_mm, residual_deg;   ///< kept views
  Spread leave_one_out_mm, leave_one_out_deg;

  double s0 = kNoValue;           ///< residuals over stated noise; 1 if the stated noise is right
  double s0_position = kNoValue;  ///< the same for positions and for rotations
  double s0_rotation = kNoValue;  ///< pose
  /// Share of the position variance that views from one place of the flange (same_place()) have in common, estimated
  /// from their scatter. Repeats do not reduce this part; s0, sigmas and the predicted error include it. NaN if no
  /// place was seen twice.
  double repeat_share = kNoValue;
  /// The paper's lambda (eq. 7): factor for the sightings to agree with the robot's lengths, fitted together with X. A
  /// diagnosis, not applied. NaN if the views do not determine it.
  double scale = kNoValue;
  double scale_sigma = kNoValue;  ///< standard deviation, times max(1, s0)
  bool reweighted = false;        ///< position and rotation were weighted by s0_position and s0_rotation
  /// pose; false: positions were weighted without the lever effect of the robot's rotation error
  bool robot_lever = true;
  double condition = kNoValue;                ///< condition of the whitened Jacobian, rotations scaled by 500 mm
  double smallest_singular_value = kNoValue;  ///< of the same matrix, 1 / mm
  double rotation_spread_deg = kNoValue;      ///< smallest principal value
  std::array<double, 3> rotation_spread_axes_deg{kNoValue, kNoValue, kNoValue};  ///< all principal values, descending
  std::array<double, 3> ball_spread_axes_mm{kNoValue, kNoValue, kNoValue};       ///< ball: sd in the view, descending
  double predicted_point_sigma_mm =
      kNoValue;                            ///< k = 1, 3-D, rms over the field of view; random part, times max(1, s0)
  double point_sigma_limit_mm = kNoValue;  ///< limit of the predicted point error
  /// Covariance of T_flange_scanner, times max(1, s0)^2. Order: translation along the flange's axes (mm), then a small
  /// turn about the scanner's axes (rad), `R = R_X exp(turn)`. Translation and turn are strongly correlated; for a
  /// point q of the scanner use J C J' with J = [I, -R_X [q]x].
  Mat6 covariance = Mat6::Constant(kNoValue);

  ConventionReport conventions;  ///< readings tried; empty if the views fit as stated
};

/// Solves the hand-eye calibration. Refusals are part of the answer. Error (Code::config) only for invalid input: no
/// views, more than kViewsMax, or a number that is not finite. Also for a kind that the views lack, gaps in the
/// numbering of balls, and noise that is negative or zero in a residual. Cost: 20 views about 20 ms; about 0.5 s with
/// the convention test, which runs if the views do not fit.
[[nodiscard]] Result<HandEye> solve(ArtefactKind kind, std::span<const View> views, const StatedNoise& noise,
                                    const SolveSettings& settings = {});

/// Predicted value of a set of views before it is measured: the Cramer-Rao bound at a given X, with each view from a
/// separate place. `views` may contain planned views: only their T_base_flange and visible balls are used, and the
/// sightings follow from X and targets.
struct Prediction {
  double point_sigma_mm = kNoValue;  ///< NaN if a direction is not determined
  double condition = kNoValue;
  double smallest_singular_value = kNoValue;  ///< the next view should increase this value most
};
[[nodiscard]] Prediction predict(ArtefactKind kind, std::span<const View> views, const Pose& T_flange_scanner,
                                 std::span<const Pose> targets, const StatedNoise& noise, const FieldOfView& fov = {});

/// Residuals of views that need not be part of the fit: held-out ones, or the same views with another calibration.
/// Leave-one-out stays NaN. `targets` as in HandEye; `best_targets` computes those that fit the views best.
[[nodiscard]] std::vector<ViewFit> residuals_of(ArtefactKind kind, std::span<const View> views,
                                                const Pose& T_flange_scanner, std::span<const Pose> targets,
                                                const StatedNoise& noise);
/// A shift (mm) and a turn (rad).
using Vec6 = Eigen::Matrix<double, 6, 1, Eigen::DontAlign>;
/// Effect of a systematic error of the sightings on T_flange_scanner, which no residual reveals. The artefact is
/// displaced by `shifts_mm[i]` (scanner axes) from its place in view i. Result: shift (mm) and turn (rad) in the order
/// of HandEye::covariance. It is linear, from the views kept by `hand_eye`, weighted by `noise` as stated. Zero if
/// nothing is determined.
[[nodiscard]] Vec6 motion_from_shifts(ArtefactKind kind, std::span<const View> views, const HandEye& hand_eye,
                                      const StatedNoise& noise, std::span<const Vec3> shifts_mm);
/// Places of the artefact for a given X: means over the views, one per ball, or one pose.
[[nodiscard]] std::vector<Pose> best_targets(ArtefactKind kind, std::span<const View> views,
                                             const Pose& T_flange_scanner);

[[nodiscard]] Spread spread_of(std::span<const double> values);  ///< NaN values are skipped

/// sqrt of the eigenvalues of mean(log R_ij log R_ij'), descending, deg. A cone of 35 deg has 25 as its smallest.
[[nodiscard]] std::array<double, 3> rotation_spread_axes_deg(std::span<const View> views);
/// Standard deviations of all measured ball centres along their principal axes, descending, mm.
[[nodiscard]] std::array<double, 3> ball_spread_axes_mm(std::span<const View> views);

/// rms over the field of view of sqrt(trace(J C J')), the 3-D standard deviation (k = 1) of a scanned point.
[[nodiscard]] double point_sigma_mm(const Mat6& covariance, const Pose& T_flange_scanner, const FieldOfView& fov);

/// Scale of the scanner from a certified distance between two balls in one view: a diagnosis, never applied.
struct ScaleDiagnosis {
  std::size_t views = 0;
  double ppm = kNoValue;  ///< (measured / certified - 1) 1e6
  double sigma_ppm = kNoValue;
  bool suspicious = false;  ///< more than 3 sigma and more than 100 ppm
};
[[nodiscard]] ScaleDiagnosis diagnose_scale(std::span<const View> views, std::size_t ball_a, std::size_t ball_b,
                                            double certified_mm, double certified_sigma_mm, double target_mm);

}  // namespace slabd::calib
