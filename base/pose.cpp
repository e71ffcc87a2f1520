// SPDX-License-Identifier: Apache-2.0
#include "base/pose.h"

#include <cmath>

namespace slabd {

Pose Pose::operator*(const Pose& other) const {
  return {(rotation * other.rotation).normalized(), translation_mm + rotation * other.translation_mm};
}

Vec3 Pose::operator*(const Vec3& p_mm) const {
  return rotation * p_mm + translation_mm;
}

Pose Pose::inverse() const {
  const Quat back = rotation.conjugate();
  return {back, -(back * translation_mm)};
}

Mat4 Pose::matrix() const {
  Mat4 m = Mat4::Identity();
  m.topLeftCorner<3, 3>() = rotation.toRotationMatrix();
  m.topRightCorner<3, 1>() = translation_mm;
  return m;
}

std::array<double, 7> Pose::to_array() const {
  return {translation_mm.x(), translation_mm.y(), translation_mm.z(), rotation.w(),
          rotation.x(),       rotation.y(),       rotation.z()};
}

Pose Pose::from_array(const std::array<double, 7>& v) {
  return {Quat(v[3], v[4], v[5], v[6]).normalized(), Vec3(v[0], v[1], v[2])};
}

bool Pose::all_finite() const {
  return translation_mm.allFinite() && rotation.coeffs().allFinite();
}

Quat rotation_from_kuka_abc(double a_rad, double b_rad, double c_rad) {
  return Quat(Eigen::AngleAxisd(a_rad, Eigen::Vector3d::UnitZ()) * Eigen::AngleAxisd(b_rad, Eigen::Vector3d::UnitY()) *
              Eigen::AngleAxisd(c_rad, Eigen::Vector3d::UnitX()));
}

KukaAbc kuka_abc_from_rotation(const Quat& rotation) {
  // Near B = +-90 deg both arguments of A are rounding noise. C is then computed from R and A, so that the three angles
  // are consistent for any A.
  const Mat3 R = rotation.normalized().toRotationMatrix();
  constexpr double kSingular = 1e-14;
  KukaAbc abc;
  const double cos_b = std::hypot(R(0, 0), R(1, 0));
  abc.b_rad = std::atan2(-R(2, 0), cos_b);
  if (cos_b > kSingular) {
    abc.a_rad = std::atan2(R(1, 0), R(0, 0));
  } else {
    abc.a_rad = std::atan2(-R(0, 1), R(1, 1));
  }
  const double sin_a = std::sin(abc.a_rad);
  const double cos_a = std::cos(abc.a_rad);
  abc.c_rad = std::atan2(sin_a * R(0, 2) - cos_a * R(1, 2), cos_a * R(1, 1) - sin_a * R(0, 1));
  return abc;
}

double angle_between_rad(const Vec3& a, const Vec3& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

double angle_between_rad(const Quat& a, const Quat& b) {
  const Quat d = a.conjugate() * b;
  return 2.0 * std::atan2(d.vec().norm(), std::abs(d.w()));
}

}  // namespace slabd
