// SPDX-License-Identifier: Apache-2.0
#include "calib/tie.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "calib/mathematics.h"
#include "calib/sentence.h"

namespace slabd::calib {
namespace {

constexpr std::array<std::string_view, 5> kRefusals = {"too_few_targets", "targets_on_a_line", "target_moved",
                                                       "noise_above_stated", "not_converged"};
/// Fewest targets with which a rigid motion can be determined.
constexpr std::size_t kTargetsLeast = 3;
/// Motions below these end the refinement; both are far below the noise of any robot.
constexpr double kStepMin_mm = 1e-9;
constexpr double kStepMin_rad = 1e-12;
constexpr int kStepsMax = 30;

using Matrix = Eigen::MatrixXd;

double square(double v) {
  return v * v;
}

/// All sightings of one ball from one place of the flange, in the base of their own robot. They share the robot's
/// error, so only their mean says something of it.
struct Place {
  Vec3 q_mm = Vec3::Zero();           ///< place of the ball
  Vec3 u_mm = Vec3::Zero();           ///< the same from the flange, axes of the base
  Mat3 R_base_flange = Mat3::Zero();  ///< rotation of the flange
  Mat3 covariance = Mat3::Zero();     ///< by the stated noise
  Mat3 weight = Mat3::Zero();         ///< its inverse
  std::size_t target = 0;             ///< the ball
  std::size_t view = 0;               ///< place of the flange; equal ones repeat the robot's error
  std::size_t sightings = 0;
  double target_mm = 0.0;  ///< standard deviation of the mean by the noise of the target
};

Mat3 inverse3(const Mat3& m) {
  return inverse(Matrix(m));
}

std::vector<Place> places_of(const TieArm& arm) {
  std::vector<Place> places;
  std::vector<Pose> stops;
  for (const TieSighting& sighting : arm.sightings) {
    const auto stop = std::find_if(stops.begin(), stops.end(),
                                   [&](const Pose& pose) { return same_place(pose, sighting.T_base_flange); });
    const auto view = static_cast<std::size_t>(stop - stops.begin());
    if (stop == stops.end()) stops.push_back(sighting.T_base_flange);
    auto place = std::find_if(places.begin(), places.end(),
                              [&](const Place& one) { return one.target == sighting.target && one.view == view; });
    if (place == places.end()) {
      place = places.insert(places.end(), Place{});
      place->target = sighting.target;
      place->view = view;
      place->R_base_flange = sighting.T_base_flange.rotation.toRotationMatrix();
    }
    const Vec3 u = arm.hand_eye.T_flange_scanner * sighting.centre_mm;
    place->u_mm += sighting.T_base_flange.rotation.toRotationMatrix() * u;
    place->q_mm += sighting.T_base_flange * u;
    ++place->sightings;
  }
  for (Place& place : places) {
    const auto n = static_cast<double>(place.sightings);
    place.u_mm /= n;
    place.q_mm /= n;
    place.target_mm = arm.noise.target_mm / std::sqrt(n);
    const Mat3 lever = skew(place.u_mm);
    place.covariance = (square(arm.noise.robot_mm) + square(place.target_mm)) * Mat3::Identity() +
                       square(arm.noise.robot_rad) * lever * lever.transpose();
    place.weight = inverse3(place.covariance);
  }
  return places;
}

/// All places from which one robot saw one ball.
struct Mean {
  std::vector<std::size_t> places;
  Vec3 q_mm = Vec3::Zero();
  Mat3 covariance = Mat3::Zero();  ///< of the weighted mean
  double chi_square = 0.0;         ///< of the places about it
};

Mean mean_of(const std::vector<Place>& places, std::vector<std::size_t> chosen) {
  Mean mean;
  mean.places = std::move(chosen);
  Mat3 weight = Mat3::Zero();
  Vec3 sum = Vec3::Zero();
  for (const std::size_t i : mean.places) {
    weight += places[i].weight;
    sum += places[i].weight * places[i].q_mm;
  }
  mean.covariance = inverse3(weight);
  mean.q_mm = mean.covariance * sum;
  for (const std::size_t i : mean.places) {
    const Vec3 off = places[i].q_mm - mean.q_mm;
    mean.chi_square += off.dot(places[i].weight * off);
  }
  return mean;
}

/// One ball, measured by both robots.
struct Pair {
  std::size_t target = 0;
  std::array<Mean, 2> by;
};

/// Small motion of the second base at a place, about the middle: J (t, w) = t + w x (p - middle).
Eigen::Matrix<double, 3, 6> motion_at(const Vec3& p_mm, const Vec3& middle_mm) {
  Eigen::Matrix<double, 3, 6> J;
  J.leftCols<3>().setIdentity();
  J.rightCols<3>() = -skew(p_mm - middle_mm);
  return J;
}

/// Least-squares tie of some pairs.
struct Fit {
  Pose T;
  Vec3 middle_mm = Vec3::Zero();
  Mat6 covariance = Mat6::Constant(kNoValue);  ///< by the stated noise, all places independent
  double chi_square = 0.0;                     ///< of the pairs
  bool converged = false;
};

Mat3 covariance_of(const Pair& pair, const Pose& T) {
  const Mat3 R = T.rotation.toRotationMatrix();
  return pair.by[0].covariance + R * pair.by[1].covariance * R.transpose();
}

Fit fit(const std::vector<Pair>& pairs, std::optional<std::size_t> without = {}) {
  std::vector<Vec3> from;
  std::vector<Vec3> to;
  std::vector<const Pair*> used;
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    if (without == k) continue;
    used.push_back(&pairs[k]);
    from.push_back(pairs[k].by[1].q_mm);
    to.push_back(pairs[k].by[0].q_mm);
  }
  Fit out;
  for (const Vec3& p : to) out.middle_mm += p / static_cast<double>(to.size());
  out.T = rigid_fit(from, to);
  for (int step = 0; step < kStepsMax && !out.converged; ++step) {
    Mat6 N = Mat6::Zero();
    Vec6 right = Vec6::Zero();
    out.chi_square = 0.0;
    for (const Pair* pair : used) {
      const Vec3 p = out.T * pair->by[1].q_mm;
      const Vec3 off = pair->by[0].q_mm - p;
      const Mat3 weight = inverse3(covariance_of(*pair, out.T));
      const Eigen::Matrix<double, 3, 6> J = motion_at(p, out.middle_mm);
      N += J.transpose() * weight * J;
      right += J.transpose() * (weight * off);
      out.chi_square += off.dot(weight * off);
    }
    out.covariance = inverse(Matrix(N));
    const Vec6 motion = out.covariance * right;
    if (!motion.allFinite()) return out;
    const Quat turn = exp_rotation(motion.tail<3>());
    out.T.translation_mm = out.middle_mm + turn * Vec3(out.T.translation_mm - out.middle_mm) + Vec3(motion.head<3>());
    out.T.rotation = (turn * out.T.rotation).normalized();
    out.converged = motion.head<3>().norm() < kStepMin_mm && motion.tail<3>().norm() < kStepMin_rad;
  }
  return out;
}

/// Adds the uncertainty that the sightings of one robot give the fit, except that of the pairs' weights.
class Spread6 {
 public:
  Spread6(const Fit& fit, const std::vector<Pair>& pairs) : fit_(fit), pairs_(pairs) {}

