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

/// Hand-eye calibration: X = T_flange_scanner from views of a fixed artefact, how well it is known, and every reason
/// not to use it. Pure computing; runs on maintenance only and uses the heap. The same views give the same bits.
namespace slabd::calib {

/// Where in the scanner's view the error is predicted: 3 x 3 x 3 points.
struct FieldOfView {
  double half_x_mm = 100.0;
  double half_y_mm = 100.0;
  double near_mm = 420.0;
  double far_mm = 580.0;
};

/// Default of SolveSettings::scale_off_max. A robot that errs smoothly by 0.7 mm looks like 0.33 % (60 sets of 20
/// views, the worst).
inline constexpr double kScaleOffMax = 0.005;
/// A scale is named when it is further from 1 than this many of its standard deviations.
inline constexpr double kScaleSigmas = 3.0;

struct SolveSettings {
  FieldOfView fov;
  /// Limit of predicted_point_sigma_mm. NaN: `kPointSigmaPerNoise` times the stated position error, which a set that
  /// is arranged well stays below with any robot.
  double point_sigma_mm_max = kNoValue;
  bool convention_test = true;  ///< off: faster, for callers who solve the same views many times
  DeclaredFormats declared;     ///< by the tables the views were read from
  /// Largest relative error of the scanner's scale (lambda - 1) that is accepted when the views show one.
  double scale_off_max = kScaleOffMax;
};
inline constexpr double kPointSigmaPerNoise = 6.0;

// The limits of a refusal, each with its reason code below.
inline constexpr std::size_t kViewsMin = 6;
inline constexpr std::size_t kViewsAdvised = 10;
inline constexpr double kRotationSpreadMinDeg = 5.0;  ///< of the second principal value: two axes determine everything
inline constexpr double kRotationSpreadAdvisedDeg = 15.0;
inline constexpr double kConditionMax = 50.0;
inline constexpr double kConditionDegenerate = 1e4;  ///< above it a direction is not determined at all
inline constexpr double kBallSpreadMinMm = 25.0;
inline constexpr double kRejectedShareMax = 0.25;
inline constexpr double kS0Min = 0.1;
/// Below this it is said, not refused. Too large a figure weighs the views alike and predicts too large an error, which
/// is safe; and a robot's accuracy, stated in good faith, is seen as a smaller noise within a small volume because
/// neighbouring poses share it.
inline constexpr double kS0Said = 0.3;
inline constexpr double kS0Max = 3.0;
inline constexpr double kLeaveOneOutRatioMax = 4.0;
inline constexpr double kScannerArmMaxMm =
    1000.0;  ///< a scanner further from its flange is a mistake of frames or units

/// Why a calibration is refused. The words of `name` are stable; scripts may test them.
enum class Refusal : std::uint8_t {
  too_few_views,       ///< fewer than kViewsMin, or fewer kept than that
  one_orientation,     ///< the scanner was never turned
  one_rotation_axis,   ///< turned about one axis only
  rotation_too_small,  ///< turned about fewer than two axes by kRotationSpreadMinDeg
  ball_in_one_place,   ///< the ball was always in one place of the view
  ball_on_a_line,      ///< ... on a line, as the optical axis
  ill_conditioned,     ///< condition above kConditionMax; the text names what is not determined
  convention,          ///< another reading of the poses fits; the text names it
  units,               ///< another unit on one side fits
  too_many_rejected,   ///< more than kRejectedShareMax of the views do not fit the others
  noise_above_stated,  ///< s0 above kS0Max
  noise_below_stated,  ///< s0 below kS0Min
  leave_one_out,       ///< one view decides: leave-one-out max above kLeaveOneOutRatioMax medians
  predicted_error,     ///< predicted point error above its limit
  not_converged,       ///< the adjustment did not settle
  implausible,         ///< a scanner further than kScannerArmMaxMm from its flange
  ball_radius,         ///< the scans show balls of another radius than certified
  same_target,         ///< the target is the same in views whose flange poses differ
  handedness,          ///< an axis of the scanner is mirrored
  pairing,             ///< targets belong to flange poses on other lines
  scale,               ///< the scanner's scale differs from the robot's by more than is accepted
};
[[nodiscard]] std::string_view name(Refusal refusal);

struct Reason {
  Refusal code{};
  std::string text;  ///< what is wrong, with figure and limit
  std::string cure;  ///< what to do about it
};

/// NaN where there is nothing to tell.
struct Spread {
  double median = kNoValue;
  double rms = kNoValue;
  double max = kNoValue;
};

/// How one view fits.
struct ViewFit {
  std::size_t number = 0;              ///< of the view, from 1
  double residual_mm = kNoValue;       ///< |A X c - p|, or of the artefact's origin; rms over the balls of a view
  double residual_deg = kNoValue;      ///< pose: angle between A X B and Z
  double leave_one_out_mm = kNoValue;  ///< residual_mm against the solution without this view; kept views
  double leave_one_out_deg = kNoValue;
  double sigmas = kNoValue;  ///< residual over its own standard deviation, as a normal variable of the same rarity
  bool kept = true;
};

struct HandEye {
  bool ok = false;  ///< false: refused, `reasons` say why; the figures are there all the same
  std::vector<Reason> reasons;
  std::vector<std::string> warnings;  ///< sentences; nothing that forbids the use

