// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/SVD>
#include <cmath>

#include "base/base.h"

/// Small rotations as vectors: axis times angle (rad). Internal to the room.
namespace slabd::calib {

[[nodiscard]] inline Mat3 skew(const Vec3& v) {
  Mat3 m;
  m << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return m;
}

[[nodiscard]] inline Quat exp_rotation(const Vec3& v) {
  const double angle = v.norm();
  const double half = 0.5 * angle;
  // sin(half) / angle, by its series where the quotient would lose digits.
  const double s = angle > 1e-4 ? std::sin(half) / angle : 0.5 - half * half / 12.0;
  return Quat(std::cos(half), s * v.x(), s * v.y(), s * v.z());
}

/// Length 0..pi.
[[nodiscard]] inline Vec3 log_rotation(const Quat& q) {
  const double sign = q.w() < 0.0 ? -1.0 : 1.0;
  const Vec3 v = sign * q.vec();
  const double s = v.norm();
  const double half = std::atan2(s, sign * q.w());
  return s > 1e-9 ? Vec3(v * (2.0 * half / s)) : Vec3(v * 2.0);
}

/// d log(exp(d) exp(r)) / dd at d = 0.
[[nodiscard]] inline Mat3 left_jacobian_inverse(const Vec3& r) {
  const double angle = r.norm();
  const Mat3 S = skew(r);
  const double k = angle > 1e-3 ? 1.0 / (angle * angle) - (1.0 + std::cos(angle)) / (2.0 * angle * std::sin(angle))
                                : 1.0 / 12.0 + angle * angle / 720.0;
  return Mat3::Identity() - 0.5 * S + k * S * S;
}

/// The rotation nearest to a matrix.
[[nodiscard]] inline Mat3 nearest_rotation(const Mat3& m) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(Eigen::Matrix3d(m), Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d flip = Eigen::Matrix3d::Identity();
  flip(2, 2) = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0 ? -1.0 : 1.0;
  return svd.matrixU() * flip * svd.matrixV().transpose();
}

}  // namespace slabd::calib