  /// Covariance from the stated noise of robot and target; balls of one view share the robot's error.
  [[nodiscard]] Mat6 of_noise(std::size_t robot, const TieArm& arm, const std::vector<Place>& places) const {
    std::vector<Eigen::Matrix<double, 6, 6>> by_view;
    Mat6 sum = Mat6::Zero();
    for_each(robot, places, [&](const Place& place, const Eigen::Matrix<double, 6, 3>& K) {
      if (by_view.size() <= place.view) by_view.resize(place.view + 1, Eigen::Matrix<double, 6, 6>::Zero());
      by_view[place.view].leftCols<3>() += K;
      by_view[place.view].rightCols<3>() -= K * skew(place.u_mm);
      sum += square(place.target_mm) * K * K.transpose();
    });
    for (const Eigen::Matrix<double, 6, 6>& M : by_view)
      sum += square(arm.noise.robot_mm) * M.leftCols<3>() * M.leftCols<3>().transpose() +
             square(arm.noise.robot_rad) * M.rightCols<3>() * M.rightCols<3>().transpose();
    return sum;
  }

  /// Covariance from the hand-eye calibration of one robot, which is the same in all its views.
  [[nodiscard]] Mat6 of_hand_eye(std::size_t robot, const TieArm& arm, const std::vector<Place>& places) const {
    const double shift_mm = has_value(arm.hand_eye.sigma_mm) ? arm.hand_eye.sigma_mm : 0.0;
    const double turn_rad = has_value(arm.hand_eye.sigma_rad) ? arm.hand_eye.sigma_rad : 0.0;
    Vec3 middle = Vec3::Zero();  // of the places, flange frame: sigma_mm is that of a point in the field of view
    for (const Place& place : places)
      middle += place.R_base_flange.transpose() * place.u_mm / static_cast<double>(places.size());
    Eigen::Matrix<double, 6, 6> M = Eigen::Matrix<double, 6, 6>::Zero();
    for_each(robot, places, [&](const Place& place, const Eigen::Matrix<double, 6, 3>& K) {
      const Vec3 lever = place.R_base_flange.transpose() * place.u_mm - middle;
      M.leftCols<3>() += K * place.R_base_flange;
      M.rightCols<3>() -= K * place.R_base_flange * skew(lever);
    });
    Mat6 sum = square(turn_rad) * M.rightCols<3>() * M.rightCols<3>().transpose();
    sum.topLeftCorner<3, 3>() += square(shift_mm) * Mat3::Identity();
    sum.bottomRightCorner<3, 3>() +=
        square(shift_mm) * M.bottomLeftCorner<3, 3>() * M.bottomLeftCorner<3, 3>().transpose();
    return sum;
  }

