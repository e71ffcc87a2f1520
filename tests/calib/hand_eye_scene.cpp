// SPDX-License-Identifier: Apache-2.0
#include "tests/calib/hand_eye_scene.h"

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>

namespace slabd::calib::scene {
namespace {

Quat turn(const Vec3& axis, double angle_rad) {
  return Quat(Eigen::AngleAxisd(angle_rad, Eigen::Vector3d(axis)));
}

Vec3 normal_vector(Prng& random, double sigma) {
  const double x = random.normal(), y = random.normal(), z = random.normal();
  return Vec3(x, y, z) * sigma;
}

/// A small motion with normally distributed components.
Pose small_motion(Prng& random, double mm, double rad) {
  const Vec3 shift = normal_vector(random, mm);
  const Vec3 r = normal_vector(random, rad);
  const double angle = r.norm();
  return {angle > 0.0 ? turn(r / angle, angle) : Quat(Quat::Identity()), shift};
}

double within(Prng& random, double amplitude) {
  return amplitude * (2.0 * random.uniform() - 1.0);
}

/// A sum of waves with random directions and phases, `sigma` per axis.
class SmoothField {
 public:
  SmoothField(Prng& random, double sigma) : sigma_(sigma) {
    for (Wave& wave : waves_) {
      wave.along = normal_vector(random, 1.0 / kLength_mm);
      wave.amplitude = normal_vector(random, std::sqrt(2.0 / kWaves));
      wave.phase = 2.0 * kPi * random.uniform();
    }
  }
  [[nodiscard]] Vec3 at(const Vec3& p) const {
    Vec3 error = Vec3::Zero();
    for (const Wave& wave : waves_) error += wave.amplitude * std::cos(wave.along.dot(p) + wave.phase);
    return sigma_ * error;
  }

