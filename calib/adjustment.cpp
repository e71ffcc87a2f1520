// SPDX-License-Identifier: Apache-2.0
//
// Minimisation of the observation equations (see the header) by Ceres. With one thread and fixed tolerances the same
// views give the same bits. Derivatives are analytic, with respect to small motions. The first tangent coordinates of
// the manifold are the parameters themselves, so minimiser and statistics use the same Jacobian.
#include "calib/adjustment.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "calib/mathematics.h"

namespace slabd::calib {
namespace {

/// A pose in Ceres: translation, then the quaternion in Eigen's order (x, y, z, w).
constexpr int kPoseNumbers = 7;
using PoseNumbers = std::array<double, kPoseNumbers>;

PoseNumbers numbers_of(const Pose& pose) {
  const Quat& q = pose.rotation;
  return {pose.translation_mm.x(), pose.translation_mm.y(), pose.translation_mm.z(), q.x(), q.y(), q.z(), q.w()};
}
Pose pose_from(const double* v) {
  return {Quat(v[6], v[3], v[4], v[5]), Vec3(v[0], v[1], v[2])};
}

/// Manifold (t, R) + (dt, turn) = (t + dt, R exp(turn)). Cost functions write derivatives by (dt, turn) into the first
/// six of their seven columns, and PlusJacobian selects these. The seventh is never used.
class PoseManifold final : public ceres::Manifold {
 public:
  [[nodiscard]] int AmbientSize() const override { return kPoseNumbers; }
  [[nodiscard]] int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override {
    Pose pose = pose_from(x);
    pose.translation_mm += Vec3(delta[0], delta[1], delta[2]);
    pose.rotation = (pose.rotation * exp_rotation(Vec3(delta[3], delta[4], delta[5]))).normalized();
    const PoseNumbers numbers = numbers_of(pose);
    std::copy(numbers.begin(), numbers.end(), x_plus_delta);
    return true;
  }
  bool PlusJacobian(const double* /*x*/, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, kPoseNumbers, 6, Eigen::RowMajor>> J(jacobian);
    J.setIdentity();
    return true;
  }
  bool Minus(const double* y, const double* x, double* y_minus_x) const override {
    const Pose to = pose_from(y);
    const Pose from = pose_from(x);
    const Vec3 shift = to.translation_mm - from.translation_mm;
    const Vec3 turn = log_rotation(from.rotation.conjugate() * to.rotation);
    for (int k = 0; k < 3; ++k) {
      y_minus_x[k] = shift[k];
      y_minus_x[k + 3] = turn[k];
    }
    return true;
  }
  bool MinusJacobian(const double* /*x*/, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, 6, kPoseNumbers, Eigen::RowMajor>> J(jacobian);
    J.setIdentity();
    return true;
  }
};

/// Targets that view i depends on, ascending.
std::vector<std::size_t> targets_of(const Equations& equations, std::size_t i) {
  if (equations.kind() == ArtefactKind::pose) return {0};
  std::vector<std::size_t> targets;
  for (const BallObservation& seen : equations.view(i).balls) targets.push_back(seen.ball);
  std::sort(targets.begin(), targets.end());
  return targets;
}

/// Cost function of one view. Parameter blocks: X, then its targets.
class ViewCost final : public ceres::CostFunction {
 public:
  ViewCost(const Equations& equations, std::size_t view, const Eigen::MatrixXd& whitener)
      : equations_(equations), view_(view), targets_(targets_of(equations, view)), whitener_(whitener) {
    set_num_residuals(equations.rows(view));
    mutable_parameter_block_sizes()->push_back(kPoseNumbers);
    for (std::size_t k = 0; k < targets_.size(); ++k)
      mutable_parameter_block_sizes()->push_back(equations.kind() == ArtefactKind::ball ? 3 : kPoseNumbers);
  }
  bool Evaluate(const double* const* parameters, double* residuals, double** jacobians) const override {
    State state;
    state.X = pose_from(parameters[0]);
    state.targets.resize(equations_.targets());
    for (std::size_t k = 0; k < targets_.size(); ++k) {
      const double* v = parameters[k + 1];
      if (equations_.kind() == ArtefactKind::ball)
        state.targets[targets_[k]].translation_mm = Vec3(v[0], v[1], v[2]);
      else
        state.targets[targets_[k]] = pose_from(v);
    }
    Eigen::VectorXd r;
    Eigen::MatrixXd J;
    equations_.residual(view_, state, r, jacobians != nullptr ? &J : nullptr);
    Eigen::Map<Eigen::VectorXd>(residuals, num_residuals()) = whitener_ * r;
    if (jacobians == nullptr) return true;
    J = whitener_ * J;
    fill(jacobians[0], kPoseNumbers, J.leftCols(6));
    const int each = equations_.target_parameters();
    for (std::size_t k = 0; k < targets_.size(); ++k)
      fill(jacobians[k + 1], parameter_block_sizes()[k + 1],
           J.middleCols(6 + each * static_cast<int>(targets_[k]), each));
    return true;
  }