 private:
  /// Calls f(place, K) for every place of a robot, with K = d motion / d place.
  template <typename F>
  void for_each(std::size_t robot, const std::vector<Place>& places, F&& f) const {
    const Mat3 R = fit_.T.rotation.toRotationMatrix();
    for (const Pair& pair : pairs_) {
      const Vec3 p = fit_.T * pair.by[1].q_mm;
      const Mat3 weight = inverse3(covariance_of(pair, fit_.T));
      const Eigen::Matrix<double, 6, 3> by_pair = fit_.covariance * motion_at(p, fit_.middle_mm).transpose() * weight;
      for (const std::size_t i : pair.by[robot].places) {
        const Mat3 share = pair.by[robot].covariance * places[i].weight;
        f(places[i], robot == 0 ? Eigen::Matrix<double, 6, 3>(by_pair * share)
                                : Eigen::Matrix<double, 6, 3>(-by_pair * R * share));
      }
    }
  }

  const Fit& fit_;
  const std::vector<Pair>& pairs_;
};

Status check(const TieArm& arm, const char* which) {
  if (arm.sightings.empty()) return error(Code::config, "the %s robot has no sightings", which);
  if (arm.sightings.size() > kViewsMax)
    return error(Code::config, "%zu sightings of the %s robot, at most %zu can be solved", arm.sightings.size(), which,
                 kViewsMax);
  for (const double sigma : {arm.noise.robot_mm, arm.noise.robot_rad, arm.noise.target_mm})
    if (!std::isfinite(sigma) || sigma < 0.0)
      return error(Code::config, "stated noise must be finite and not negative, got %g", sigma);
  constexpr double kLeast_mm = 1e-6;  // smaller than the noise of any device; its square still has a value
  if (std::hypot(arm.noise.robot_mm, arm.noise.target_mm) < kLeast_mm)
    return error(Code::config, "robot and target cannot both be without position noise: together at least %g mm",
                 kLeast_mm);
  if (!arm.hand_eye.T_flange_scanner.all_finite())
    return error(Code::config, "the hand-eye calibration of the %s robot is not finite", which);
  for (const TieSighting& sighting : arm.sightings) {
    if (sighting.target >= kBallsMax) return error(Code::config, "at most %zu balls can be used", kBallsMax);
    if (!sighting.T_base_flange.all_finite() || !sighting.centre_mm.allFinite())
      return error(Code::config, "a sighting of ball %zu by the %s robot has a number that is not finite",
                   sighting.target + 1, which);
  }
  return success();
}

std::vector<Pair> pairs_of(const std::array<std::vector<Place>, 2>& places, std::vector<std::size_t>& seen_by_one) {
  std::vector<Pair> pairs;
  for (std::size_t target = 0; target < kBallsMax; ++target) {
    std::array<std::vector<std::size_t>, 2> found;
    for (std::size_t robot = 0; robot < 2; ++robot)
      for (std::size_t i = 0; i < places[robot].size(); ++i)
        if (places[robot][i].target == target) found[robot].push_back(i);
    if (found[0].empty() != found[1].empty()) seen_by_one.push_back(target);
    if (found[0].empty() || found[1].empty()) continue;
    Pair& pair = pairs.emplace_back();
    pair.target = target;
    for (std::size_t robot = 0; robot < 2; ++robot) pair.by[robot] = mean_of(places[robot], std::move(found[robot]));
  }
  return pairs;
}

/// Principal standard deviations of the targets, descending, and their rms distance from the middle.
std::array<double, 3> spread_axes_mm(const std::vector<Pair>& pairs) {
  Vec3 middle = Vec3::Zero();
  for (const Pair& pair : pairs) middle += pair.by[0].q_mm / static_cast<double>(pairs.size());
  Mat3 sum = Mat3::Zero();
  for (const Pair& pair : pairs) {
    const Vec3 off = pair.by[0].q_mm - middle;
    sum += off * off.transpose() / static_cast<double>(pairs.size());
  }
  const SymmetricParts parts = symmetric_parts(Matrix(sum));
  std::array<double, 3> axes{};
  for (int k = 0; k < 3; ++k) axes[static_cast<std::size_t>(k)] = std::sqrt(std::max(parts.values[2 - k], 0.0));
  return axes;
}

/// Condition of the whitened equations with turns scaled by `lever_mm`.
double condition_of(const std::vector<Pair>& pairs, const Fit& fit, double lever_mm) {
  Mat6 N = Mat6::Zero();
  for (const Pair& pair : pairs) {
    Eigen::Matrix<double, 3, 6> J = motion_at(fit.T * pair.by[1].q_mm, fit.middle_mm);
    J.rightCols<3>() /= lever_mm;
    N += J.transpose() * inverse3(covariance_of(pair, fit.T)) * J;
  }
  if (!N.allFinite()) return kNoValue;
  const SymmetricParts parts = symmetric_parts(Matrix(N));
  return parts.values[0] > 0.0 ? std::sqrt(parts.values[5] / parts.values[0]) : std::numeric_limits<double>::infinity();
}

/// Variance of the misfit between the robots over the stated one, at least 1. A robot's error that neighbouring poses
/// share is the same in all views of a ball: it does not show in their scatter, and more views do not reduce it. What
/// chance explains counts as 1.
double misfit_of(double chi_square, std::size_t pairs) {
  constexpr double kByChance = 2.5;
  const int freedom = 3 * static_cast<int>(pairs) - 6;
  return freedom > 0 && normal_sigmas(chi_square, freedom) > kByChance ? std::max(1.0, chi_square / freedom) : 1.0;
}

/// The same of the usual one among the pairs without the k-th: another ball that was moved does not excuse this one.
double usual_misfit_of(const std::vector<Pair>& pairs, std::size_t k, const Fit& others) {
  const double misfit = misfit_of(others.chi_square, pairs.size() - 1);
  if (misfit <= 1.0) return misfit;
  std::vector<double> each;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (i == k) continue;
    const Vec3 off = pairs[i].by[0].q_mm - others.T * pairs[i].by[1].q_mm;
    each.push_back(off.dot(Vec3(inverse3(covariance_of(pairs[i], others.T)) * off)));
  }
  std::sort(each.begin(), each.end());
  const std::size_t count = each.size();
  const double median = 0.5 * (each[(count - 1) / 2] + each[count / 2]);
  // The fit takes six degrees of freedom, those of two pairs.
  const double left = static_cast<double>(count) / (static_cast<double>(count) - 2.0);
  return std::max(1.0, left * median / chi_square_median(3));
}

