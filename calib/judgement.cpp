// SPDX-License-Identifier: Apache-2.0
//
// Derives reasons from figures. A cause is reported before its consequences, and consequences explained by it are not
// reported separately. Poses with a wrong meaning invalidate all other figures, and for a scanner that was never
// rotated the condition number is not reported.
#include "calib/hand_eye_parts.h"

#include <array>
#include <cmath>

#include "calib/sentence.h"

namespace slabd::calib {
namespace {

/// Below this a principal rotation or spread counts as zero.
constexpr double kNoRotation_deg = 0.5;
constexpr double kNearNothing_mm = 10.0;

void refuse(HandEye& result, Refusal code, std::string text, std::string cure) {
  result.reasons.push_back({code, std::move(text), std::move(cure)});
}

/// Larger of the ratios of positions and rotations. One of them may be better than stated; if both are, the stated
/// figures were invented.
double larger_s0(const HandEye& result) {
  return has_value(result.s0_rotation) ? std::max(result.s0_position, result.s0_rotation) : result.s0;
}

std::string numbers_of(const HandEye& result, std::span<const std::size_t> indices) {
  constexpr std::size_t kListed = 12;
  std::string list;
  for (std::size_t k = 0; k < indices.size() && k < kListed; ++k)
    list += (list.empty() ? "" : ", ") + std::to_string(result.views[indices[k]].number);
  if (indices.size() > kListed) list += ", ...";
  return list;
}

/// Reports targets that are copies of each other. True if there are enough copies to explain all other faults.
bool judge_same_target(const JudgementInputs& c, HandEye& result) {
  constexpr std::size_t kCopiesMin = 3;  // two may be by chance or a stale answer: warning, and the view is left out
  const SameTarget& same = c.same_target;
  if (same.views.size() < 2) return false;
  const std::string text =
      sentence("the target is the same in %zu views (%s), although the flange moved by up to %.0f mm and %.1f deg",
               same.views.size(), numbers_of(result, same.views).c_str(), same.moved_mm, deg_from_rad(same.turned_rad));
  if (same.views.size() < kCopiesMin) {
    result.warnings.push_back(text + ": one of them is a copy");
    return false;
  }
  refuse(result, Refusal::same_target, text,
         "write into every view what the scanner saw from there; if it really saw the same, the artefact moved with "
         "the scanner: fix it in the cell");
  return true;
}

/// Text "frames=..." with the contents of both tables, if both are inverted.
std::string cure_of_both_inverted(const DeclaredFormats& declared) {
  const bool flange = declared.flange && declared.flange->inverse;
  const bool target = declared.target && declared.target->inverse;
  return sentence(
      "give T_base_flange and T_scanner_target, or declare the content of the tables: # format: frames=%s and "
      "frames=%s",
      flange ? "T_base_flange" : "T_flange_base", target ? "T_scanner_target" : "T_target_scanner");
}

Refusal refusal_of(ConventionError misreading) {
  switch (misreading) {
    case ConventionError::units: return Refusal::units;
    case ConventionError::handedness: return Refusal::handedness;
    case ConventionError::pairing: return Refusal::pairing;
    case ConventionError::none:
    case ConventionError::convention: break;
  }
  return Refusal::convention;
}

/// Reports poses with another meaning than stated. True if that explains all other faults.
bool judge_reading(const JudgementInputs& c, HandEye& result) {
  if (judge_same_target(c, result)) return true;
  const ConventionReport& report = result.conventions;
  // A ball that was always at one place or on a line leaves too many directions open: a wrong reading may fit by
  // chance.
  const bool open = c.kind == ArtefactKind::ball && result.ball_spread_axes_mm[1] < kBallSpreadMin_mm;
  const bool named = report.fits != 0 && (!open || report.tried[report.fits].changes == ConventionError::units);
  if (named) {
    const Hypothesis& fits = report.tried[report.fits];
    refuse(result, refusal_of(fits.changes),
           sentence("as stated the views miss each other by %.1f mm (median); they fit to %.2f mm if %s",
                    report.tried[0].residual_mm, fits.residual_mm, fits.name.c_str()),
           fits.cure);
    return true;
  }
  const bool flange = c.median_flange_mm < kNearNothing_mm;
  const bool target = c.median_target_mm < kNearNothing_mm;
  if (flange || target) {
    refuse(result, Refusal::units,
           sentence("%s only %.3g mm long (median): metres read as millimetres?",
                    flange && target ? "flange positions and target positions are"
                    : flange         ? "flange positions are"
                                     : "target positions are",
                    flange ? c.median_flange_mm : c.median_target_mm),
           (flange && c.declared.flange && c.declared.flange->metres) ||
                   (target && c.declared.target && c.declared.target->metres)
               ? "check the unit in which the table was written"
               : "write millimetres, or declare it in the table: # format: unit=m");
    return true;
  }
  if (!result.determined) return false;
  const double arm_mm = result.T_flange_scanner.translation_mm.norm();
  if (!(arm_mm > kScannerArmMax_mm)) return false;
  if (c.kind == ArtefactKind::pose && result.targets[0].translation_mm.norm() < kScannerArmMax_mm) {
    refuse(
        result, Refusal::convention,
        sentence("the scanner would sit %.0f mm from its flange and the artefact %.0f mm from the robot's root: both "
                 "tables look inverted, which fits as well and exchanges the two",
                 arm_mm, result.targets[0].translation_mm.norm()),
        cure_of_both_inverted(c.declared));
    return true;
  }
  refuse(result, Refusal::implausible,
         sentence("the scanner would sit %.0f mm from its flange; more than %.0f mm is a mistake of frames or units",
                  arm_mm, kScannerArmMax_mm),
         "give the pose of the flange, not of a tool, in the robot's root frame, and check both units");
  return false;
}

void judge_count(const JudgementInputs& c, HandEye& result) {
  const std::size_t kept = c.views.size() - result.rejected.size();
  if (c.views.size() < kViewsMin)
    refuse(result, Refusal::too_few_views,
           sentence("%zu views; at least %zu are needed, 15 to 25 advised", c.views.size(), kViewsMin),
           "capture more views, tilted 20 to 35 deg in different directions");
  else if (kept < kViewsMin)
    refuse(
        result, Refusal::too_few_views,
        sentence("%zu of %zu views are left after rejection; at least %zu are needed", kept, c.views.size(), kViewsMin),
        "repeat the rejected views and capture more");
  else if (c.places < kViewsMin)
    refuse(result, Refusal::too_few_views,
           sentence("%zu views, but from %zu poses of the flange only (nearer than %.0f mm and "
                    "%.1f deg is one pose); at "
                    "least %zu are needed, 15 to 25 advised",
                    kept, c.places, kSamePlace_mm, kSamePlace_deg, kViewsMin),
           "drive to other poses, tilted 20 to 35 deg in different directions; another view from the same pose adds no "
           "information");
}

/// Reports missing rotations. True if they are the cause of the undetermined directions. Rotations about two axes
/// determine the calibration (tilts to all sides without a roll). The third only improves it, so the second principal
/// value decides.
bool judge_rotations(HandEye& result) {
  const std::array<double, 3>& spread = result.rotation_spread_axes_deg;
  if (!(spread[1] < kRotationSpreadMin_deg)) return false;
  if (spread[0] < kNoRotation_deg) {
    refuse(result, Refusal::one_orientation,
           sentence("all views have one orientation (spread %.2f deg): the position of the scanner cannot be "
                    "distinguished from that of the artefact",
                    spread[0]),
           "tilt the scanner by +-25 deg about two axes between views");
  } else if (spread[1] < kNoRotation_deg) {
    refuse(result, Refusal::one_rotation_axis,
           sentence("the scanner was turned about one axis only (spread %.1f, %.2f, %.2f deg): its position along that "
                    "axis is not determined",
                    spread[0], spread[1], spread[2]),
           "tilt about a second axis too, +-25 deg");
  } else {
    refuse(result, Refusal::rotation_too_small,
           sentence("the scanner was hardly turned about %s: principal rotation spread %.1f, %.1f, %.1f deg, two of "
                    "them must reach %.0f (better all three %.0f)",
                    spread[0] < kRotationSpreadMin_deg ? "any axis" : "two of three axes", spread[0], spread[1],
                    spread[2], kRotationSpreadMin_deg, kRotationSpreadAdvised_deg),
           "use larger tilts, 20 to 35 deg in six or more directions");
  }
  return true;
}

bool judge_ball_places(HandEye& result) {
  const std::array<double, 3>& spread = result.ball_spread_axes_mm;
  if (!(spread[1] < kBallSpreadMin_mm)) return false;
  if (spread[0] < kBallSpreadMin_mm)
    refuse(result, Refusal::ball_in_one_place,
           sentence("the ball was always in one place of the view (standard deviation %.1f, %.1f, %.1f mm, two of them "
                    "must reach %.0f): the scanner's orientation is not determined",
                    spread[0], spread[1], spread[2], kBallSpreadMin_mm),
           "put the ball into the four corners of the view, near and far");
  else
    refuse(result, Refusal::ball_on_a_line,
           sentence("the ball was always on one line in the view (standard deviation %.1f mm along it, %.1f mm across, "
                    "which must reach %.0f): the scanner's turn about that line is not determined",
                    spread[0], spread[1], kBallSpreadMin_mm),
           "move the ball sideways in the view, into all four corners");
  return true;
}

/// Reports a ball that stayed in one plane: a mirrored cloud would then look the same.
void judge_handedness(const JudgementInputs& c, HandEye& result) {
  constexpr double kSigmas = 5.0;
  const double needed_mm = kSigmas * std::hypot(c.noise.robot_mm, c.noise.target_mm);
  if (c.kind != ArtefactKind::ball || !(result.ball_spread_axes_mm[2] < needed_mm)) return;
  refuse(
      result, Refusal::handedness,
      sentence("the ball was always in one plane of the view (standard deviation %.2f mm across it, which must reach "
               "%.2f): a mirrored cloud would fit as well",
               result.ball_spread_axes_mm[2], needed_mm),
      "put the ball near and far in the view too");
}

void judge_fit(const JudgementInputs& c, HandEye& result) {
  const double share = static_cast<double>(result.rejected.size()) / static_cast<double>(c.views.size());
  if (share > kRejectedShareMax)
    refuse(result, Refusal::too_many_rejected,
           sentence("%zu of %zu views do not fit the others (more than %.0f %%): it is unknown which ones are right",
                    result.rejected.size(), c.views.size(), 100.0 * kRejectedShareMax),
           "look for what changed during capture: artefact moved, scanner knocked, poses taken while the robot moved; "
           "then capture again");
  if (result.determined && !has_value(result.s0))
    refuse(result, Refusal::too_few_views,
           "no equation is redundant: these views always fit, whether they are right or wrong",
           "have every ball seen from several poses of the flange");
  if (result.s0 > kS0Max) {
    // Residuals of centimetres are not noise: a reading is wrong in a way that the convention test does not cover.
    constexpr double kNoNoise_mm = 10.0;
    const double fits_mm = result.s0_position * std::hypot(c.noise.robot_mm, c.noise.target_mm);
    refuse(
        result, Refusal::noise_above_stated,
        sentence("residuals are %.3g times what the stated noise explains (at most %.0f): robot %.3g mm, %.3g deg",
                 result.s0, kS0Max, c.noise.robot_mm, deg_from_rad(c.noise.robot_rad)),
        fits_mm > kNoNoise_mm
            ? "no known misreading of the poses explains it: check that each target belongs to its flange pose, that "
              "the artefact did not move, and frames, angles and units of both tables"
            : sentence("if the robot is no better than that, state it (about %.2g mm); else find out what moved",
                       fits_mm));
  }
  if (const double larger = larger_s0(result); larger < kS0Min)
    refuse(result, Refusal::noise_below_stated,
           sentence("residuals are only %.2g of what the stated noise explains (at least %.1f)", larger, kS0Min),
           sentence("if the stated figure is the robot's accuracy, which neighbouring poses share, state its "
                    "repeatability (here about %.2g mm); else find out whether views are copies of each other",
                    result.s0_position * std::hypot(c.noise.robot_mm, c.noise.target_mm)));
  if (!c.converged && result.determined)
    refuse(result, Refusal::not_converged, "the adjustment did not converge",
           "capture more views, more different ones");
  const Spread& loo = result.leave_one_out_mm;
  if (loo.max > kLeaveOneOutRatioMax * loo.median) {
    std::size_t view = 0;
    for (std::size_t i = 0; i < result.views.size(); ++i)
      if (result.views[i].kept && result.views[i].leave_one_out_mm == loo.max) view = result.views[i].number;
    refuse(result, Refusal::leave_one_out,
           sentence("view %zu is missed by %.3f mm when the others predict it, %.1f times the median (at most %.0f): "
                    "the result depends on it",
                    view, loo.max, loo.max / loo.median, kLeaveOneOutRatioMax),
           sentence("repeat view %zu, or capture others like it", view));
  }
}

/// Compares the scanner's lengths with the robot's.
void judge_scale(const JudgementInputs& c, HandEye& result) {
  const double off = result.scale - 1.0;
  if (!(std::abs(off) > kScaleSigmas * result.scale_sigma)) return;
  constexpr double kPpm = 1e6;
  const std::string text =
      sentence("the scanner's lengths are %.2f %% too %s against the robot's: lambda %.5f +- %.5f (1 sigma), %.0f ppm",
               100.0 * std::abs(off), off > 0.0 ? "short" : "long", result.scale, result.scale_sigma, kPpm * off);
  if (!(std::abs(off) > c.scale_off_max)) {
    result.warnings.push_back(text + "; it is not applied");
    return;
  }
  refuse(result, Refusal::scale, text + sentence(", accepted is %.2f %%", 100.0 * c.scale_off_max),
         "check the scanner's own calibration and unit (slabctl scanner verify), and that the robot's positions are in "
         "true mm; a scale is never applied");
}

void advise(const JudgementInputs& c, HandEye& result) {
  if (c.views.size() < kViewsAdvised && c.views.size() >= kViewsMin)
    result.warnings.push_back(sentence("%zu views; 15 to 25 are advised", c.views.size()));
  const std::array<double, 3>& spread = result.rotation_spread_axes_deg;
  if (spread[2] < kRotationSpreadAdvised_deg && spread[1] >= kRotationSpreadMin_deg)
    result.warnings.push_back(
        sentence("smallest rotation spread %.1f deg; %.0f is advised: %s", spread[2], kRotationSpreadAdvised_deg,
                 spread[1] < kRotationSpreadAdvised_deg ? "larger tilts"
                                                        : "turn about the third axis too (roll of +-45 deg or more)"));
  if (const double larger = larger_s0(result); larger >= kS0Min && larger < kS0Said)
    result.warnings.push_back(
        sentence("residuals are only %.2g of what the stated noise explains: errors that neighbouring poses share (the "
                 "robot's accuracy) do not show in them; the scatter of these views is about %.2g mm",
                 larger, result.s0_position * std::hypot(c.noise.robot_mm, c.noise.target_mm)));
  if (has_value(result.repeat_share))
    result.warnings.push_back(sentence(
        "%zu views from %zu poses of the flange: views from one pose have %.0f %% of their error (variance) in "
        "common, which more of them do not make smaller; other poses do",
        c.views.size() - result.rejected.size(), c.places, 100.0 * result.repeat_share));
  if (result.reweighted)
    result.warnings.push_back(
        sentence("positions err %.2f and rotations %.2f times as much as stated; they were weighed accordingly",
                 result.s0_position, result.s0_rotation));
  if (!result.rejected.empty()) {
    std::string list;
    for (const std::size_t i : result.rejected)
      list += (list.empty() ? "" : ", ") + std::to_string(result.views[i].number);
    result.warnings.push_back("views that do not fit and were left out: " + list);
  }
  std::size_t behind = 0;
  for (const View& view : c.views) {
    bool any = c.kind == ArtefactKind::pose && view.T_scanner_target.translation_mm.z() <= 0.0;
    for (const BallObservation& seen : view.balls)
      any = any || (c.kind == ArtefactKind::ball && seen.centre_mm.z() <= 0.0);
    behind += any ? 1 : 0;
  }
  if (behind > 0)
    result.warnings.push_back(
        sentence("in %zu views the artefact is behind the scanner (z <= 0); +Z points towards the part", behind));
}

}  // namespace

bool needs_convention_test(const HandEye& result) {
  const double share = static_cast<double>(result.rejected.size()) / static_cast<double>(result.views.size());
  return !(result.s0 <= kS0Max) || share > kRejectedShareMax ||
         result.T_flange_scanner.translation_mm.norm() > kScannerArmMax_mm;
}

void judge(const JudgementInputs& c, HandEye& result) {
  judge_count(c, result);
  if (!judge_reading(c, result)) {
    const bool turned_badly = judge_rotations(result);
    const bool placed_badly = c.kind == ArtefactKind::ball && judge_ball_places(result);
    if (!(result.condition <= kConditionMax) && !turned_badly && !placed_badly)
      refuse(result, Refusal::ill_conditioned,
             sentence("the views hardly determine %s (condition %.3g, at most %.0f)", c.weakest.c_str(),
                      result.condition, kConditionMax),
             "capture views that differ more: tilt in other directions, artefact in the corners of the view");
    if (!turned_badly && !placed_badly) judge_handedness(c, result);
    judge_fit(c, result);
    judge_scale(c, result);
    if (result.determined && !(result.predicted_point_sigma_mm <= result.point_sigma_limit_mm))
      refuse(result, Refusal::predicted_error,
             sentence("predicted error of a scanned point is %.3f mm (k = 1), limit %.3f mm",
                      result.predicted_point_sigma_mm, result.point_sigma_limit_mm),
             "capture more views, tilted 20 to 35 deg, the artefact in the corners of the view");
  }
  advise(c, result);
  // An undetermined result must not be used, even if none of the reasons above applies.
  if (!result.determined && result.reasons.empty())
    refuse(result, Refusal::ill_conditioned, "the views do not determine " + c.weakest,
           "capture views that differ more");
  result.ok = result.determined && result.reasons.empty();
}

std::string_view name(Refusal refusal) {
  switch (refusal) {
    case Refusal::too_few_views: return "too_few_views";
    case Refusal::one_orientation: return "one_orientation";
    case Refusal::one_rotation_axis: return "one_rotation_axis";
    case Refusal::rotation_too_small: return "rotation_too_small";
    case Refusal::ball_in_one_place: return "ball_in_one_place";
    case Refusal::ball_on_a_line: return "ball_on_a_line";
    case Refusal::ill_conditioned: return "ill_conditioned";
    case Refusal::convention: return "convention";
    case Refusal::units: return "units";
    case Refusal::too_many_rejected: return "too_many_rejected";
    case Refusal::noise_above_stated: return "noise_above_stated";
    case Refusal::noise_below_stated: return "noise_below_stated";
    case Refusal::leave_one_out: return "leave_one_out";
    case Refusal::predicted_error: return "predicted_error";
    case Refusal::not_converged: return "not_converged";
    case Refusal::implausible: return "implausible";
    case Refusal::ball_radius: return "ball_radius";
    case Refusal::same_target: return "same_target";
    case Refusal::handedness: return "handedness";
    case Refusal::pairing: return "pairing";
    case Refusal::scale: return "scale";
  }
  return "";
}

}  // namespace slabd::calib
