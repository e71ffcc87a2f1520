// SPDX-License-Identifier: Apache-2.0
#include "calib/calib.h"

#include <gtest/gtest.h>

namespace slabd::calib {
namespace {

constexpr std::array<double, 7> kGood = {10.0, -20.0, 150.0, 1.0, 0.0, 0.0, 0.0};

TEST(Commissioning, identifies_the_very_numbers) {
  const auto a = commissioning(kGood, 0.02, 0.001);
  ASSERT_TRUE(a.ok());
  const auto same = commissioning(kGood, 0.02, 0.001);
  auto other_numbers = kGood;
  other_numbers[2] += 1e-9;
  const auto other = commissioning(other_numbers, 0.02, 0.001);
  ASSERT_TRUE(other.ok());
  EXPECT_EQ(a.value().id, same.value().id);
  EXPECT_FALSE(a.value().id == other.value().id);
  EXPECT_TRUE(a.value().commissioning);
}

TEST(Commissioning, splices_flange_and_scanner) {
  const auto calibration = commissioning(kGood, kNoValue, kNoValue);
  ASSERT_TRUE(calibration.ok());
  const Pose T_base_flange{Quat(0.0, 1.0, 0.0, 0.0), Vec3(1000.0, 0.0, 900.0)};
  // The flange looks down, so 150 mm along its Z reduces the height by 150 mm.
  EXPECT_LT((splice(calibration.value(), T_base_flange).translation_mm - Vec3(1010.0, 20.0, 750.0)).norm(), 1e-9);
  EXPECT_FALSE(has_value(calibration.value().station_sigma_mm));
}

TEST(Commissioning, refuses_numbers_that_cannot_be) {
  auto bad = kGood;
  bad[3] = 0.9;
  EXPECT_EQ(commissioning(bad, 0.02, 0.001).error().code, Code::calibration_missing);
  bad = kGood;
  bad[0] = 2500.0;
  EXPECT_FALSE(commissioning(bad, 0.02, 0.001).ok());
  bad = kGood;
  bad[1] = kNoValue;
  EXPECT_FALSE(commissioning(bad, 0.02, 0.001).ok());
  EXPECT_FALSE(commissioning(kGood, 0.0, 0.001).ok());
  EXPECT_FALSE(commissioning(kGood, 0.02, -1.0).ok());
}

}  // namespace
}  // namespace slabd::calib