  bool determined = false;    ///< false: a direction is not determined; pose, target and sigmas mean nothing (NaN)
  Pose T_flange_scanner;      ///< maps scanner coordinates to flange coordinates
  std::vector<Pose> targets;  ///< in the base frame: one per ball (rotation identity), or the artefact's pose

  std::vector<ViewFit> views;         ///< one per view given
  std::vector<std::size_t> rejected;  ///< indices of views that do not fit, ascending
  std::size_t worst_view = 0;         ///< the kept one with the largest `sigmas`
  Spread residual_mm, residual_deg;   ///< of kept views
  Spread leave_one_out_mm, leave_one_out_deg;

  double s0 = kNoValue;           ///< residuals over stated noise; 1 when the stated noise is right
  double s0_position = kNoValue;  ///< the same for positions and rotations apart
  double s0_rotation = kNoValue;  ///< pose
  /// Of what positions err by (variance), what views from one place of the flange (same_place()) have in common, as
  /// their scatter shows it: that part does not fall with repeats, and s0, sigmas and the predicted error know it. NaN:
  /// no place was seen twice.
  double repeat_share = kNoValue;
  /// The paper's lambda (eq. 7): what the sightings must be multiplied by to agree with the robot's lengths, fitted
  /// beside X as a diagnosis; it is not applied. NaN where the views do not determine it.
  double scale = kNoValue;
  double scale_sigma = kNoValue;  ///< standard deviation, times max(1, s0)
  bool reweighted = false;        ///< position and rotation were weighed by s0_position and s0_rotation
  bool robot_lever = true;      ///< pose: false: positions were weighed without what the robot's turns would do to them
  double condition = kNoValue;  ///< of the whitened Jacobian, rotations scaled by 500 mm
  double smallest_singular_value = kNoValue;                                     ///< of the same, 1 / mm
  double rotation_spread_deg = kNoValue;                                         ///< the smallest principal value
  std::array<double, 3> rotation_spread_axes_deg{kNoValue, kNoValue, kNoValue};  ///< all, descending
  std::array<double, 3> ball_spread_axes_mm{kNoValue, kNoValue, kNoValue};       ///< ball: sd in the view, descending
  double predicted_point_sigma_mm =
      kNoValue;                            ///< k = 1, 3-D, rms over the field of view; random part, times max(1, s0)
  double point_sigma_limit_mm = kNoValue;  ///< what it was held against
  /// Of T_flange_scanner, times max(1, s0)^2: translation along the flange's axes (mm), then a small turn about the
  /// scanner's axes (rad), `R = R_X exp(turn)`. Translation and turn are strongly correlated; for a point q of the
  /// scanner use J C J' with J = [I, -R_X [q]x].
  Mat6 covariance = Mat6::Constant(kNoValue);