 private:
  static constexpr int kWaves = 40;
  static constexpr double kLength_mm = 500.0;
  struct Wave {
    Vec3 along, amplitude;
    double phase = 0.0;
  };
  std::array<Wave, kWaves> waves_;
  double sigma_;
};

}  // namespace

StatedNoise Plan::noise() const {
  StatedNoise noise;
  const double mm = std::hypot(robot_mm, smooth_mm);
  noise.robot_mm = mm;
  noise.robot_rad = robot_deg ? rad_from_deg(*robot_deg) : robot_rad_for(mm);
  noise.target_mm = target_mm;
  noise.target_rad = rad_from_deg(target_deg);
  return noise;
}

Set make(ArtefactKind kind, const Plan& plan, std::uint64_t seed) {
  Prng random(seed * 7919 + 13);
  Set set;
  set.T_flange_scanner = {turn(Vec3::UnitZ(), within(random, kPi)) * turn(Vec3::UnitX(), within(random, 0.5)) *
                              turn(Vec3::UnitY(), within(random, 0.5)),
                          Vec3(within(random, 150.0), within(random, 150.0), 100.0 + within(random, 60.0))};
  const Vec3 middle(1500.0 + within(random, 200.0), within(random, 600.0), 400.0 + within(random, 200.0));
  const std::size_t targets = kind == ArtefactKind::ball ? plan.balls : 1;
  for (std::size_t k = 0; k < targets; ++k) {
    Pose target;
    target.translation_mm = middle + Vec3(k % 2 == 1 ? 150.0 : 0.0, k % 4 >= 2 ? 150.0 : 0.0, k >= 4 ? 150.0 : 0.0);
    if (kind == ArtefactKind::pose)
      target.rotation = turn(Vec3::UnitZ(), within(random, kPi)) * turn(Vec3::UnitX(), within(random, 0.3));
    set.targets.push_back(target);
  }
  const SmoothField field(random, plan.smooth_mm);
  const Quat down = turn(Vec3::UnitX(), kPi);
  const double robot_rad = plan.robot_deg ? rad_from_deg(*plan.robot_deg) : robot_rad_for(plan.robot_mm);

  const auto outliers = static_cast<std::size_t>(std::lround(plan.outlier_share * static_cast<double>(plan.views)));
  while (set.outliers.size() < outliers) {
    const std::size_t i = random.below(plan.views);
    if (std::find(set.outliers.begin(), set.outliers.end(), i) == set.outliers.end()) set.outliers.push_back(i);
  }
  std::sort(set.outliers.begin(), set.outliers.end());

  for (std::size_t i = 0; i < plan.views; ++i) {
    const double tilt = rad_from_deg(plan.tilt_deg) * std::sqrt(random.uniform());
    const double azimuth = within(random, kPi);
    const double roll = rad_from_deg(within(random, plan.roll_deg));
    Quat looking = down;
    if (plan.one_axis)
      looking = down * turn(Vec3::UnitZ(), roll);
    else if (!plan.one_orientation)
      looking = down * turn(Vec3(std::cos(azimuth), std::sin(azimuth), 0.0), tilt) * turn(Vec3::UnitZ(), roll);
    const Vec3 seen(within(random, plan.fov_mm), within(random, plan.fov_mm),
                    plan.depth_mm + within(random, plan.depth_half_mm));
    const Pose T_base_scanner{looking, middle - looking * seen};
    const Pose T_base_flange = T_base_scanner * set.T_flange_scanner.inverse();
    View view;
    view.T_base_flange = T_base_flange * small_motion(random, plan.robot_mm, robot_rad);
    view.T_base_flange.translation_mm += field.at(T_base_flange.translation_mm);
    Vec3 displaced = Vec3::Zero();
    if (std::find(set.outliers.begin(), set.outliers.end(), i) != set.outliers.end()) {
      const double size = plan.outlier_min_mm + (plan.outlier_max_mm - plan.outlier_min_mm) * random.uniform();
      displaced = normal_vector(random, 1.0).normalized() * size;
    }
    if (kind == ArtefactKind::ball) {
      for (std::size_t k = 0; k < targets; ++k) {
        const Vec3 centre = T_base_scanner.inverse() * set.targets[k].translation_mm;
        view.balls.push_back({k, centre + normal_vector(random, plan.target_mm) + displaced, std::nullopt});
      }
    } else {
      view.T_scanner_target = T_base_scanner.inverse() * set.targets[0] *
                              small_motion(random, plan.target_mm, rad_from_deg(plan.target_deg));
      view.T_scanner_target.translation_mm += displaced;
    }
    set.views.push_back(view);
  }
  return set;
}

double point_error_mm(const Pose& a, const Pose& b, const FieldOfView& fov) {
  double sum = 0.0;
  for (const double x : {-fov.half_x_mm, 0.0, fov.half_x_mm})
    for (const double y : {-fov.half_y_mm, 0.0, fov.half_y_mm})
      for (const double z : {fov.near_mm, 0.5 * (fov.near_mm + fov.far_mm), fov.far_mm})
        sum += (a * Vec3(x, y, z) - b * Vec3(x, y, z)).squaredNorm();
  return std::sqrt(sum / 27.0);
}

// ---- the reference ------------------------------------------------------------------------------------------------
namespace {

/// Parameters as a vector: X (shift, rotation vector applied to the start), then targets.
struct Model {
  ArtefactKind kind;
  const Set& set;
  std::vector<std::size_t> inliers;
  std::vector<Eigen::MatrixXd> roots;  ///< inverse Cholesky factors of the residuals' covariances

