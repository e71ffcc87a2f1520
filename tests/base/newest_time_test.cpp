// SPDX-License-Identifier: Apache-2.0
#include "base/calibration.h"

#include <gtest/gtest.h>

namespace slabd {
namespace {

constexpr std::int64_t kMinute_us = 60'000'000;
constexpr std::int64_t kDay_us = 1'440 * kMinute_us;

TEST(NewestTime, follows_times_that_go_on_and_none_that_go_back) {
  NewestTime newest;
  newest.note(700 * kDay_us);
  EXPECT_EQ(newest.utime_us(), 700 * kDay_us);
  newest.note(700 * kDay_us + kMinute_us);
  newest.note(699 * kDay_us);
  EXPECT_EQ(newest.utime_us(), 700 * kDay_us + kMinute_us);
}

TEST(NewestTime, takes_no_notice_of_a_clock_that_was_ahead_for_a_while) {
  NewestTime newest(700 * kDay_us);
  for (int minute = 0; minute < 59; ++minute) newest.note(1'200 * kDay_us + minute * kMinute_us);
  EXPECT_EQ(newest.utime_us(), 700 * kDay_us);
  newest.note(700 * kDay_us + kMinute_us);
  // A second jump to the same day: the hour starts again.
  newest.note(1'200 * kDay_us + 90 * kMinute_us);
  EXPECT_EQ(newest.utime_us(), 700 * kDay_us + kMinute_us);
}

TEST(NewestTime, continues_after_weeks_without_a_record) {
  NewestTime newest(700 * kDay_us);
  newest.note(714 * kDay_us);
  newest.note(714 * kDay_us + 30 * kMinute_us);
  EXPECT_EQ(newest.utime_us(), 700 * kDay_us);
  newest.note(714 * kDay_us + 61 * kMinute_us);
  EXPECT_EQ(newest.utime_us(), 714 * kDay_us + 61 * kMinute_us);
}

}  // namespace
}  // namespace slabd
