// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>

#include "base/units.h"

namespace slabd {

using Vec3 = Eigen::Matrix<double, 3, 1, Eigen::DontAlign>;
using Mat3 = Eigen::Matrix<double, 3, 3, Eigen::DontAlign>;
using Mat4 = Eigen::Matrix<double, 4, 4, Eigen::DontAlign>;
using Mat6 = Eigen::Matrix<double, 6, 6, Eigen::DontAlign>;
using Quat = Eigen::Quaternion<double, Eigen::DontAlign>;

/// A rigid transform. A variable `T_a_b` maps coordinates in frame b to coordinates in frame a:
/// `p_a = T_a_b * p_b`, `T_a_c = T_a_b * T_b_c`. Translation in mm, rotation a unit quaternion.
/// The scale factor of the paper's eq. (7) is 1 and is omitted. The functions are not inline because every file that
/// includes this header would compile Eigen's expressions again.
struct Pose {
  Quat rotation = Quat::Identity();
  Vec3 translation_mm = Vec3::Zero();

  [[nodiscard]] static Pose identity() { return {}; }

  [[nodiscard]] Pose operator*(const Pose& other) const;
  [[nodiscard]] Vec3 operator*(const Vec3& p_mm) const;
  [[nodiscard]] Pose inverse() const;
  [[nodiscard]] Mat4 matrix() const;
  /// Written form of a pose: x y z (mm) qw qx qy qz.
  [[nodiscard]] std::array<double, 7> to_array() const;
  [[nodiscard]] static Pose from_array(const std::array<double, 7>& v);
  [[nodiscard]] bool all_finite() const;
};

/// Converts KUKA's A, B, C (rad), the active rotation `Rz(A) * Ry(B) * Rx(C)`. The paper's eq. (4) is its transpose,
/// and its eq. (5) is a third matrix (R3 R2 R1, not the R1 R2 R3 of eq. (4)). Neither is used.
[[nodiscard]] Quat rotation_from_kuka_abc(double a_rad, double b_rad, double c_rad);

/// Angles of a rotation, A and C in -pi..pi, B in -pi/2..pi/2. `rotation_from_kuka_abc` reproduces the rotation to
/// 1e-14 rad, also with B at +-90 deg, where only A -+ C is defined and C = 0 is chosen.
struct KukaAbc {
  double a_rad = 0.0;
  double b_rad = 0.0;
  double c_rad = 0.0;
};
[[nodiscard]] KukaAbc kuka_abc_from_rotation(const Quat& rotation);

/// Angle between two directions (any length > 0), by atan2: exact near 0 and pi, where acos is not.
[[nodiscard]] double angle_between_rad(const Vec3& a, const Vec3& b);

/// Angle of the rotation that takes one orientation to the other, 0..pi.
[[nodiscard]] double angle_between_rad(const Quat& a, const Quat& b);

}  // namespace slabd
