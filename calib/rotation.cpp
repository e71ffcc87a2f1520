// SPDX-License-Identifier: Apache-2.0
#include "calib/rotation.h"

#include <Eigen/SVD>
#include <cmath>

namespace slabd::calib {

Mat3 skew(const Vec3& v) {
  Mat3 m;
  m << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return m;
}

Quat exp_rotation(const Vec3& v) {
  const double angle = v.norm();
  const double half = 0.5 * angle;
  // sin(half) / angle, by its series where the quotient would lose digits.
  const double s = angle > 1e-4 ? std::sin(half) / angle : 0.5 - half * half / 12.0;
  return Quat(std::cos(half), s * v.x(), s * v.y(), s * v.z());
}

Vec3 log_rotation(const Quat& q) {
  const double sign = q.w() < 0.0 ? -1.0 : 1.0;
  const Vec3 v = sign * q.vec();
  const double s = v.norm();
  const double half = std::atan2(s, sign * q.w());
  return s > 1e-9 ? Vec3(v * (2.0 * half / s)) : Vec3(v * 2.0);
}

Mat3 left_jacobian_inverse(const Vec3& r) {
  const double angle = r.norm();
  const Mat3 S = skew(r);
  const double k = angle > 1e-3 ? 1.0 / (angle * angle) - (1.0 + std::cos(angle)) / (2.0 * angle * std::sin(angle))
                                : 1.0 / 12.0 + angle * angle / 720.0;
  return Mat3::Identity() - 0.5 * S + k * S * S;
}

Mat3 nearest_rotation(const Mat3& m) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(Eigen::Matrix3d(m), Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d flip = Eigen::Matrix3d::Identity();
  flip(2, 2) = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0 ? -1.0 : 1.0;
  return svd.matrixU() * flip * svd.matrixV().transpose();
}

Pose rigid_fit(std::span<const Vec3> from, std::span<const Vec3> to) {
  Vec3 from_mean = Vec3::Zero();
  Vec3 to_mean = Vec3::Zero();
  for (std::size_t i = 0; i < from.size(); ++i) {
    from_mean += from[i];
    to_mean += to[i];
  }
  from_mean /= static_cast<double>(from.size());
  to_mean /= static_cast<double>(to.size());
  Mat3 H = Mat3::Zero();
  for (std::size_t i = 0; i < from.size(); ++i) H += (to[i] - to_mean) * (from[i] - from_mean).transpose();
  Pose pose;
  pose.rotation = Quat(nearest_rotation(H)).normalized();
  pose.translation_mm = to_mean - pose.rotation * from_mean;
  return pose;
}

Quat rotation_between(const Vec3& from, const Vec3& to) {
  const Vec3 a = from.normalized();
  const Vec3 b = to.normalized();
  const Vec3 axis = a.cross(b);
  const double w = 1.0 + a.dot(b);
  // Opposite directions: half a turn about any axis that is normal to them.
  if (w < 1e-12) {
    const Vec3 normal = a.unitOrthogonal();
    return Quat(0.0, normal.x(), normal.y(), normal.z());
  }
  return Quat(w, axis.x(), axis.y(), axis.z()).normalized();
}

}  // namespace slabd::calib
