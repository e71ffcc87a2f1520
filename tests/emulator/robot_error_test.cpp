// SPDX-License-Identifier: Apache-2.0
#include "emulator/robot_error.h"

#include <gtest/gtest.h>

namespace slabd::emulator {
namespace {

Pose at(double x, double y, double z) {
  return {Quat(0.0, 1.0, 0.0, 0.0), Vec3(x, y, z)};
}

TEST(RobotError, is_zero_unless_asked_for) {
  const RobotError robot;
  const Pose pose = at(1500.0, 100.0, 900.0);
  EXPECT_EQ(robot.real(pose, 3).translation_mm, pose.translation_mm);
  EXPECT_LT(angle_between_rad(robot.real(pose, 3).rotation, pose.rotation), 1e-12);
}

TEST(RobotError, has_the_size_and_the_length_it_was_given) {
  // Averages over many robots, because the errors of one robot are correlated.
  double square = 0.0;
  double turn_square = 0.0;
  double product = 0.0;
  double near_product = 0.0;
  constexpr int kRobots = 2000;
  for (int seed = 1; seed <= kRobots; ++seed) {
    RobotErrorTraits traits;
    traits.seed = static_cast<std::uint64_t>(seed);
    traits.smooth_mm = 0.7;
    const RobotError robot(traits);
    const auto off = [&](const Pose& p) -> Vec3 { return robot.real_mean(p).translation_mm - p.translation_mm; };
    const Pose here = at(1500.0, 0.0, 900.0);
    const Vec3 e = off(here);
    square += e.squaredNorm() / 3.0;
    product += e.dot(off(at(1500.0, 500.0, 900.0))) / 3.0;
    near_product += e.dot(off(at(1500.0, 10.0, 900.0))) / 3.0;
    const double turn = angle_between_rad(robot.real_mean(here).rotation, here.rotation);
    turn_square += turn * turn / 3.0;
  }
  EXPECT_NEAR(std::sqrt(square / kRobots), 0.7, 0.03);
  EXPECT_NEAR(std::sqrt(turn_square / kRobots), 0.7 / 1500.0, 0.03 * 0.7 / 1500.0);
  EXPECT_NEAR(product / square, std::exp(-0.5), 0.05);
  EXPECT_NEAR(near_product / square, 1.0, 0.001);
}

TEST(RobotError, comes_back_to_the_same_place_within_its_repeatability) {
  RobotErrorTraits traits;
  traits.smooth_mm = 0.7;
  traits.repeat_mm = 0.017;
  const RobotError robot(traits);
  const Pose pose = at(1700.0, -300.0, 1000.0);
  const Vec3 mean = robot.real_mean(pose).translation_mm;
  double square = 0.0;
  constexpr int kVisits = 3000;
  for (std::uint64_t visit = 0; visit < kVisits; ++visit) {
    const Pose real = robot.real(pose, visit);
    square += (real.translation_mm - mean).squaredNorm() / 3.0;
    EXPECT_EQ(real.translation_mm, robot.real(pose, visit).translation_mm);
  }
  EXPECT_NEAR(std::sqrt(square / kVisits), 0.017, 0.001);
  EXPECT_GT((mean - pose.translation_mm).norm(), 0.05);
}

}  // namespace
}  // namespace slabd::emulator
