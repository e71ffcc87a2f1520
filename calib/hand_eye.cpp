// SPDX-License-Identifier: Apache-2.0
//
// Hand-eye calibration in five steps:
//   1. Starting points in closed form.
//   2. A robust adjustment from each; the best one defines which views are normal.
//   3. Views rarer than one in sixteen thousand are removed. After every plain adjustment of the others they are tested
//      again and return if they fit.
//   4. If the noise ratio of positions and rotations clearly differs from the stated one, they are weighted by their
//      actual noise and all steps are repeated.
//   5. Figures.
//
// A view is judged by the standard deviation of its own residual, not only by the noise. In a small set a view pulls
// the solution towards itself, and half of its error does not appear in its residual.
#include "calib/hand_eye.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "calib/adjustment.h"
#include "calib/hand_eye_parts.h"
#include "calib/mathematics.h"

namespace slabd::calib {
namespace {

constexpr double kRejectSigmas = 4.0;
/// Smallest share of its variance that a residual must retain to be informative about the view.
constexpr double kRedundancyMin = 1e-6;

using Chosen = std::vector<std::size_t>;

double median(std::vector<double> values) {
  if (values.empty()) return kNoValue;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Checks that the views and the stated noise can be used in a computation.
Status check(ArtefactKind kind, std::span<const View> views, const StatedNoise& noise) {
  if (views.empty()) return error(Code::config, "no views");
  if (views.size() > kViewsMax)
    return error(Code::config, "%zu views, at most %zu can be solved", views.size(), kViewsMax);
  const bool balls = kind == ArtefactKind::ball;
  for (const double sigma : {noise.robot_mm, noise.robot_rad, noise.target_mm, noise.target_rad})
    if (!std::isfinite(sigma) || sigma < 0.0)
      return error(Code::config, "stated noise must be finite and not negative, got %g", sigma);
  // Smaller than the noise of any device; the squares of much smaller numbers underflow to zero.
  constexpr double kLeast_mm = 1e-6;
  constexpr double kLeast_rad = 1e-9;
  if (std::hypot(noise.robot_mm, noise.target_mm) < kLeast_mm)
    return error(Code::config,
                 "robot and target cannot both be without position noise: %g and %g mm, together at least %g",
                 noise.robot_mm, noise.target_mm, kLeast_mm);
  if (!balls && std::hypot(noise.robot_rad, noise.target_rad) < kLeast_rad)
    return error(Code::config,
                 "robot and target cannot both be without rotation noise: %g and %g rad, together at least %g",
                 noise.robot_rad, noise.target_rad, kLeast_rad);
  std::vector<bool> seen;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const View& view = views[i];
    if (!view.T_base_flange.all_finite() || !view.T_scanner_target.all_finite())
      return error(Code::config, "view %zu has a number that is not finite", i + 1);
    if (view.target_covariance && !view.target_covariance->allFinite())
      return error(Code::config, "view %zu has a covariance that is not finite", i + 1);
    if (!balls) continue;
    if (view.balls.empty()) return error(Code::config, "view %zu has no ball", i + 1);
    for (const BallObservation& sighting : view.balls) {
      if (sighting.ball >= kBallsMax)
        return error(Code::config, "view %zu has ball %zu; at most %zu balls", i + 1, sighting.ball + 1, kBallsMax);
      if (!sighting.centre_mm.allFinite() || (sighting.cov_mm2 && !sighting.cov_mm2->allFinite()))
        return error(Code::config, "view %zu has a ball centre that is not finite", i + 1);
      if (seen.size() <= sighting.ball) seen.resize(sighting.ball + 1, false);
      seen[sighting.ball] = true;
      const auto same = [&](const BallObservation& other) { return other.ball == sighting.ball; };
      if (std::count_if(view.balls.begin(), view.balls.end(), same) > 1)
        return error(Code::config, "view %zu has ball %zu twice; a view has one centre for each ball", i + 1,
                     sighting.ball + 1);
    }
  }
  for (std::size_t ball = 0; ball < seen.size(); ++ball)
    if (!seen[ball]) return error(Code::config, "ball %zu is never seen; number the balls without gaps", ball + 1);
  return success();
}

/// Distance of each view from the solution of the chosen ones.
struct Verdicts {
  std::vector<double> squares;  ///< of the residual over its own covariance
  std::vector<int> freedom;
  double scale = 1.0;  ///< robust size of the residuals, at least 1
};

Verdicts ask(const Equations& equations, const Chosen& chosen, const Linearised& linear) {
  const Eigen::MatrixXd covariance = parameter_covariance(equations, chosen, linear);
  std::vector<bool> inside(equations.size(), false);
  for (const std::size_t i : chosen) inside[i] = true;
  Verdicts verdicts;
  std::vector<double> normalised;
  for (std::size_t i = 0; i < equations.size(); ++i) {
    const Eigen::MatrixXd& J = linear.J[i];
    const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(J.rows(), J.rows());
    const Eigen::MatrixXd own = identity + (inside[i] ? -1.0 : 1.0) * carried(J, covariance);
    const SymmetricParts parts = symmetric_parts(own);
    double square = 0.0;
    int freedom = 0;
    for (int k = 0; k < own.rows(); ++k) {
      if (parts.values[k] < kRedundancyMin) continue;
      const double along = parts.vectors.col(k).dot(linear.w[i]);
      square += along * along / parts.values[k];
      ++freedom;
    }
    verdicts.squares.push_back(square);
    verdicts.freedom.push_back(freedom);
    if (freedom > 0) normalised.push_back(square / chi_square_median(freedom));
  }
  if (!normalised.empty()) verdicts.scale = std::max(1.0, std::sqrt(median(normalised)));
  return verdicts;
}

Chosen believable(const Verdicts& verdicts) {
  Chosen chosen;
  const double scale2 = verdicts.scale * verdicts.scale;
  for (std::size_t i = 0; i < verdicts.squares.size(); ++i)
    if (verdicts.freedom[i] == 0 || normal_sigmas(verdicts.squares[i] / scale2, verdicts.freedom[i]) <= kRejectSigmas)
      chosen.push_back(i);
  return chosen;
}

struct Selected {
  Chosen kept;
  Adjusted adjusted;
  Linearised linear;
  Verdicts verdicts;
};

/// Plain adjustment of the consistent views. `first` contains the views that the robust adjustment found normal.
Selected select(const Equations& equations, const Weighing& weighing, const State& state, Chosen first) {
  constexpr int kRoundsMax = 20;
  Selected selected{std::move(first), {state, 0.0, false}, {}, {}};
  std::vector<Chosen> tried;
  for (int round = 0;; ++round) {
    selected.adjusted = adjust_and_weigh(equations, selected.kept, weighing, selected.adjusted.state, false);
    selected.linear =
        linearise(equations, equations.whiteners(selected.adjusted.state, weighing), selected.adjusted.state);
    selected.verdicts = ask(equations, selected.kept, selected.linear);
    tried.push_back(selected.kept);
    Chosen next = believable(selected.verdicts);
    // If most views would be removed, the right ones are unknown. If a set repeats, the iteration would not end.
    const bool hopeless = 2 * next.size() < equations.size();
    if (hopeless || round == kRoundsMax || std::find(tried.begin(), tried.end(), next) != tried.end()) break;
    selected.kept = std::move(next);
  }
  return selected;
}

/// The best robust adjustment, and the views that are normal in it.
struct RobustFit {
  State state;
  Chosen normal;
};

RobustFit fit_robustly(const Equations& equations, const Weighing& weighing) {
  Chosen all(equations.size());
  std::iota(all.begin(), all.end(), std::size_t{0});
  RobustFit best;
  double lowest = std::numeric_limits<double>::infinity();
  // The best few starts lead to the same solution; the others are for sets in which nothing fits yet.
  constexpr std::size_t kEnoughStarts = 4;
  constexpr double kFits = 3.0;
  std::size_t tried = 0;
  for (const State& start : starting_points(equations, weighing)) {
    // Far from the solution the robust loss is flat, so later starts are first improved by plain least squares.
    const bool late = ++tried > kEnoughStarts;
    if (late && robust_size(equations, weighing, best.state) < kFits) break;
    const State near = late ? adjust_and_weigh(equations, all, weighing, start, false).state : start;
    const Adjusted adjusted = adjust_and_weigh(equations, all, weighing, near, true);
    if (!(adjusted.cost < lowest)) continue;
    lowest = adjusted.cost;
    best.state = adjusted.state;
  }
  Verdicts verdicts;
  std::vector<double> normalised;
  const Linearised linear = linearise(equations, equations.whiteners(best.state, weighing), best.state);
  for (std::size_t i = 0; i < equations.size(); ++i) {
    verdicts.squares.push_back(linear.w[i].squaredNorm());
    verdicts.freedom.push_back(equations.rows(i));
    normalised.push_back(verdicts.squares[i] / chi_square_median(verdicts.freedom[i]));
  }
  verdicts.scale = std::max(1.0, std::sqrt(median(normalised)));
  best.normal = believable(verdicts);
  if (2 * best.normal.size() < equations.size()) best.normal = all;
  return best;
}

/// Size of the residuals relative to their weights, separately for positions and rotations. NaN without redundant
/// equations.
struct Sizes {
  double all = kNoValue;
  double position = kNoValue;
  double rotation = kNoValue;
};

Sizes sizes_of(const Equations& equations, const Chosen& kept, const Linearised& linear) {
  const Eigen::MatrixXd covariance = parameter_covariance(equations, kept, linear);
  const int turning = equations.rotation_rows();
  double rotation = 0.0;
  double position = 0.0;
  double rotation_freedom = 0.0;
  double position_freedom = 0.0;
  for (const std::size_t i : kept) {
    const Eigen::MatrixXd& J = linear.J[i];
    const auto placing = J.rows() - turning;
    const Eigen::VectorXd left = Eigen::VectorXd::Ones(J.rows()) - carried(J, covariance).diagonal();
    rotation += linear.w[i].head(turning).squaredNorm();
    position += linear.w[i].tail(placing).squaredNorm();
    rotation_freedom += left.head(turning).sum();
    position_freedom += left.tail(placing).sum();
  }
  constexpr double kSome = 0.5;
  const auto size = [](double squares, double freedom) {
    return freedom > kSome ? std::sqrt(squares / freedom) : kNoValue;
  };
  return {size(position + rotation, position_freedom + rotation_freedom), size(position, position_freedom),
          size(rotation, rotation_freedom)};
}

/// Weights positions and rotations by their estimated noise if that certainly differs from the stated ratio. Otherwise
/// the stated noise is kept, because it is based on more than these few views. Returns true if the weights changed.
/// Views of one place are partly redundant, and likelihoods that treat them as independent exceed any threshold by
/// chance. Therefore the threshold includes Rao and Scott's design effect (1984).
bool reweigh(const Equations& equations, const Selected& selected, Weighing& weighing) {
  constexpr double kSure = 11.8;
  const Components found = estimate_components(equations, selected.kept, selected.adjusted.state, weighing);
  const SharedErrors shared = shared_errors(equations, selected.kept, selected.linear);
  if (!(found.gain > kSure * shared.design_effect)) return false;
  weighing = found.weighing;
  return true;
}

ViewFit fit_of(const Equations& equations, std::size_t i, const State& state) {
  Eigen::VectorXd r;
  equations.residual(i, state, r, nullptr);
  const int turning = equations.rotation_rows();
  ViewFit fit;
  const double points = static_cast<double>(r.size() - turning) / 3.0;
  fit.residual_mm = r.tail(r.size() - turning).norm() / std::sqrt(points);
  if (turning > 0) fit.residual_deg = deg_from_rad(r.head(turning).norm());
  return fit;
}

/// One solution: the weights of its views, the kept ones, and the residual of each view left out.
struct Solution {
  Weighing weighing;
  Selected selected;
  Sizes stated;  ///< before reweighing
  bool reweighted = false;
  std::vector<ViewFit> leave_one_out;  ///< residual_mm, residual_deg of kept views; NaN if undetermined
};

Solution solution_of(const Equations& equations, const StatedNoise& noise, bool lever, const State& start,
                     const Chosen& normal) {
  constexpr int kReweighings = 3;
  Solution solution;
  Weighing& weighing = solution.weighing;
  weighing.noise = noise;
  weighing.lever = lever;
  solution.selected = select(equations, weighing, start, normal);
  solution.stated = sizes_of(equations, solution.selected.kept, solution.selected.linear);
  for (int k = 0; k < kReweighings && reweigh(equations, solution.selected, weighing); ++k) {
    solution.reweighted = true;
    solution.selected = select(equations, weighing, solution.selected.adjusted.state, solution.selected.kept);
  }
  return solution;
}

void leave_one_out(const Equations& equations, Solution& solution) {
  solution.leave_one_out.assign(equations.size(), {});
  const Selected& selected = solution.selected;
  if (selected.kept.size() < 4) return;
  const State& state = selected.adjusted.state;
  const std::vector<Eigen::MatrixXd> whiteners = equations.whiteners(state, solution.weighing);
  std::vector<std::size_t> seen(equations.targets(), 0);
  const auto count = [&](std::size_t i, auto&& f) {
    if (equations.kind() == ArtefactKind::pose) return;
    for (const BallObservation& sighting : equations.view(i).balls) f(seen[sighting.ball]);
  };
  for (const std::size_t i : selected.kept) count(i, [](std::size_t& n) { ++n; });
  for (const std::size_t out : selected.kept) {
    bool alone = false;
    count(out, [&](const std::size_t& n) { alone = alone || n < 2; });
    if (alone) continue;  // without this view the place of its ball is unknown
    Chosen others;
    for (const std::size_t i : selected.kept)
      if (i != out && !same_place(equations.view(i).T_base_flange, equations.view(out).T_base_flange))
        others.push_back(i);
    if (others.size() < 3) continue;
    const Adjusted without = adjust(equations, others, whiteners, state, false);
    solution.leave_one_out[out] = fit_of(equations, out, without.state);
  }
}

/// rms leave-one-out error of positions over the views that both solutions keep; NaN if there are none.
double missed_mm(const Solution& solution, const Solution& other) {
  double squares = 0.0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < solution.leave_one_out.size(); ++i) {
    const double miss = solution.leave_one_out[i].residual_mm;
    if (!std::isfinite(miss) || !std::isfinite(other.leave_one_out[i].residual_mm)) continue;
    squares += miss * miss;
    ++count;
  }
  return count > 0 ? std::sqrt(squares / static_cast<double>(count)) : kNoValue;
}

/// Chooses the weights with or without the lever of the robot's rotation error. A robot's repeatability is independent
/// in every view, and a turn of its flange moves the target too. Then the weights with the lever are the best. Errors
/// of its geometry are smooth over the workspace; then weights with the lever increase the leave-one-out error by up to
/// a tenth. The leave-one-out error itself decides. A random error appears smooth by more than kLess in fewer than one
/// set of twenty.
Solution with_or_without_lever(const Equations& equations, Solution with) {
  constexpr double kLess = 1.025;
  if (equations.kind() == ArtefactKind::ball) return with;
  Solution without =
      solution_of(equations, with.weighing.noise, false, with.selected.adjusted.state, with.selected.kept);
  leave_one_out(equations, without);
  const bool better = missed_mm(with, without) > kLess * missed_mm(without, with);
  return better ? without : with;
}

/// View with its sightings scaled by `scale`.
View scaled(View view, double scale) {
  view.T_scanner_target.translation_mm *= scale;
  for (BallObservation& seen : view.balls) seen.centre_mm *= scale;
  return view;
}

struct Scale {
  double value = kNoValue;
  double sigma = kNoValue;
};

/// Estimates the paper's lambda (eq. 7), fitted together with X and the targets from the kept views: A X (lambda
/// c) = p. Gauss-Newton with one additional column, R_X c, from lambda = 1. Each step adjusts the other parameters
/// again with the scaled sightings. Weighted as stated, because variances estimated without lambda include the effect
/// of a wrong scale.
Scale estimate_scale(const Equations& equations, const Selected& selected, const Weighing& found) {
  constexpr int kSteps = 8;
  constexpr double kDone = 1e-8;
  constexpr double kDetermined = 1e-9;  // smallest part of the column's length left by the other parameters
  constexpr double kScaleMin = 0.5;
  constexpr double kScaleMax = 2.0;
  Weighing weighing;
  weighing.noise = found.noise;
  weighing.lever = found.lever;
  double scale = 1.0;
  State state = selected.adjusted.state;
  for (int step = 0; step < kSteps; ++step) {
    std::vector<View> views;
    for (const std::size_t i : selected.kept) views.push_back(scaled(equations.view(i), scale));
    // Equations number the targets by the given views, so a ball seen only in rejected views is not changed.
    const Equations at(equations.kind(), views);
    if (at.targets() != equations.targets()) return {};
    Chosen all(views.size());
    std::iota(all.begin(), all.end(), std::size_t{0});
    const std::vector<Eigen::MatrixXd> whiteners = at.whiteners(state, weighing);
    state = adjust(at, all, whiteners, state, false).state;
    const Linearised linear = linearise(at, whiteners, state);
    const Eigen::MatrixXd covariance = parameter_covariance(at, all, linear);
    const Mat3 R_X = state.X.rotation.toRotationMatrix();
    Eigen::VectorXd other = Eigen::VectorXd::Zero(at.parameters());
    double length2 = 0.0;
    double along = 0.0;
    double squares = 0.0;
    double rows = 0.0;
    for (const std::size_t i : all) {
      Eigen::VectorXd moved = Eigen::VectorXd::Zero(at.rows(i));
      const int turning = at.rotation_rows();
      if (at.kind() == ArtefactKind::pose)
        moved.tail<3>() = Eigen::Vector3d(R_X * views[i].T_scanner_target.translation_mm);
      for (std::size_t k = 0; k < views[i].balls.size() && at.kind() == ArtefactKind::ball; ++k)
        moved.segment<3>(turning + 3 * static_cast<int>(k)) = Eigen::Vector3d(R_X * views[i].balls[k].centre_mm);
      const Eigen::VectorXd column = product(whiteners[i], moved) / scale;
      other += transposed_product(linear.J[i], column);
      length2 += column.squaredNorm();
      along += column.dot(linear.w[i]);
      squares += linear.w[i].squaredNorm();
      rows += static_cast<double>(column.size());
    }
    // The other parameters are at their optimum, so the residuals are orthogonal to their columns.
    const double own2 = length2 - other.dot(product(covariance, other).col(0));
    const double freedom = rows - at.parameters() - 1.0;
    if (!(own2 > kDetermined * length2) || freedom < 1.0) return {};
    const double shift = -along / own2;
    scale += shift;
    if (!(scale > kScaleMin) || !(scale < kScaleMax)) return {};
    if (std::abs(shift) > kDone) continue;
    const double s0 = std::sqrt(std::max(0.0, squares - along * along / own2) / freedom);
    return {scale, std::max(1.0, s0) / std::sqrt(own2)};
  }
  return {};
}

Spread spread_over(const HandEye& result, double ViewFit::*figure) {
  std::vector<double> values;
  for (const ViewFit& view : result.views)
    if (view.kept) values.push_back(view.*figure);
  return spread_of(values);
}

/// Covariance of X for errors as stated, or larger if they were estimated larger. It is that of the adjustment N^-1 J'
/// w for such errors, independent of its weights.
Mat6 covariance_of_pose(const Equations& equations, const Selected& selected, const Weighing& weighing,
                        const SharedErrors& shared, bool as_stated, double s0) {
  Weighing errors = weighing;
  errors.lever = true;
  errors.position = std::max(1.0, weighing.position);
  errors.robot_rotation = std::max(1.0, weighing.robot_rotation);
  errors.target_rotation = std::max(1.0, weighing.target_rotation);
  const Eigen::MatrixXd covariance = covariance_of_estimate(equations, selected.kept, selected.linear,
                                                            selected.adjusted.state, weighing, errors, shared);
  // Variances estimated from views treated as independent are too small if the views are not.
  const double size = shared.repeats ? shared.size : as_stated ? s0 : 1.0;
  const double factor = size > 1.0 ? size * size : 1.0;
  return factor * covariance.topLeftCorner<6, 6>();
}

/// q and -q are the same rotation; the result has w >= 0.
Pose with_positive_w(Pose pose) {
  if (pose.rotation.w() < 0.0) pose.rotation.coeffs() *= -1.0;
  return pose;
}

void forget_pose(HandEye& result) {
  const Vec3 nowhere = Vec3::Constant(kNoValue);
  const Quat unturned(kNoValue, kNoValue, kNoValue, kNoValue);
  result.T_flange_scanner = {unturned, nowhere};
  for (Pose& target : result.targets) target = {unturned, nowhere};
}

/// Kept views that are informative about the scanner's pose. A ball seen only from one place gives no information: its
/// view adds as many unknowns as equations.
Chosen telling_views(ArtefactKind kind, std::span<const View> views, const Chosen& kept) {
  const auto share_a_ball = [&](const View& a, const View& b) {
    return std::any_of(a.balls.begin(), a.balls.end(), [&](const BallObservation& seen) {
      return std::any_of(b.balls.begin(), b.balls.end(),
                         [&](const BallObservation& other) { return other.ball == seen.ball; });
    });
  };
  Chosen telling;
  for (const std::size_t i : kept) {
    const bool tells =
        kind == ArtefactKind::pose || std::any_of(kept.begin(), kept.end(), [&](std::size_t j) {
          return !same_place(views[i].T_base_flange, views[j].T_base_flange) && share_a_ball(views[i], views[j]);
        });
    if (tells) telling.push_back(i);
  }
  return telling;
}

JudgementInputs circumstances_of(const Equations& equations, const StatedNoise& noise) {
  JudgementInputs c;
  c.kind = equations.kind();
  c.noise = noise;
  std::vector<double> flange;
  std::vector<double> target;
  for (std::size_t i = 0; i < equations.size(); ++i) {
    const View& view = equations.view(i);
    flange.push_back(view.T_base_flange.translation_mm.norm());
    if (c.kind == ArtefactKind::pose) target.push_back(view.T_scanner_target.translation_mm.norm());
    for (const BallObservation& seen : view.balls)
      if (c.kind == ArtefactKind::ball) target.push_back(seen.centre_mm.norm());
  }
  c.median_flange_mm = median(flange);
  c.median_target_mm = median(target);
  return c;
}

}  // namespace