 private:
  void fill(double* out, int columns, const Eigen::Ref<const Eigen::MatrixXd>& J) const {
    if (out == nullptr) return;
    Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> to(out, num_residuals(),
                                                                                          columns);
    to.setZero();
    to.leftCols(J.cols()) = J;
  }

  const Equations& equations_;
  std::size_t view_;
  std::vector<std::size_t> targets_;
  const Eigen::MatrixXd& whitener_;
};

double moved_mm(const State& a, const State& b) {
  // Rotations act at half a metre, the scanner's working distance.
  constexpr double kLever_mm = 500.0;
  double moved =
      (a.X.translation_mm - b.X.translation_mm).norm() + kLever_mm * angle_between_rad(a.X.rotation, b.X.rotation);
  for (std::size_t k = 0; k < a.targets.size(); ++k)
    moved = std::max(moved, (a.targets[k].translation_mm - b.targets[k].translation_mm).norm() +
                                kLever_mm * angle_between_rad(a.targets[k].rotation, b.targets[k].rotation));
  return moved;
}

}  // namespace

Equations::Equations(ArtefactKind kind, std::span<const View> views) : kind_(kind), views_(views) {
  if (kind == ArtefactKind::pose) return;
  for (const View& view : views)
    for (const BallObservation& seen : view.balls) targets_ = std::max(targets_, seen.ball + 1);
}

int Equations::parameters() const {
  return 6 + target_parameters() * static_cast<int>(targets_);
}

int Equations::rows(std::size_t i) const {
  return kind_ == ArtefactKind::ball ? 3 * static_cast<int>(views_[i].balls.size()) : 6;
}

void Equations::residual(std::size_t i, const State& state, Eigen::VectorXd& r, Eigen::MatrixXd* J) const {
  const View& view = views_[i];
  const Pose back = view.T_base_flange.inverse();
  const Mat3 R_X = state.X.rotation.toRotationMatrix();
  const Mat3 R_back = back.rotation.toRotationMatrix();
  r.resize(rows(i));
  if (J != nullptr) J->setZero(rows(i), parameters());

  const auto position = [&](int row, const Vec3& c, std::size_t target) {
    r.segment<3>(row) = Eigen::Vector3d(state.X * c - back * state.targets[target].translation_mm);
    if (J == nullptr) return;
    J->block<3, 3>(row, 0).setIdentity();
    J->block<3, 3>(row, 3) = -R_X * skew(c);
    J->block<3, 3>(row, 6 + target_parameters() * static_cast<int>(target)) = -R_back;
  };
  if (kind_ == ArtefactKind::ball) {
    int row = 0;
    for (const BallObservation& seen : view.balls) {
      position(row, seen.centre_mm, seen.ball);
      row += 3;
    }
    return;
  }
  const Quat turned = state.X.rotation * view.T_scanner_target.rotation;
  const Vec3 r_R = log_rotation(turned * state.targets[0].rotation.conjugate() * view.T_base_flange.rotation);
  r.head<3>() = Eigen::Vector3d(r_R);
  if (J != nullptr) {
    const Mat3 outer = left_jacobian_inverse(r_R);
    J->block<3, 3>(0, 3) = outer * R_X;
    J->block<3, 3>(0, 9) = -outer * turned.toRotationMatrix();
  }
  position(3, view.T_scanner_target.translation_mm, 0);
}

Eigen::MatrixXd Equations::covariance(std::size_t i, const State& state, const Weighing& weighing) const {
  const View& view = views_[i];
  const auto square = [](double v) { return v * v; };
  const double robot_mm2 = square(weighing.position * weighing.noise.robot_mm);
  const double robot_rad2 = square(weighing.robot_rotation * weighing.noise.robot_rad);
  const double carried_rad2 = weighing.lever ? robot_rad2 : 0.0;
  const double target_mm2 = square(weighing.position * weighing.noise.target_mm);
  const double target_rad2 = square(weighing.target_rotation * weighing.noise.target_rad);
  const Mat3 R_X = state.X.rotation.toRotationMatrix();
  Eigen::MatrixXd C = Eigen::MatrixXd::Zero(rows(i), rows(i));
  if (kind_ == ArtefactKind::ball) {
    std::vector<Mat3> levers;
    for (const BallObservation& seen : view.balls) levers.push_back(skew(state.X * seen.centre_mm));
    for (std::size_t j = 0; j < levers.size(); ++j)
      for (std::size_t k = 0; k < levers.size(); ++k)
        C.block<3, 3>(3 * static_cast<int>(j), 3 * static_cast<int>(k)) =
            robot_mm2 * Mat3::Identity() + carried_rad2 * levers[j] * levers[k].transpose();
    for (std::size_t k = 0; k < levers.size(); ++k) {
      const std::optional<Mat3>& own = view.balls[k].cov_mm2;
      const Mat3 seen =
          own ? Mat3(square(weighing.position) * R_X * *own * R_X.transpose()) : Mat3(target_mm2 * Mat3::Identity());
      C.block<3, 3>(3 * static_cast<int>(k), 3 * static_cast<int>(k)) += seen;
    }
  } else {
    const Mat3 lever = skew(state.X * view.T_scanner_target.translation_mm);
    C.topLeftCorner<3, 3>() = robot_rad2 * Mat3::Identity();
    C.bottomLeftCorner<3, 3>() = -carried_rad2 * lever;
    C.topRightCorner<3, 3>() = C.bottomLeftCorner<3, 3>().transpose().eval();
    C.bottomRightCorner<3, 3>() = robot_mm2 * Mat3::Identity() + carried_rad2 * lever * lever.transpose();
    if (view.target_covariance) {
      const Mat3 R = R_X * view.T_scanner_target.rotation.toRotationMatrix();
      const Mat6& own = *view.target_covariance;
      C.topLeftCorner<3, 3>() += square(weighing.target_rotation) * R * own.bottomRightCorner<3, 3>() * R.transpose();
      C.bottomLeftCorner<3, 3>() +=
          weighing.position * weighing.target_rotation * R * own.topRightCorner<3, 3>() * R.transpose();
      C.topRightCorner<3, 3>() = C.bottomLeftCorner<3, 3>().transpose().eval();
      C.bottomRightCorner<3, 3>() += square(weighing.position) * R * own.topLeftCorner<3, 3>() * R.transpose();
    } else {
      C.topLeftCorner<3, 3>() += target_rad2 * Mat3::Identity();
      C.bottomRightCorner<3, 3>() += target_mm2 * Mat3::Identity();
    }
  }
  return C;
}

Eigen::MatrixXd Equations::whitener(std::size_t i, const State& state, const Weighing& weighing) const {
  return inverse_cholesky(covariance(i, state, weighing));
}

std::vector<Eigen::MatrixXd> Equations::whiteners(const State& state, const Weighing& weighing) const {
  std::vector<Eigen::MatrixXd> all;
  for (std::size_t i = 0; i < size(); ++i) all.push_back(whitener(i, state, weighing));
  return all;
}

Adjusted adjust(const Equations& equations, std::span<const std::size_t> chosen,
                std::span<const Eigen::MatrixXd> whiteners, const State& state, bool robust) {
  constexpr double kCauchyScale = 1.5;
  const bool balls = equations.kind() == ArtefactKind::ball;
  PoseNumbers X = numbers_of(state.X);
  std::vector<PoseNumbers> targets;
  for (const Pose& target : state.targets) targets.push_back(numbers_of(target));

  ceres::Problem problem;
  problem.AddParameterBlock(X.data(), kPoseNumbers, new PoseManifold);
  for (PoseNumbers& target : targets) {
    if (balls)
      problem.AddParameterBlock(target.data(), 3);
    else
      problem.AddParameterBlock(target.data(), kPoseNumbers, new PoseManifold);
  }
  for (const std::size_t i : chosen) {
    std::vector<double*> blocks = {X.data()};
    for (const std::size_t target : targets_of(equations, i)) blocks.push_back(targets[target].data());
    ceres::LossFunction* loss =
        robust ? new ceres::CauchyLoss(kCauchyScale * std::sqrt(static_cast<double>(equations.rows(i)))) : nullptr;
    problem.AddResidualBlock(new ViewCost(equations, i, whiteners[i]), loss, blocks);
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.num_threads = 1;
  options.max_num_iterations = 200;
  options.function_tolerance = 1e-13;
  options.parameter_tolerance = 1e-11;
  options.gradient_tolerance = 1e-12;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);

  Adjusted adjusted;
  adjusted.cost = summary.final_cost;
  adjusted.converged = summary.termination_type == ceres::CONVERGENCE;
  adjusted.state.X = pose_from(X.data());
  for (std::size_t k = 0; k < targets.size(); ++k) {
    adjusted.state.targets.push_back(balls ? Pose{} : pose_from(targets[k].data()));
    adjusted.state.targets[k].translation_mm = Vec3(targets[k][0], targets[k][1], targets[k][2]);
  }
  return adjusted;
}

Adjusted adjust_and_weigh(const Equations& equations, std::span<const std::size_t> chosen, const Weighing& weighing,
                          const State& state, bool robust) {
  // The lever arms in the covariances hardly change once X is close, so two rounds are usually enough.
  constexpr int kRoundsMax = 6;
  constexpr double kStill_mm = 1e-7;
  Adjusted adjusted{state, 0.0, false};
  for (int round = 0; round < kRoundsMax; ++round) {
    const State before = adjusted.state;
    adjusted = adjust(equations, chosen, equations.whiteners(before, weighing), before, robust);
    if (moved_mm(before, adjusted.state) < kStill_mm) break;
  }
  return adjusted;
}

Linearised linearise(const Equations& equations, std::span<const Eigen::MatrixXd> whiteners, const State& state) {
  Linearised linear;
  linear.w.resize(equations.size());
  linear.J.resize(equations.size());
  for (std::size_t i = 0; i < equations.size(); ++i) {
    equations.residual(i, state, linear.w[i], &linear.J[i]);
    linear.w[i] = product(whiteners[i], linear.w[i]);
    linear.J[i] = product(whiteners[i], linear.J[i]);
  }
  return linear;
}

}  // namespace slabd::calib