  ConventionReport conventions;  ///< what was tried; empty when the views fit as they are
};

/// Solves. Refusals are part of the answer. Error (Code::config) only for what is no set of views at all: none, more
/// than kViewsMax, a number that is not finite, a kind the views do not have, balls not numbered without gaps, noise
/// that is negative or leaves a residual without any. Cost: 20 views about 20 ms; with the convention test, which runs
/// when the views do not fit, about 0.5 s.
[[nodiscard]] Result<HandEye> solve(ArtefactKind kind, std::span<const View> views, const StatedNoise& noise,
                                    const SolveSettings& settings = {});

/// What a set of views would be worth, were it measured: the Cramer-Rao bound at a given X, each view from a place of
/// its own. `views` may hold planned ones: of them only T_base_flange and which balls they see are used, where they see
/// them follows from X and targets.
struct Prediction {
  double point_sigma_mm = kNoValue;  ///< NaN when a direction is not determined
  double condition = kNoValue;
  double smallest_singular_value = kNoValue;  ///< what a next view should raise most
};
[[nodiscard]] Prediction predict(ArtefactKind kind, std::span<const View> views, const Pose& T_flange_scanner,
                                 std::span<const Pose> targets, const StatedNoise& noise, const FieldOfView& fov = {});

/// Residuals of views that need not have taken part in the fit: held-out ones, or another calibration on the same
/// views. Leave-one-out stays NaN. `targets` as in HandEye; `best_targets` finds those that fit the views best.
[[nodiscard]] std::vector<ViewFit> residuals_of(ArtefactKind kind, std::span<const View> views,
                                                const Pose& T_flange_scanner, std::span<const Pose> targets,
                                                const StatedNoise& noise);
/// A shift (mm) and a turn (rad).
using Vec6 = Eigen::Matrix<double, 6, 1, Eigen::DontAlign>;
/// How T_flange_scanner follows a systematic error of the sightings, which no residual shows: the artefact lies
/// `shifts_mm[i]` (scanner axes) from where view i saw it. Shift (mm) and turn (rad) in the order of
/// HandEye::covariance; linear, from the views that `hand_eye` kept, weighed by `noise` as stated. Zero where nothing
/// is determined.
[[nodiscard]] Vec6 motion_from_shifts(ArtefactKind kind, std::span<const View> views, const HandEye& hand_eye,
                                      const StatedNoise& noise, std::span<const Vec3> shifts_mm);
/// Where the artefact stands if X is given: means over the views, one per ball, or one pose.
[[nodiscard]] std::vector<Pose> best_targets(ArtefactKind kind, std::span<const View> views,
                                             const Pose& T_flange_scanner);

[[nodiscard]] Spread spread_of(std::span<const double> values);  ///< NaN values are left out

/// sqrt of the eigenvalues of mean(log R_ij log R_ij'), descending, deg. A cone of 35 deg has 25 as its smallest.
[[nodiscard]] std::array<double, 3> rotation_spread_axes_deg(std::span<const View> views);
/// Standard deviations of all sighted ball centres along their principal axes, descending, mm.
[[nodiscard]] std::array<double, 3> ball_spread_axes_mm(std::span<const View> views);

/// rms over the field of view of sqrt(trace(J C J')), the 3-D standard deviation (k = 1) of a scanned point.
[[nodiscard]] double point_sigma_mm(const Mat6& covariance, const Pose& T_flange_scanner, const FieldOfView& fov);

/// The scanner's scale from a certified distance between two balls that are seen together: a diagnosis, never applied.
struct ScaleDiagnosis {
  std::size_t views = 0;
  double ppm = kNoValue;  ///< (measured / certified - 1) 1e6
  double sigma_ppm = kNoValue;
  bool suspicious = false;  ///< more than 3 sigma and more than 100 ppm
};
[[nodiscard]] ScaleDiagnosis diagnose_scale(std::span<const View> views, std::size_t ball_a, std::size_t ball_b,
                                            double certified_mm, double certified_sigma_mm, double target_mm);

}  // namespace slabd::calib
