// SPDX-License-Identifier: Apache-2.0
#include "base/team.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <thread>
#include <vector>

namespace slabd {
namespace {

TEST(Team, does_every_block_once) {
  for (const int threads : {1, 2}) {
    Team team(threads);
    EXPECT_EQ(team.threads(), threads);
    for (const std::size_t blocks : {0U, 1U, 2U, 3U, 1000U}) {
      std::vector<std::atomic<int>> done(blocks);
      team.run(blocks, [&](std::size_t block) { ++done[block]; });
      for (const auto& d : done) EXPECT_EQ(d, 1);
    }
  }
}

TEST(Team, survives_many_short_jobs_and_long_pauses) {
  Team team(2);
  std::atomic<std::size_t> sum{0};
  for (int job = 0; job < 20000; ++job) team.run(4, [&](std::size_t block) { sum += block; });
  EXPECT_EQ(sum, 20000U * 6U);
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  team.run(2, [&](std::size_t block) { sum += block; });
  EXPECT_EQ(sum, 20000U * 6U + 1U);
}

}  // namespace
}  // namespace slabd