Result<HandEye> solve(ArtefactKind kind, std::span<const View> views, const StatedNoise& noise,
                      const SolveSettings& settings) {
  if (Status status = check(kind, views, noise); !status) return status.error();
  const Equations equations(kind, views);
  const RobustFit robust = fit_robustly(equations, {noise});
  Solution solution = solution_of(equations, noise, true, robust.state, robust.normal);
  const auto weakness_here = [&] {
    const State& state = solution.selected.adjusted.state;
    return degeneracy_of(equations, solution.selected.kept,
                         linearise(equations, equations.whiteners(state, {noise}), state));
  };
  Degeneracy degeneracy = weakness_here();
  if (degeneracy.condition <= kConditionDegenerate) {
    leave_one_out(equations, solution);
    solution = with_or_without_lever(equations, std::move(solution));
    degeneracy = weakness_here();
  }
  const Weighing& weighing = solution.weighing;
  const Selected& selected = solution.selected;
  const Sizes& stated = solution.stated;

  HandEye result;
  result.reweighted = solution.reweighted;
  result.robot_lever = weighing.lever;
  const State& state = selected.adjusted.state;
  result.T_flange_scanner = with_positive_w(state.X);
  for (const Pose& target : state.targets) result.targets.push_back(with_positive_w(target));

  std::vector<bool> kept(views.size(), false);
  for (const std::size_t i : selected.kept) kept[i] = true;
  for (std::size_t i = 0; i < views.size(); ++i) {
    ViewFit fit = fit_of(equations, i, state);
    fit.number = views[i].number != 0 ? views[i].number : i + 1;
    fit.kept = kept[i];
    fit.sigmas = normal_sigmas(selected.verdicts.squares[i], selected.verdicts.freedom[i]);
    if (!fit.kept) result.rejected.push_back(i);
    result.views.push_back(fit);
  }
  result.worst_view = selected.kept.front();
  for (const std::size_t i : selected.kept)
    if (result.views[i].sigmas > result.views[result.worst_view].sigmas) result.worst_view = i;

  result.s0 = stated.all;
  result.s0_position = result.reweighted ? weighing.position : stated.position;
  result.s0_rotation = result.reweighted ? std::hypot(weighing.robot_rotation * noise.robot_rad,
                                                      weighing.target_rotation * noise.target_rad) /
                                               std::hypot(noise.robot_rad, noise.target_rad)
                                         : stated.rotation;
  const Chosen telling_indices = telling_views(kind, views, selected.kept);
  std::vector<View> telling;
  for (const std::size_t i : telling_indices) telling.push_back(views[i]);
  const std::span<const View> spread_out = telling.empty() ? views : std::span<const View>(telling);
  result.rotation_spread_axes_deg = rotation_spread_axes_deg(spread_out);
  result.rotation_spread_deg = result.rotation_spread_axes_deg[2];
  if (kind == ArtefactKind::ball) result.ball_spread_axes_mm = ball_spread_axes_mm(spread_out);

  JudgementInputs circumstances = circumstances_of(equations, noise);
  circumstances.views = views;
  circumstances.declared = settings.declared;
  circumstances.scale_off_max = settings.scale_off_max;
  circumstances.same_target = same_target(kind, views, noise);
  circumstances.converged = selected.adjusted.converged;
  circumstances.places = places_of(equations, telling_indices).size();
  result.condition = degeneracy.condition;
  result.smallest_singular_value = degeneracy.smallest;
  result.determined = degeneracy.condition <= kConditionDegenerate;
  circumstances.weakest = degeneracy.text;
  result.point_sigma_limit_mm = has_value(settings.point_sigma_mm_max)
                                    ? settings.point_sigma_mm_max
                                    : kPointSigmaPerNoise * std::hypot(noise.robot_mm, noise.target_mm);
  if (result.determined) {
    for (std::size_t i = 0; i < solution.leave_one_out.size(); ++i) {
      result.views[i].leave_one_out_mm = solution.leave_one_out[i].residual_mm;
      result.views[i].leave_one_out_deg = solution.leave_one_out[i].residual_deg;
    }
    const SharedErrors shared = shared_errors(equations, selected.kept, selected.linear);
    if (shared.repeats) result.repeat_share = shared.position_share;
    if (shared.repeats && !result.reweighted) result.s0 = shared.size;
    result.covariance = covariance_of_pose(equations, selected, weighing, shared, !result.reweighted, result.s0);
    result.predicted_point_sigma_mm = point_sigma_mm(result.covariance, result.T_flange_scanner, settings.fov);
    const Scale scale = estimate_scale(equations, selected, weighing);
    result.scale = scale.value;
    result.scale_sigma = scale.sigma;
  } else {
    forget_pose(result);
  }
  result.residual_mm = spread_over(result, &ViewFit::residual_mm);
  result.residual_deg = spread_over(result, &ViewFit::residual_deg);
  result.leave_one_out_mm = spread_over(result, &ViewFit::leave_one_out_mm);
  result.leave_one_out_deg = spread_over(result, &ViewFit::leave_one_out_deg);

  if (settings.convention_test && needs_convention_test(result))
    result.conventions = test_conventions(kind, views, noise, settings.declared);
  judge(circumstances, result);
  return result;
}

}  // namespace slabd::calib
