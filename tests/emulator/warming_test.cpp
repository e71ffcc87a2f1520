// SPDX-License-Identifier: Apache-2.0
#include "emulator/warming.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace slabd::emulator {
namespace {

TEST(Warming, without_a_time_constant_nothing_changes) {
  std::vector<float> xyz = {1.0F, 2.0F, 600.0F};
  warm({}, 0.0, xyz);
  EXPECT_EQ(xyz, (std::vector<float>{1.0F, 2.0F, 600.0F}));
  EXPECT_TRUE(std::isnan(temperature_c({}, 0.0)));
}

TEST(Warming, temperature_rises_and_the_error_of_the_cold_scanner_decays) {
  Warming warming;
  warming.time_constant_s = 600.0;
  EXPECT_NEAR(temperature_c(warming, 0.0), 22.0, 1e-9);
  EXPECT_NEAR(temperature_c(warming, 600.0), 34.0 - 12.0 / std::exp(1.0), 1e-9);
  EXPECT_NEAR(temperature_c(warming, 60'000.0), 34.0, 1e-9);
  std::vector<float> cold = {100.0F, 0.0F, 500.0F};
  warm(warming, 0.0, cold);
  EXPECT_NEAR(cold[0], 100.03, 1e-4);
  EXPECT_NEAR(cold[2], 500.0 + 0.15 + 0.06, 1e-4);
  std::vector<float> warm_points = {100.0F, 0.0F, 500.0F};
  warm(warming, 60'000.0, warm_points);
  EXPECT_NEAR(warm_points[2], 500.0, 1e-4);
}

TEST(Warming, missing_points_stay_missing) {
  std::vector<float> xyz(3, NAN);
  Warming warming;
  warming.time_constant_s = 600.0;
  warm(warming, 0.0, xyz);
  for (const float v : xyz) EXPECT_TRUE(std::isnan(v));
}

}  // namespace
}  // namespace slabd::emulator
