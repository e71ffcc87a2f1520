// SPDX-License-Identifier: Apache-2.0
//
// A bounded number of lives with every test run; script/sim lives as many as there is time for.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>

#include "tests/sim/disk.h"
#include "tests/sim/life.h"
#include "tests/sim/process.h"

namespace slabd::sim {
namespace {

namespace fs = std::filesystem;

struct Sim : testing::Test {
  void SetUp() override {
    ::unsetenv("JOURNAL_STREAM");
    before = fs::current_path();
    folder = enter_own_folder();
  }
  void TearDown() override {
    fs::current_path(before);
    fs::remove_all(folder);
  }
  fs::path before;
  fs::path folder;
};

TEST_F(Sim, no_seed_makes_a_wrong_pass_a_lost_row_or_a_line_that_stands_still) {
  const std::vector<Recipe> recipes = life_recipes();
  Totals totals;
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    const LifeResult life = live(seed, recipes, false);
    totals.add(life.totals);
    ASSERT_EQ(life.violation, "") << "seed " << seed << "; again: script/sim --seed " << seed << "\n"
                                  << testing::PrintToString(life.last_lines);
  }
  // A simulation in which nothing happens keeps every promise.
  EXPECT_GT(totals.passes_taken, 150U);
  EXPECT_GT(totals.slabs_judged, totals.passes + 50U) << "not only good slabs";
  EXPECT_GT(totals.restarts, 100U);
  EXPECT_GT(totals.power_losses, 10U);
  EXPECT_GT(totals.rows_checked, 5'000U);
  std::size_t kinds = 0;
  for (const auto& of_state : totals.injected)
    kinds += std::any_of(of_state.begin(), of_state.end(), [](std::uint64_t count) { return count != 0; }) ? 1U : 0U;
  EXPECT_GE(kinds + 3, kFaults);
}

TEST_F(Sim, a_seed_is_one_life_bit_by_bit) {
  const std::vector<Recipe> recipes = life_recipes();
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const LifeResult once = live(seed, recipes, false);
    const LifeResult again = live(seed, recipes, false);
    ASSERT_EQ(once.hash, again.hash) << "seed " << seed;
    ASSERT_EQ(once.last_lines, again.last_lines) << "seed " << seed;
  }
  EXPECT_NE(live(1, recipes, false).hash, live(2, recipes, false).hash);
}

// ---- the simulation's own parts
// --------------------------------------------------------------------------------------

TEST_F(Sim, a_process_sleeps_on_the_worlds_time_and_is_run_to_its_end_when_it_dies) {
  World world(1, false);
  Process process(world);
  std::vector<int> order;
  process.start([&] {
    order.push_back(1);
    process.sleep_for(10 * kMs);
    order.push_back(3);
    process.sleep_for(kSecond);
    order.push_back(process.dead() ? 5 : 0);
  });
  process.start([&] {
    order.push_back(2);
    process.sleep_for(20 * kMs);
    order.push_back(4);
  });
  for (world.now_ns = 0; world.now_ns < 100 * kMs; world.now_ns += kMs) process.run_due();
  EXPECT_EQ(order, (std::vector<int>{1, 2, 3, 4}));
  process.bury();
  EXPECT_EQ(order, (std::vector<int>{1, 2, 3, 4, 5}));
}

TEST_F(Sim, exceptions_of_one_fiber_are_not_those_of_another) {
  World world(1, false);
  Process process(world);
  std::string heard;
  const auto thrower = [&](const char* word) {
    return [&, word] {
      try {
        throw std::string(word);
      } catch (const std::string& mine) {
        process.sleep_for(kMs);
        heard += mine;
      }
    };
  };
  process.start(thrower("a"));
  process.start(thrower("b"));
  for (world.now_ns = 0; world.now_ns < 10 * kMs; world.now_ns += kMs) process.run_due();
  EXPECT_EQ(heard, "ab");
}

}  // namespace
}  // namespace slabd::sim
