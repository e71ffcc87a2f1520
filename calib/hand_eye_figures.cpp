// SPDX-License-Identifier: Apache-2.0
//
// Figures without an adjustment: spread of rotations and ball places, error of a scanned point from a covariance, value
// of planned views, and fit of views with a calibration from other views.
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "calib/adjustment.h"
#include "calib/hand_eye.h"
#include "calib/hand_eye_parts.h"
#include "calib/mathematics.h"

namespace slabd::calib {
namespace {

/// Square roots of the eigenvalues, descending.
std::array<double, 3> principal(const Mat3& m) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(Eigen::Matrix3d(m), Eigen::EigenvaluesOnly);
  std::array<double, 3> roots{};
  for (std::size_t k = 0; k < 3; ++k)
    roots[k] = std::sqrt(std::max(0.0, solver.eigenvalues()[2 - static_cast<int>(k)]));
  return roots;
}

/// Views with the artefact exactly at the place given by X and the targets.
std::vector<View> ideal(ArtefactKind kind, std::span<const View> views, const State& state) {
  std::vector<View> ideal(views.begin(), views.end());
  for (View& view : ideal) {
    const Pose T_scanner_base = (view.T_base_flange * state.X).inverse();
    if (kind == ArtefactKind::pose) view.T_scanner_target = T_scanner_base * state.targets[0];
    for (BallObservation& seen : view.balls)
      if (kind == ArtefactKind::ball) seen.centre_mm = T_scanner_base * state.targets[seen.ball].translation_mm;
  }
  return ideal;
}

std::vector<std::size_t> all_of(const Equations& equations) {
  std::vector<std::size_t> all(equations.size());
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = i;
  return all;
}

}  // namespace

Spread spread_of(std::span<const double> values) {
  std::vector<double> sorted;
  double squares = 0.0;
  for (const double v : values) {
    if (!has_value(v)) continue;
    sorted.push_back(v);
    squares += v * v;
  }
  if (sorted.empty()) return {};
  std::sort(sorted.begin(), sorted.end());
  const std::size_t n = sorted.size();
  Spread spread;
  spread.median = n % 2 == 1 ? sorted[n / 2] : 0.5 * (sorted[n / 2 - 1] + sorted[n / 2]);
  spread.rms = std::sqrt(squares / static_cast<double>(n));
  spread.max = sorted.back();
  return spread;
}

std::array<double, 3> rotation_spread_axes_deg(std::span<const View> views) {
  Mat3 sum = Mat3::Zero();
  std::size_t pairs = 0;
  for (std::size_t i = 0; i < views.size(); ++i)
    for (std::size_t j = i + 1; j < views.size(); ++j) {
      const Vec3 turn = log_rotation(views[j].T_base_flange.rotation.conjugate() * views[i].T_base_flange.rotation);
      sum += turn * turn.transpose();
      ++pairs;
    }
  if (pairs == 0) return {0.0, 0.0, 0.0};
  std::array<double, 3> spread = principal(sum / static_cast<double>(pairs));
  for (double& s : spread) s = deg_from_rad(s);
  return spread;
}

std::array<double, 3> ball_spread_axes_mm(std::span<const View> views) {
  std::vector<Vec3> centres;
  Vec3 mean = Vec3::Zero();
  for (const View& view : views)
    for (const BallObservation& seen : view.balls) {
      centres.push_back(seen.centre_mm);
      mean += seen.centre_mm;
    }
  if (centres.size() < 2) return {0.0, 0.0, 0.0};
  mean /= static_cast<double>(centres.size());
  Mat3 scatter = Mat3::Zero();
  for (const Vec3& c : centres) scatter += (c - mean) * (c - mean).transpose();
  return principal(scatter / static_cast<double>(centres.size() - 1));
}

double point_sigma_mm(const Mat6& covariance, const Pose& T_flange_scanner, const FieldOfView& fov) {
  const Mat3 R_X = T_flange_scanner.rotation.toRotationMatrix();
  double variance_mm2 = 0.0;
  for (const double x : {-fov.half_x_mm, 0.0, fov.half_x_mm})
    for (const double y : {-fov.half_y_mm, 0.0, fov.half_y_mm})
      for (const double z : {fov.near_mm, 0.5 * (fov.near_mm + fov.far_mm), fov.far_mm}) {
        Eigen::Matrix<double, 3, 6> J;
        J.leftCols<3>().setIdentity();
        J.rightCols<3>() = -R_X * skew(Vec3(x, y, z));
        variance_mm2 += (J * covariance * J.transpose()).trace();
      }
  return std::sqrt(variance_mm2 / 27.0);
}

Prediction predict(ArtefactKind kind, std::span<const View> views, const Pose& T_flange_scanner,
                   std::span<const Pose> targets, const StatedNoise& noise, const FieldOfView& fov) {
  const State state{T_flange_scanner, {targets.begin(), targets.end()}};
  const std::vector<View> seen = ideal(kind, views, state);
  const Equations equations(kind, seen);
  Prediction prediction;
  if (views.empty() || equations.targets() > targets.size()) return prediction;
  const Linearised linear = linearise(equations, equations.whiteners(state, {noise}), state);
  const std::vector<std::size_t> all = all_of(equations);
  const Degeneracy degeneracy = degeneracy_of(equations, all, linear);
  prediction.condition = degeneracy.condition;
  prediction.smallest_singular_value = degeneracy.smallest;
  if (degeneracy.condition <= kConditionDegenerate)
    prediction.point_sigma_mm =
        point_sigma_mm(parameter_covariance(equations, all, linear).topLeftCorner<6, 6>(), T_flange_scanner, fov);
  return prediction;
}

