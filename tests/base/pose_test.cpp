// SPDX-License-Identifier: Apache-2.0
#include "base/pose.h"

#include <gtest/gtest.h>

namespace slabd {
namespace {

// KUKA A = 0.3, B = 0.2, C = 0.1 rad: published rows of Rz(A) Ry(B) Rx(C).
TEST(KukaAbc, is_the_active_rz_ry_rx) {
  const Mat3 R = rotation_from_kuka_abc(0.3, 0.2, 0.1).toRotationMatrix();
  Mat3 expected;
  expected << .936293363584, -.275095847318, .218350663146, .289629477626, .956425085849, -.036957013525,
      -.198669330795, .097843395007, .975170327202;
  EXPECT_LT((R - expected).cwiseAbs().maxCoeff(), 1e-12);
  const Quat q = rotation_from_kuka_abc(0.3, 0.2, 0.1);
  EXPECT_NEAR(q.w(), .9833474433, 1e-10);
  EXPECT_NEAR(q.x(), .0342707986, 1e-10);
  EXPECT_NEAR(q.y(), .1060205111, 1e-10);
  EXPECT_NEAR(q.z(), .1435721750, 1e-10);
}

// The paper's eqs. (1)-(3) are passive rotations. Its eq. (4) R1 R2 R3 is the transpose of the matrix used here, and
// the matrix printed as eq. (5) is R3 R2 R1. This test prevents a "correction" of the code to the paper.
TEST(KukaAbc, is_neither_matrix_of_the_paper) {
  const double ex = 0.1;
  const double ey = 0.2;
  const double ez = 0.3;
  Mat3 R1;
  Mat3 R2;
  Mat3 R3;
  R1 << 1, 0, 0, 0, std::cos(ex), std::sin(ex), 0, -std::sin(ex), std::cos(ex);
  R2 << std::cos(ey), 0, -std::sin(ey), 0, 1, 0, std::sin(ey), 0, std::cos(ey);
  R3 << std::cos(ez), std::sin(ez), 0, -std::sin(ez), std::cos(ez), 0, 0, 0, 1;
  const Mat3 ours = rotation_from_kuka_abc(ez, ey, ex).toRotationMatrix();
  const Mat3 eq4 = R1 * R2 * R3;
  const Mat3 eq5 = R3 * R2 * R1;
  EXPECT_LT((eq4.transpose() - ours).cwiseAbs().maxCoeff(), 1e-15);
  EXPECT_GT((eq4 - ours).cwiseAbs().maxCoeff(), 0.1);
  EXPECT_GT((eq5 - ours).cwiseAbs().maxCoeff(), 0.1);
  EXPECT_NEAR((eq5 - eq4).cwiseAbs().maxCoeff(), 0.061, 0.001);
}

TEST(Pose, composes_and_inverts_like_its_matrix) {
  const Pose T_a_b{rotation_from_kuka_abc(0.3, -1.2, 2.0), Vec3(100.0, -20.0, 3.0)};
  const Pose T_b_c{rotation_from_kuka_abc(-2.3, 0.7, 0.1), Vec3(-7.0, 800.0, 41.0)};
  const Mat4 product = T_a_b.matrix() * T_b_c.matrix();
  EXPECT_LT(((T_a_b * T_b_c).matrix() - product).cwiseAbs().maxCoeff(), 1e-11);
  EXPECT_LT(((T_a_b * T_a_b.inverse()).matrix() - Mat4::Identity()).cwiseAbs().maxCoeff(), 1e-12);
  const Pose back = Pose::from_array(T_a_b.to_array());
  EXPECT_LT((back.matrix() - T_a_b.matrix()).cwiseAbs().maxCoeff(), 1e-13);
}

TEST(Angle, is_exact_where_acos_is_not) {
  for (const double angle_deg : {0.001, 0.021, 1.342, 179.999}) {
    const double a = rad_from_deg(angle_deg);
    EXPECT_NEAR(deg_from_rad(angle_between_rad(Vec3(0, 0, 1), Vec3(0, -std::sin(a), std::cos(a)))), angle_deg, 1e-12);
  }
}

}  // namespace
}  // namespace slabd