/// Distance of one pair from the tie of the others, and its rarity.
void leave_out(const std::vector<Pair>& pairs, std::size_t k, double chi_square_within, int freedom_within,
               TieTarget& out) {
  if (pairs.size() <= kTargetsLeast) return;
  const Fit others = fit(pairs, k);
  if (!others.covariance.allFinite()) return;
  const Vec3 p = others.T * pairs[k].by[1].q_mm;
  const Vec3 off = pairs[k].by[0].q_mm - p;
  const Matrix J = motion_at(p, others.middle_mm);
  const Matrix own = Matrix(covariance_of(pairs[k], others.T)) + carried(J, Matrix(others.covariance));
  out.leave_one_out_mm = off.norm();
  const int freedom = freedom_within + 3 * (static_cast<int>(pairs.size()) - 1) - 6;
  const double scale =
      freedom > 0 ? std::max((chi_square_within + others.chi_square) / freedom, usual_misfit_of(pairs, k, others))
                  : 1.0;
  out.sigmas = normal_sigmas(off.dot(Vec3(Vec3(inverse(own) * off))) / scale, 3);
}

void refuse(Tie& tie, TieRefusal code, std::string text, std::string cure) {
  tie.reasons.push_back({code, std::move(text), std::move(cure)});
}

/// Reasons, a cause before its consequences: a ball that was moved also raises s0.
void judge(Tie& tie, bool converged, std::span<const std::string> names) {
  if (tie.targets.size() < kTieTargetsMin)
    refuse(tie, TieRefusal::too_few_targets,
           sentence("%zu balls are seen by both robots; at least %zu are needed, 6 to 8 advised", tie.targets.size(),
                    kTieTargetsMin),
           "fix more balls in the cell, spread over the length of the slab, and measure them with both robots");
  if (tie.targets.size() >= kTargetsLeast && !(tie.condition <= kTieConditionMax))
    refuse(
        tie, TieRefusal::targets_on_a_line,
        sentence("the balls are on a line, or nearly (condition %.3g, at most %.0f; standard deviations %.0f, %.0f, "
                 "%.0f mm): the turn about it is not determined",
                 tie.condition, kTieConditionMax, tie.spread_axes_mm[0], tie.spread_axes_mm[1], tie.spread_axes_mm[2]),
        "put balls to both sides of that line, or at other heights");
  const TieTarget* worst = nullptr;
  for (const TieTarget& target : tie.targets)
    if (has_value(target.sigmas) && (worst == nullptr || target.sigmas > worst->sigmas)) worst = &target;
  const bool moved = worst != nullptr && worst->sigmas > kTieMovedSigmas;
  if (moved) {
    const std::string ball = worst->target < names.size() ? names[worst->target] : std::to_string(worst->target + 1);
    refuse(
        tie, TieRefusal::target_moved,
        sentence("ball %s is %.3f mm from where the tie of the others puts it, as rare as %.1f sigma (at most %.1f)",
                 ball.c_str(), worst->leave_one_out_mm, worst->sigmas, kTieMovedSigmas),
        "see whether that ball moved between the two robots, or is another one in one of the tables; measure it again "
        "with both robots, or leave it out");
  }
  if (tie.s0 > kS0Max)
    refuse(
        tie, TieRefusal::noise_above_stated,
        sentence("residuals are %.3g times what the stated noise explains (at most %.0f)", tie.s0, kS0Max),
        moved
            ? "repeat the tie without that ball; if another one is named then, compare the names of the balls in both "
              "tables"
            : "check both hand-eye calibrations (slabctl calibrate verify) and that flange poses and balls belong "
              "together; if the robots are no better than that, state it");
  if (tie.determined && !converged)
    refuse(tie, TieRefusal::not_converged, "the adjustment did not converge", "measure more balls, further apart");
  tie.ok = tie.determined && tie.reasons.empty();
}

}  // namespace

