// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/base.h"
#include "base/calibration.h"
#include "calib/hand_eye.h"
#include "calib/observations.h"

/// The tie of two robots: the second robot's base in the base frame of the line, which is the base of the first robot.
///
/// Both robots measure the same balls, which are fixed in the cell, each through its own hand-eye calibration. With A
/// the reported flange pose, h = T_flange_scanner and c the ball's centre in the scanner frame, a sighting gives the
/// place q = A h c in the base of its own robot. For every ball, q_first = T_base_robot q_second.
///
/// Each robot's sightings of a ball are averaged with the weights of their stated noise. T_base_robot is the weighted
/// least-squares fit of the averages, refined from a closed form. Its covariance adds these parts:
///
///   robot      a shift and a turn about the flange for each view; views from one place of the flange (same_place())
///              count as one, because they repeat its error
///   target     each sighting on its own
///   hand-eye   a shift (sigma_mm) and a turn (sigma_rad) of each scanner on its flange, the same in all views. The
///   shift
///              counts in full for the place of the base, as if all views had one orientation; more views do not
///              reduce it.
///
/// The first two are multiplied by max(1, s0^2). Pure computation; the same sightings give the same bits.
namespace slabd::calib {

/// One ball in one view of one robot.
struct TieSighting {
  std::size_t target = 0;         ///< index of the ball, the same for both robots
  Pose T_base_flange;             ///< as reported, in the base of this robot
  Vec3 centre_mm = Vec3::Zero();  ///< scanner frame
};

/// One robot: its sightings, its hand-eye calibration and its stated noise.
struct TieArm {
  std::vector<TieSighting> sightings;
  HandEyeNumbers hand_eye;  ///< sigmas that are NaN count as 0
  StatedNoise noise;
};

inline constexpr std::size_t kTieTargetsMin = 4;
/// Limit of the condition. Targets on a line leave the turn about it undetermined. At the limit they scatter across it
/// by a fourteenth of their scatter along it.
inline constexpr double kTieConditionMax = 15.0;
inline constexpr double kTieConditionDegenerate = 1e4;  ///< above it a turn is not determined at all
/// A ball that deviates from the others by more than this, in standard deviations, has moved between the two robots.
inline constexpr double kTieMovedSigmas = 4.5;

/// Reason why a tie is rejected. The words returned by `name` are stable.
enum class TieRefusal : std::uint8_t {
  too_few_targets,     ///< fewer than kTieTargetsMin are seen by both robots
  targets_on_a_line,   ///< condition above kTieConditionMax
  target_moved,        ///< one ball contradicts the others; the text contains its name
  noise_above_stated,  ///< s0 above kS0Max
  not_converged,
};
[[nodiscard]] std::string_view name(TieRefusal refusal);

struct TieReason {
  TieRefusal code{};
  std::string text;  ///< description with figure and limit
  std::string cure;
};

/// Fit of one ball that both robots measured.
struct TieTarget {
  std::size_t target = 0;              ///< index given in the sightings
  std::array<std::size_t, 2> views{};  ///< number of sightings of each robot
  Vec3 p_base = Vec3::Zero();          ///< mean of both, base frame of the line
  double residual_mm = kNoValue;       ///< distance between the two measurements
  double leave_one_out_mm = kNoValue;  ///< the same by the tie of the other balls
  double sigmas = kNoValue;            ///< leave-one-out over its own standard deviation, as a normal variable
};

struct Tie {
  bool ok = false;  ///< false: rejected, with `reasons`; the figures are set nevertheless
  std::vector<TieReason> reasons;
  bool determined = false;               ///< false: `numbers` and the figures that follow from them are NaN
  TieNumbers numbers;                    ///< without the name of the robot
  std::vector<TieTarget> targets;        ///< ascending
  std::vector<std::size_t> seen_by_one;  ///< balls that only one robot measured; they are not used
  Spread residual_mm;
  Spread leave_one_out_mm;
  double s0 = kNoValue;        ///< residuals over stated noise; 1 if the stated noise is right
  int degrees_of_freedom = 0;  ///< of s0
  double condition =
      kNoValue;  ///< of the whitened equations, turns scaled by the targets' rms distance from the middle
  /// Standard deviations of the targets along their principal axes, descending.
  std::array<double, 3> spread_axes_mm{kNoValue, kNoValue, kNoValue};
};

/// Solves the tie. Refusals are part of the answer. Error (Code::config) only for invalid input: a robot without
/// sightings, numbers that are not finite, noise that is negative or zero, more than kViewsMax sightings or kBallsMax
/// balls.
/// `names`: of the balls, for the reasons; without them a ball is named by its number, from 1.
[[nodiscard]] Result<Tie> solve_tie(const TieArm& first, const TieArm& second, std::span<const std::string> names = {});

/// Standard deviation (k = 1, in space) of a place in the base frame that was measured by the second robot, from the
/// tie alone.
[[nodiscard]] double tie_sigma_mm(const TieNumbers& tie, const Vec3& p_base);

/// Sightings from views of balls. Without labels in the target table all views have ball 0. `names`: one name for each
/// line of the target table. Equal names are one ball in both tables, and `known` collects the names of the balls in
/// their order. Without names and labels the k-th line is ball k. Code::config: a number of names that differs from the
/// number of lines, names for a table with labels, or more than kBallsMax balls.
[[nodiscard]] Result<std::vector<TieSighting>> tie_sightings(std::span<const View> views, bool labelled,
                                                             std::span<const std::string> names,
                                                             std::vector<std::string>& known);

/// Names, one a line; # starts a comment, empty lines are skipped.
[[nodiscard]] std::vector<std::string> parse_target_names(std::string_view text);

}  // namespace slabd::calib
