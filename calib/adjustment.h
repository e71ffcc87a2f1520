// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "calib/observations.h"

/// Observation equations of hand-eye calibration and their least-squares adjustment. Internal to the room.
///
/// Residuals are computed in the flange frame, where the robot's error is isotropic. With u = X c the measured place of
/// a ball (or of an artefact's origin), the residual is
///
///     r_t = X c - A^-1 p                          (mm)
///     r_R = log(R_X R_B R_Z' R_A)                 (rad; pose)
///
/// The error of A is a shift (robot_mm) and a turn about the flange (robot_rad), that of the sighting has covariance
/// C_c. Then
///
///     cov(r_t) = robot_mm^2 I + robot_rad^2 [u]x[u]x' + R_X C_c R_X'
///     cov(r_t, r_R) = -robot_rad^2 [u]x,   cov(r_R) = robot_rad^2 I + R C_B R',  R = R_X R_B.
///
/// The balls of one view share the robot's error. A view is whitened as a whole, L^-1 r with L L' = cov, rotation
/// first. A robust loss therefore acts on whole views, and the parts of position and rotation stay separate.
namespace slabd::calib {

/// Unknowns of the adjustment.
struct State {
  Pose X;
  std::vector<Pose> targets;  ///< balls: translation only
};

/// Stated noise, and factors for its parts.
struct Weighing {
  StatedNoise noise;
  double position = 1.0;  ///< factor of robot and target
  double robot_rotation = 1.0;
  double target_rotation = 1.0;
  /// True if the robot's turn acts over the lever [u]x as above; false if it acts on rotations only.
  bool lever = true;
};

/// Observation equations of a set of views. The parameters start with X shift (flange axes, mm) and X turn (scanner
/// axes, rad). Each target follows with its shift (base axes, mm) and, for kind pose, its turn (target axes, rad).
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
  /// Number of rotation rows of a view; they come first.
  [[nodiscard]] int rotation_rows() const { return kind_ == ArtefactKind::ball ? 0 : 3; }

  /// Computes the residual of a view and, unless J is null, its derivative (rows x parameters).
  void residual(std::size_t i, const State& state, Eigen::VectorXd& r, Eigen::MatrixXd* J) const;
  /// Covariance of a residual at a state, and its L^-1.
  [[nodiscard]] Eigen::MatrixXd covariance(std::size_t i, const State& state, const Weighing& weighing) const;
  [[nodiscard]] Eigen::MatrixXd whitener(std::size_t i, const State& state, const Weighing& weighing) const;
  [[nodiscard]] std::vector<Eigen::MatrixXd> whiteners(const State& state, const Weighing& weighing) const;

 private:
  ArtefactKind kind_;
  std::span<const View> views_;
  std::size_t targets_ = 1;
};

/// Several starting points without prior knowledge, best first. They are closed forms on all views and on small
/// subsets, so that wrong views cannot spoil all of them. Few views also use a set of rotations. Ball: linear in (vec
/// R, t, p); pose: R_A R_X R_B = R_Z by Kronecker products, then t. The same views give the same starts. At least one
/// is returned.
inline constexpr int kStartSubsets = 100;
[[nodiscard]] std::vector<State> starting_points(const Equations& equations, const Weighing& weighing,
                                                 int subsets = kStartSubsets);

/// Misfit of a state: robust size of the whitened residuals, about 1 if there is only noise.
[[nodiscard]] double robust_size(const Equations& equations, const Weighing& weighing, const State& state);

/// Minimises the sum over the chosen views of rho(|L^-1 r|^2) from `state`. rho is the square itself or, if robust,
/// Cauchy's with scale 1.5 sqrt(rows). `whiteners` as of Equations.
struct Adjusted {
  State state;
  double cost = 0.0;  ///< half the sum
  bool converged = false;
};
[[nodiscard]] Adjusted adjust(const Equations& equations, std::span<const std::size_t> chosen,
                              std::span<const Eigen::MatrixXd> whiteners, const State& state, bool robust);

/// As adjust(), with whiteners recomputed at the state until it converges.
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