std::string_view name(TieRefusal refusal) {
  return kRefusals.at(static_cast<std::size_t>(refusal));
}

Result<Tie> solve_tie(const TieArm& first, const TieArm& second, std::span<const std::string> names) {
  if (const Status status = check(first, "first"); !status) return status.error();
  if (const Status status = check(second, "second"); !status) return status.error();
  const std::array<const TieArm*, 2> arms = {&first, &second};
  const std::array<std::vector<Place>, 2> places = {places_of(first), places_of(second)};
  Tie tie;
  const std::vector<Pair> pairs = pairs_of(places, tie.seen_by_one);
  double within = 0.0;
  int freedom_within = 0;
  for (const Pair& pair : pairs) {
    TieTarget& target = tie.targets.emplace_back();
    target.target = pair.target;
    for (std::size_t robot = 0; robot < 2; ++robot) {
      for (const std::size_t i : pair.by[robot].places) target.views[robot] += places[robot][i].sightings;
      within += pair.by[robot].chi_square;
      freedom_within += 3 * (static_cast<int>(pair.by[robot].places.size()) - 1);
    }
    target.p_base = pair.by[0].q_mm;
  }
  tie.numbers.targets = static_cast<std::uint16_t>(pairs.size());
  Pose nowhere;
  nowhere.rotation.coeffs().setConstant(kNoValue);
  nowhere.translation_mm.setConstant(kNoValue);
  tie.numbers.T_base_robot = nowhere;
  if (pairs.size() < kTargetsLeast) {
    judge(tie, true, names);
    return tie;
  }

  tie.spread_axes_mm = spread_axes_mm(pairs);
  const double lever_mm = std::hypot(tie.spread_axes_mm[0], tie.spread_axes_mm[1], tie.spread_axes_mm[2]);
  const Fit all = fit(pairs);
  tie.condition = lever_mm > 0.0 ? condition_of(pairs, all, lever_mm) : std::numeric_limits<double>::infinity();
  tie.determined = tie.condition < kTieConditionDegenerate && all.covariance.allFinite();
  tie.degrees_of_freedom = freedom_within + 3 * static_cast<int>(pairs.size()) - 6;
  if (!tie.determined) {
    judge(tie, true, names);
    return tie;
  }
  tie.s0 = std::sqrt((within + all.chi_square) / tie.degrees_of_freedom);

  std::vector<double> residuals;
  std::vector<double> left_out;
  double sum_mm2 = 0.0;
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    TieTarget& target = tie.targets[k];
    const Vec3 p = all.T * pairs[k].by[1].q_mm;
    target.residual_mm = (pairs[k].by[0].q_mm - p).norm();
    target.p_base = 0.5 * (pairs[k].by[0].q_mm + p);
    leave_out(pairs, k, within, freedom_within, target);
    residuals.push_back(target.residual_mm);
    left_out.push_back(target.leave_one_out_mm);
    sum_mm2 += square(target.residual_mm);
  }
  tie.residual_mm = spread_of(residuals);
  tie.leave_one_out_mm = spread_of(left_out);

  tie.numbers.T_base_robot = all.T;
  tie.numbers.centre_mm = all.middle_mm;
  tie.numbers.rms_mm = std::sqrt(sum_mm2 / static_cast<double>(pairs.size()));
  const Spread6 uncertainty(all, pairs);
  const double scale = std::max(square(tie.s0), misfit_of(all.chi_square, pairs.size()));
  Mat6 covariance = Mat6::Zero();
  for (std::size_t robot = 0; robot < 2; ++robot)
    covariance += scale * uncertainty.of_noise(robot, *arms[robot], places[robot]) +
                  uncertainty.of_hand_eye(robot, *arms[robot], places[robot]);
  tie.numbers.covariance = 0.5 * (covariance + covariance.transpose());
  judge(tie, all.converged, names);
  return tie;
}

