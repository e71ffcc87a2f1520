// SPDX-License-Identifier: Apache-2.0
//
// Some seeds in every test run; more with
//   SLABD_TRUTH_SEEDS=100000 SLABD_TRUTH_FROM=1 daemon_truth_test --gtest_filter='StationTruth.*'
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>

#include "tests/daemon/station/station_truth_line.h"

namespace slabd::daemon {
namespace {

constexpr int kTurns = 3'000;
constexpr int kOrdersMax = 60;  ///< a whole slab needs 20

std::uint64_t number_from(const char* name, std::uint64_t otherwise) {
  const char* text = std::getenv(name);
  return text == nullptr ? otherwise : std::strtoull(text, nullptr, 10);
}

TEST(StationTruth, no_chance_gives_a_block_another_ones_scan_or_leaves_the_line_standing) {
  const std::uint64_t from = number_from("SLABD_TRUTH_FROM", 1);
  const std::uint64_t seeds = number_from("SLABD_TRUTH_SEEDS", 400);
  TruthLine::Figures all;
  for (std::uint64_t seed = from; seed < from + seeds; ++seed) {
    TruthLine line(seed);
    line.live(kTurns);
    line.pass_a_slab(kOrdersMax);
    ASSERT_EQ(line.violation(), "") << "seed " << seed << "; again: SLABD_TRUTH_FROM=" << seed
                                    << " SLABD_TRUTH_SEEDS=1";
    const TruthLine::Figures& one = line.figures();
    all.steps += one.steps;
    all.scans_recorded += one.scans_recorded;
    all.scans_thrown_away += one.scans_thrown_away;
    all.views_asked += one.views_asked;
    all.reloads += one.reloads;
    all.deaths += one.deaths;
    all.refused += one.refused;
    all.orders = std::max(all.orders, one.orders);
  }
  std::printf(
      "%llu steps, %llu scans recorded and %llu thrown away, %llu views, %llu reloads, %llu deaths, %llu scans "
      "refused by measuring; the last "
      "slab took at most %d orders\n",
      static_cast<unsigned long long>(all.steps), static_cast<unsigned long long>(all.scans_recorded),
      static_cast<unsigned long long>(all.scans_thrown_away), static_cast<unsigned long long>(all.views_asked),
      static_cast<unsigned long long>(all.reloads), static_cast<unsigned long long>(all.deaths),
      static_cast<unsigned long long>(all.refused), all.orders);
  if (seeds < 100) return;
  // A line without events would meet every condition, so minimum counts are required.
  EXPECT_GT(all.scans_recorded, 10 * seeds);
  EXPECT_GT(all.scans_thrown_away, seeds);
  EXPECT_GT(all.deaths, seeds);
  EXPECT_GT(all.refused, seeds / 4);
  EXPECT_GT(all.views_asked, seeds / 4);
  EXPECT_GT(all.reloads, seeds / 50);
}

TEST(StationTruth, a_seed_is_one_line) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    std::array<TruthLine::Figures, 2> figures;
    for (TruthLine::Figures& one : figures) {
      TruthLine line(seed);
      line.live(kTurns);
      one = line.figures();
    }
    EXPECT_EQ(figures[0], figures[1]) << "seed " << seed;
  }
}

}  // namespace
}  // namespace slabd::daemon