std::vector<ViewFit> residuals_of(ArtefactKind kind, std::span<const View> views, const Pose& T_flange_scanner,
                                  std::span<const Pose> targets, const StatedNoise& noise) {
  const State state{T_flange_scanner, {targets.begin(), targets.end()}};
  const Equations equations(kind, views);
  std::vector<ViewFit> fits(views.size());
  if (equations.targets() > targets.size()) return fits;
  const int turning = equations.rotation_rows();
  for (std::size_t i = 0; i < views.size(); ++i) {
    Eigen::VectorXd r;
    fits[i].number = views[i].number != 0 ? views[i].number : i + 1;
    equations.residual(i, state, r, nullptr);
    const Eigen::VectorXd w = equations.whitener(i, state, {noise}) * r;
    const auto positions = static_cast<int>(r.size()) - turning;
    fits[i].residual_mm = r.tail(positions).norm() / std::sqrt(positions / 3.0);
    if (turning > 0) fits[i].residual_deg = deg_from_rad(r.head(turning).norm());
    fits[i].sigmas = normal_sigmas(w.squaredNorm(), static_cast<int>(w.size()));
  }
  return fits;
}

Vec6 motion_from_shifts(ArtefactKind kind, std::span<const View> views, const HandEye& hand_eye,
                        const StatedNoise& noise, std::span<const Vec3> shifts_mm) {
  if (!hand_eye.determined) return Vec6::Zero();
  const State state{hand_eye.T_flange_scanner, hand_eye.targets};
  const Equations equations(kind, views);
  const std::vector<Eigen::MatrixXd> whiteners = equations.whiteners(state, {noise});
  const Linearised linear = linearise(equations, whiteners, state);
  std::vector<std::size_t> kept;
  Eigen::VectorXd gradient = Eigen::VectorXd::Zero(equations.parameters());
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (!hand_eye.views[i].kept) continue;
    kept.push_back(i);
    Eigen::VectorXd moved = Eigen::VectorXd::Zero(equations.rows(i));
    for (int row = equations.rotation_rows(); row < equations.rows(i); row += 3)
      moved.segment<3>(row) = Eigen::Vector3d(state.X.rotation * shifts_mm[i]);
    gradient += linear.J[i].transpose() * (whiteners[i] * moved);
  }
  return -(parameter_covariance(equations, kept, linear) * gradient).head<6>();
}

std::vector<Pose> best_targets(ArtefactKind kind, std::span<const View> views, const Pose& T_flange_scanner) {
  const Equations equations(kind, views);
  std::vector<Pose> targets(equations.targets());
  std::vector<double> counts(targets.size(), 0.0);
  Mat3 turned = Mat3::Zero();
  for (const View& view : views) {
    const Pose T_base_scanner = view.T_base_flange * T_flange_scanner;
    if (kind == ArtefactKind::pose) {
      const Pose seen = T_base_scanner * view.T_scanner_target;
      targets[0].translation_mm += seen.translation_mm;
      turned += seen.rotation.toRotationMatrix();
      counts[0] += 1.0;
      continue;
    }
    for (const BallObservation& seen : view.balls) {
      targets[seen.ball].translation_mm += T_base_scanner * seen.centre_mm;
      counts[seen.ball] += 1.0;
    }
  }
  for (std::size_t k = 0; k < targets.size(); ++k) targets[k].translation_mm /= std::max(1.0, counts[k]);
  if (kind == ArtefactKind::pose && !views.empty()) targets[0].rotation = Quat(nearest_rotation(turned)).normalized();
  return targets;
}

ScaleDiagnosis diagnose_scale(std::span<const View> views, std::size_t ball_a, std::size_t ball_b, double certified_mm,
                              double certified_sigma_mm, double target_mm) {
  constexpr double kPpm = 1e6;
  constexpr double kSuspiciousSigmas = 3.0;
  constexpr double kSuspiciousPpm = 100.0;
  ScaleDiagnosis diagnosis;
  double sum_mm = 0.0;
  double variance_mm2 = 0.0;
  for (const View& view : views) {
    const BallObservation* a = nullptr;
    const BallObservation* b = nullptr;
    for (const BallObservation& seen : view.balls) {
      if (seen.ball == ball_a) a = &seen;
      if (seen.ball == ball_b) b = &seen;
    }
    if (a == nullptr || b == nullptr || a == b) continue;
    const Vec3 apart = b->centre_mm - a->centre_mm;
    const double length_mm = apart.norm();
    sum_mm += length_mm;
    for (const BallObservation* seen : {a, b}) {
      const Vec3 along = apart / length_mm;
      variance_mm2 += seen->cov_mm2 ? along.dot(Vec3(*seen->cov_mm2 * along)) : target_mm * target_mm;
    }
    ++diagnosis.views;
  }
  if (diagnosis.views == 0 || !(certified_mm > 0.0)) return diagnosis;
  const auto n = static_cast<double>(diagnosis.views);
  diagnosis.ppm = (sum_mm / n / certified_mm - 1.0) * kPpm;
  diagnosis.sigma_ppm = std::hypot(std::sqrt(variance_mm2) / n, certified_sigma_mm) / certified_mm * kPpm;
  diagnosis.suspicious = std::abs(diagnosis.ppm) > std::max(kSuspiciousSigmas * diagnosis.sigma_ppm, kSuspiciousPpm);
  return diagnosis;
}

}  // namespace slabd::calib
