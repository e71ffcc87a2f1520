// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "calib/observations.h"

/// The observation equations of hand-eye calibration and their least-squares adjustment. Internal to the room.
///
/// Everything is compared in the flange frame, where the robot's error is isotropic. With u = X c the place of a ball
/// (or of an artefact's origin) as seen, the residual is
///
///     r_t = X c - A^-1 p                          (mm)
///     r_R = log(R_X R_B R_Z' R_A)                 (rad; pose)
///
/// and if A errs by a shift (robot_mm) and a turn about the flange (robot_rad), and the sighting by C_c,
///
///     cov(r_t) = robot_mm^2 I + robot_rad^2 [u]x[u]x' + R_X C_c R_X'
///     cov(r_t, r_R) = -robot_rad^2 [u]x,   cov(r_R) = robot_rad^2 I + R C_B R',  R = R_X R_B.
///
/// Several balls of one view share the robot's error. A view is whitened as a whole, L^-1 r with L L' = cov, rotation
/// first, so that a robust loss acts on views and the parts of position and rotation can be told apart.
namespace slabd::calib {

/// What is solved for.
struct State {
  Pose X;
  std::vector<Pose> targets;  ///< balls: translation alone
};

/// Stated noise and what its parts are multiplied by.
struct Weighing {
  StatedNoise noise;
  double position = 1.0;  ///< robot and target
  double robot_rotation = 1.0;
  double target_rotation = 1.0;
  /// The robot's turn acts over the lever [u]x as above; false: on rotations alone.
  bool lever = true;
};

/// Parameters, in this order: X shift (flange axes, mm), X turn (scanner axes, rad), then for each target its shift
/// (base axes, mm) and, pose, its turn (target axes, rad).
class Equations {
 public:
  Equations(ArtefactKind kind, std::span<const View> views);

  [[nodiscard]] ArtefactKind kind() const { return kind_; }
  [[nodiscard]] std::size_t size() const { return views_.size(); }
  [[nodiscard]] const View& view(std::size_t i) const { return views_[i]; }
  [[nodiscard]] std::size_t targets() const { return targets_; }
  [[nodiscard]] int parameters() const;
  [[nodiscard]] int target_parameters() const { return kind_ == ArtefactKind::ball ? 3 : 6; }
  [[nodiscard]] int rows(std::size_t i) const;
  /// Rows of a view that are rotations; they come first.
  [[nodiscard]] int rotation_rows() const { return kind_ == ArtefactKind::ball ? 0 : 3; }

  /// Residual of a view and, if asked for, its derivative (rows x parameters).
  void residual(std::size_t i, const State& state, Eigen::VectorXd& r, Eigen::MatrixXd* J) const;
  /// Covariance of a residual at a state, and L^-1 of it.
  [[nodiscard]] Eigen::MatrixXd covariance(std::size_t i, const State& state, const Weighing& weighing) const;
  [[nodiscard]] Eigen::MatrixXd whitener(std::size_t i, const State& state, const Weighing& weighing) const;
  [[nodiscard]] std::vector<Eigen::MatrixXd> whiteners(const State& state, const Weighing& weighing) const;

 private:
  ArtefactKind kind_;
  std::span<const View> views_;
  std::size_t targets_ = 1;
};

/// Several starting points without any prior knowledge, best first: closed forms on all views and on small subsets
/// (so that views that do not belong cannot spoil all of them), and for few views a set of rotations. Ball: linear in
/// (vec R, t, p); pose: R_A R_X R_B = R_Z by Kronecker products, then t. Same views, same starts. At least one.
inline constexpr int kStartSubsets = 100;
[[nodiscard]] std::vector<State> starting_points(const Equations& equations, const Weighing& weighing,
                                                 int subsets = kStartSubsets);

/// How badly a state explains the views: robust size of the whitened residuals, about 1 when noise is all there is.
[[nodiscard]] double robust_size(const Equations& equations, const Weighing& weighing, const State& state);

/// Minimises the sum over the chosen views of rho(|L^-1 r|^2) from `state`; rho is the square itself or, robust,
/// Cauchy's with scale 1.5 sqrt(rows). `whiteners` as of Equations.
struct Adjusted {
  State state;
  double cost = 0.0;  ///< half the sum
  bool converged = false;
};
[[nodiscard]] Adjusted adjust(const Equations& equations, std::span<const std::size_t> chosen,
                              std::span<const Eigen::MatrixXd> whiteners, const State& state, bool robust);

/// The same with whiteners that follow the state until it stands still.
[[nodiscard]] Adjusted adjust_and_weigh(const Equations& equations, std::span<const std::size_t> chosen,
                                        const Weighing& weighing, const State& state, bool robust);

/// Whitened residuals and derivatives of all views at a state.
struct Linearised {
  std::vector<Eigen::VectorXd> w;
  std::vector<Eigen::MatrixXd> J;
};
[[nodiscard]] Linearised linearise(const Equations& equations, std::span<const Eigen::MatrixXd> whiteners,
                                   const State& state);

}  // namespace slabd::calib