double tie_sigma_mm(const TieNumbers& tie, const Vec3& p_base) {
  const Eigen::Matrix<double, 3, 6> J = motion_at(p_base, tie.centre_mm);
  return std::sqrt((J * tie.covariance * J.transpose()).trace());
}

Result<std::vector<TieSighting>> tie_sightings(std::span<const View> views, bool labelled,
                                               std::span<const std::string> names, std::vector<std::string>& known) {
  if (labelled && !names.empty())
    return error(Code::config, "the target table numbers its balls by labels; give no names for it");
  if (!names.empty() && names.size() != views.size())
    return error(Code::config, "%zu names for %zu lines of the target table", names.size(), views.size());
  std::vector<TieSighting> sightings;
  for (std::size_t i = 0; i < views.size(); ++i) {
    for (const BallObservation& seen : views[i].balls) {
      std::string ball = names.empty() ? std::to_string((labelled ? seen.ball : i) + 1) : names[i];
      auto place = std::find(known.begin(), known.end(), ball);
      if (place == known.end()) {
        if (known.size() == kBallsMax)
          return error(Code::config,
                       "more than %zu balls; if a ball was seen several times, give names of equal length", kBallsMax);
        place = known.insert(known.end(), std::move(ball));
      }
      sightings.push_back({static_cast<std::size_t>(place - known.begin()), views[i].T_base_flange, seen.centre_mm});
    }
  }
  return sightings;
}

std::vector<std::string> parse_target_names(std::string_view text) {
  constexpr std::string_view kSpace = " \t\r";
  std::vector<std::string> names;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    std::string_view line = text.substr(0, std::min(text.substr(0, end).find('#'), end));
    text.remove_prefix(std::min(end + 1, text.size()));
    const std::size_t first = line.find_first_not_of(kSpace);
    if (first == std::string_view::npos) continue;
    line = line.substr(first, line.find_last_not_of(kSpace) - first + 1);
    names.emplace_back(line);
  }
  return names;
}

}  // namespace slabd::calib
