// SPDX-License-Identifier: Apache-2.0
//
// A limited number of lives in every test run; script/sim runs lives for as long as desired.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <optional>
#include <set>

#include "storage/storage.h"
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
  World world{1, false};
};

TEST_F(Sim, no_seed_makes_a_wrong_pass_a_lost_row_or_a_stopped_line) {
  const std::vector<Recipe> recipes = life_recipes();
  Totals totals;
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    const LifeResult life = live(seed, recipes, false);
    totals.add(life.totals);
    ASSERT_EQ(life.violation, "") << "seed " << seed << "; again: script/sim --seed " << seed << "\n"
                                  << testing::PrintToString(life.last_lines);
  }
  // A simulation without events would keep every promise, so minimum counts are required.
  EXPECT_GT(totals.passes_taken, 150U);
  EXPECT_GT(totals.slabs_judged, totals.passes + 50U) << "not only good slabs";
  EXPECT_GT(totals.restarts, 100U);
  EXPECT_GT(totals.power_losses, 10U);
  EXPECT_GT(totals.rows_checked, 5'000U);
  std::size_t kinds = 0;
  for (const auto& of_state : totals.injected)
    kinds += std::any_of(of_state.begin(), of_state.end(), [](std::uint64_t count) { return count != 0; }) ? 1U : 0U;
  EXPECT_EQ(kinds, kFaults);
}

TEST_F(Sim, no_seed_of_two_robots_makes_a_wrong_pass_a_lost_row_or_a_stopped_line) {
  const std::vector<Recipe> recipes = life_recipes();
  Totals totals;
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    const LifeResult life = live(seed, recipes, false, 2);
    totals.add(life.totals);
    ASSERT_EQ(life.violation, "") << "seed " << seed << "; again: script/sim --robots 2 --seed " << seed << "\n"
                                  << testing::PrintToString(life.last_lines);
  }
  EXPECT_GT(totals.passes_taken, 60U);
  EXPECT_GT(totals.restarts, 60U);
  EXPECT_GT(totals.scans_by_second, totals.scans / 4);
  EXPECT_LT(totals.scans_by_second, totals.scans);
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

// ---- a log that is not on the disk --------------------------------------------------------------------------------

/// Consecutive processes with the store on the simulated disk.
struct LogInDoubt : Sim {
  void SetUp() override {
    Sim::SetUp();
    settings.db_path = "data/slabd.db";
    settings.spool_dir = "spool";
  }
  /// Runs a process for the duration of `work`, and then kills it.
  template <typename Work>
  void process(const Work& work) {
    Process process(world);
    disk->serve(&process);
    process.start([&] {
      const auto store = storage::open_store(settings);
      if (store.ok()) work(*store.value());
      process.die();
    });
    while (!process.dead()) {
      world.now_ns = process.next_ns();
      process.run_due();
    }
    process.bury();
    disk->serve(nullptr);
    disk->kill_at(0, false);
  }
  static bool commit(storage::Store& store, std::uint16_t session) {
    return store.apply(StoreJob{1, SessionJob{session}}).ok();
  }
  /// The session as stored, read at a process's own start.
  int stored_session() {
    int session = -1;
    process([&](storage::Store& store) {
      if (const auto line = store.recover(); line.ok()) session = line.value()->session;
    });
    return session;
  }
  /// Leaves a log with at least one commit whose sync failed; session 1 was committed before, and at most session 2.
  void leave_doubtful_log() {
    fs::remove_all("data");
    disk.reset();
    disk.emplace(world);
    process([&](storage::Store& store) {
      ASSERT_TRUE(commit(store, 1));
      world.weather.until_ns[static_cast<std::size_t>(Fault::disk_fsync)] = kNever;
      while (commit(store, 2)) {
      }
    });
    world.weather.clear();
  }
  std::optional<Disk> disk;
  storage::StoreSettings settings;
};

TEST_F(LogInDoubt, keeps_what_the_next_process_commits_after_it_when_the_power_fails) {
  for (int round = 0; round < 20; ++round) {
    leave_doubtful_log();
    process([&](storage::Store& store) { ASSERT_TRUE(commit(store, 100)); });
    disk->lose_power();
    ASSERT_EQ(stored_session(), 100) << "round " << round;
  }
}

TEST_F(LogInDoubt, keeps_every_record_when_the_next_start_is_killed_at_any_write) {
  for (const bool power_goes_too : {false, true}) {
    bool killed = true;
    int kills = 0;
    for (std::int64_t call = 1; killed; ++call) {
      leave_doubtful_log();
      killed = true;
      disk->kill_at(call, call % 2 == 0);
      process([&](storage::Store& store) { killed = !commit(store, 99); });
      kills += killed ? 1 : 0;
      if (power_goes_too) disk->lose_power();
      ASSERT_GE(stored_session(), 1) << "killed at call " << call;
      process([&](storage::Store& store) { ASSERT_TRUE(commit(store, 100)); });
      disk->lose_power();
      ASSERT_EQ(stored_session(), 100) << "killed at call " << call;
    }
    EXPECT_GE(kills, 10) << "nothing was made durable";
  }
}

TEST_F(Sim, two_lives_share_no_chance) {
  std::set<std::uint64_t> drawn;
  for (std::uint64_t seed = 1; seed <= 20; ++seed)
    for (std::uint64_t part = 1; part <= 10; ++part) {
      Prng chance = World(seed, false).chance(part);
      for (int i = 0; i < 200; ++i)
        ASSERT_TRUE(drawn.insert(chance.next()).second) << "seed " << seed << ", part " << part << ", draw " << i;
    }
}

// ---- the simulation's own parts -----------------------------------------------------------------------------------

TEST_F(Sim, a_process_sleeps_on_simulated_time_and_is_run_to_its_end_when_it_is_killed) {
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
