// SPDX-License-Identifier: Apache-2.0
#include "base/rate_limit.h"

#include <gtest/gtest.h>

namespace slabd {
namespace {

TEST(RateLimit, permits_the_first_line_at_once_and_then_one_in_each_period) {
  for (const std::int64_t start_ns : {std::int64_t{0}, std::int64_t{7}, std::int64_t{1} << 62U}) {
    RateLimit limit(10);
    EXPECT_TRUE(limit.permits(start_ns));
    EXPECT_FALSE(limit.permits(start_ns));
    EXPECT_FALSE(limit.permits(start_ns + 9));
    EXPECT_TRUE(limit.permits(start_ns + 10));
    EXPECT_TRUE(limit.permits(start_ns + 500));
    EXPECT_FALSE(limit.permits(start_ns + 509)) << "unused periods are not saved";
  }
}

TEST(RateLimit, saves_the_lines_of_unused_periods_up_to_its_burst) {
  RateLimit limit(10, 3);
  const auto permitted = [&limit](std::int64_t now_ns) {
    int lines = 0;
    while (limit.permits(now_ns)) ++lines;
    return lines;
  };
  EXPECT_EQ(permitted(1'000), 3);
  EXPECT_EQ(permitted(1'009), 0);
  EXPECT_EQ(permitted(1'010), 1);
  EXPECT_EQ(permitted(1'030), 2);
  EXPECT_EQ(permitted(9'000), 3);
}

}  // namespace
}  // namespace slabd