  [[nodiscard]] Pose pose(const Pose& start, const Eigen::VectorXd& x, int at) const {
    const Vec3 r = x.segment<3>(at + 3);
    const double angle = r.norm();
    return {(angle > 0.0 ? turn(r / angle, angle) : Quat(Quat::Identity())) * start.rotation,
            start.translation_mm + Vec3(x.segment<3>(at))};
  }
  [[nodiscard]] int parameters() const {
    return kind == ArtefactKind::pose ? 12 : 6 + 3 * static_cast<int>(set.targets.size());
  }
  /// Residual in the base frame: the target's place by X and the robot, minus its true place.
  [[nodiscard]] Eigen::VectorXd residual(std::size_t i, const Eigen::VectorXd& x) const {
    const View& view = set.views[i];
    const Pose X = pose(set.T_flange_scanner, x, 0);
    if (kind == ArtefactKind::ball) {
      Eigen::VectorXd r(3 * static_cast<int>(view.balls.size()));
      for (std::size_t k = 0; k < view.balls.size(); ++k)
        r.segment<3>(3 * static_cast<int>(k)) =
            Eigen::Vector3d(view.T_base_flange * (X * view.balls[k].centre_mm) -
                            (set.targets[k].translation_mm + Vec3(x.segment<3>(6 + 3 * static_cast<int>(k)))));
      return r;
    }
    const Pose Z = pose(set.targets[0], x, 6);
    const Pose seen = view.T_base_flange * X * view.T_scanner_target;
    const Quat q = seen.rotation * Z.rotation.conjugate();
    Eigen::VectorXd r(6);
    r.head<3>() = Eigen::Vector3d(seen.translation_mm - Z.translation_mm);
    r.tail<3>() = Eigen::Vector3d(2.0 * (q.w() < 0.0 ? -1.0 : 1.0) * q.vec());
    return r;
  }
  [[nodiscard]] Eigen::VectorXd whitened(const Eigen::VectorXd& x) const {
    std::vector<double> all;
    for (std::size_t k = 0; k < inliers.size(); ++k) {
      const Eigen::VectorXd w = roots[k] * residual(inliers[k], x);
      all.insert(all.end(), w.data(), w.data() + w.size());
    }
    return Eigen::Map<Eigen::VectorXd>(all.data(), static_cast<Eigen::Index>(all.size()));
  }
};

/// Covariance of a view's residual, computed by a small change of every error source, base frame.
Eigen::MatrixXd covariance_of(const Model& model, std::size_t i, const StatedNoise& noise) {
  const Eigen::VectorXd x = Eigen::VectorXd::Zero(model.parameters());
  const Eigen::VectorXd before = model.residual(i, x);
  Eigen::MatrixXd C = Eigen::MatrixXd::Zero(before.size(), before.size());
  const auto source = [&](double sigma, double step, auto move) {
    Set moved = model.set;
    move(moved.views[i], step);
    const Model other{model.kind, moved, model.inliers, {}};
    const Eigen::VectorXd d = (other.residual(i, x) - before) * (sigma / step);
    C += d * d.transpose();
  };
  for (int axis = 0; axis < 3; ++axis) {
    const Vec3 unit = Vec3::Unit(axis);
    source(noise.robot_mm, 1e-3, [&](View& v, double s) { v.T_base_flange.translation_mm += s * unit; });
    source(noise.robot_rad, 1e-6, [&](View& v, double s) { v.T_base_flange.rotation *= turn(unit, s); });
    if (model.kind == ArtefactKind::pose) {
      source(noise.target_mm, 1e-3, [&](View& v, double s) { v.T_scanner_target.translation_mm += s * unit; });
      source(noise.target_rad, 1e-6, [&](View& v, double s) { v.T_scanner_target.rotation *= turn(unit, s); });
    } else {
      for (std::size_t k = 0; k < model.set.views[i].balls.size(); ++k)
        source(noise.target_mm, 1e-3, [&](View& v, double s) { v.balls[k].centre_mm += s * unit; });
    }
  }
  return C;
}

}  // namespace

Pose reference(ArtefactKind kind, const Set& set, const StatedNoise& noise) {
  Model model{kind, set, {}, {}};
  for (std::size_t i = 0; i < set.views.size(); ++i) {
    if (std::find(set.outliers.begin(), set.outliers.end(), i) != set.outliers.end()) continue;
    model.inliers.push_back(i);
    const Eigen::MatrixXd C = covariance_of(model, i, noise);
    const Eigen::LLT<Eigen::MatrixXd> cholesky(C);
    model.roots.push_back(cholesky.matrixL().solve(Eigen::MatrixXd::Identity(C.rows(), C.rows())));
  }
  // Gauss-Newton from the truth, which is close, with central differences.
  Eigen::VectorXd x = Eigen::VectorXd::Zero(model.parameters());
  constexpr int kSteps = 12;
  for (int step = 0; step < kSteps; ++step) {
    const Eigen::VectorXd r = model.whitened(x);
    Eigen::MatrixXd J(r.size(), x.size());
    for (int k = 0; k < x.size(); ++k) {
      const bool angle = (k >= 3 && k < 6) || (kind == ArtefactKind::pose && k >= 9);
      const double h = angle ? 1e-5 : 1e-2;
      Eigen::VectorXd up = x, down = x;
      up[k] += h;
      down[k] -= h;
      J.col(k) = (model.whitened(up) - model.whitened(down)) / (2.0 * h);
    }
    x -= J.colPivHouseholderQr().solve(r);
  }
  return model.pose(set.T_flange_scanner, x, 0);
}

}  // namespace slabd::calib::scene
