// SPDX-License-Identifier: Apache-2.0
#include "cli/trend/yield.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <ctime>

#include "report/content.h"

namespace slabd::cli::trend {
namespace {

/// Sets the time zone of the process.
class Yield : public ::testing::Test {
 protected:
  Yield() { zone("UTC0"); }
  ~Yield() override { zone("UTC0"); }
  static void zone(const char* name) {
    setenv("TZ", name, 1);
    tzset();
  }
  void add(std::int64_t began_s, Verdict verdict, std::uint16_t reason = 0, int type = 5600) {
    storage::Inspection slab;
    slab.slab_type = static_cast<std::uint16_t>(type);
    slab.began_utime_us = 1'000'000 * began_s;
    slab.verdict = verdict;
    slab.reason = reason;
    slabs_.push_back(slab);
  }
  [[nodiscard]] std::vector<YieldGroup> groups(GroupBy by) const {
    return first_pass_yield(slabs_, by, parse_shifts("06:00,14:00,22:00").value());
  }
  static constexpr std::int64_t kDay = 1'763'683'200;  // 2025-11-21T00:00:00Z
  std::vector<storage::Inspection> slabs_;
};

TEST_F(Yield, counts_a_slab_once_at_its_first_inspection_that_was_not_aborted) {
  add(kDay + 3600, Verdict::aborted, 110);
  add(kDay + 7200, Verdict::fail, 604);
  add(kDay + 9000, Verdict::pass);
  slabs_.back().again = true;
  add(kDay + 10000, Verdict::pass);
  add(kDay + 11000, Verdict::indeterminate, 604);
  add(kDay + 12000, Verdict::not_measured, 402);
  const std::vector<YieldGroup> days = groups(GroupBy::day);
  ASSERT_EQ(days.size(), 1U);
  EXPECT_EQ(days[0].name, "2025-11-21");
  EXPECT_EQ(days[0].inspected, 4U);
  EXPECT_EQ(days[0].passed, 1U);
  EXPECT_EQ(days[0].failed, 1U);
  EXPECT_EQ(days[0].undecided, 1U);
  EXPECT_EQ(days[0].not_measured, 1U);
  EXPECT_EQ(days[0].aborted, 1U);
  EXPECT_EQ(days[0].again, 1U);
  EXPECT_DOUBLE_EQ(days[0].yield.value, 0.25);
  EXPECT_EQ(days[0].reasons.at(604), 2U);
}

TEST_F(Yield, a_shift_over_midnight_belongs_to_the_day_of_its_begin_in_local_time) {
  add(kDay + 3600, Verdict::pass);            // 01:00
  add(kDay + 6 * 3600, Verdict::pass);        // 06:00
  add(kDay + 22 * 3600 - 60, Verdict::pass);  // 21:59
  add(kDay + 22 * 3600, Verdict::fail, 600);  // 22:00
  std::vector<YieldGroup> shifts = groups(GroupBy::shift);
  ASSERT_EQ(shifts.size(), 4U);
  EXPECT_EQ(shifts[0].name, "2025-11-20 22:00-06:00");
  EXPECT_EQ(shifts[1].name, "2025-11-21 06:00-14:00");
  EXPECT_EQ(shifts[2].name, "2025-11-21 14:00-22:00");
  EXPECT_EQ(shifts[3].name, "2025-11-21 22:00-06:00");
  zone("CST-8");  // eight hours ahead of UTC
  shifts = groups(GroupBy::shift);
  EXPECT_EQ(shifts[0].name, "2025-11-21 06:00-14:00");
  EXPECT_EQ(groups(GroupBy::day).size(), 2U);
}

TEST_F(Yield, types_are_separate_and_the_total_is_their_sum) {
  add(kDay, Verdict::pass, 0, 5600);
  add(kDay, Verdict::fail, 604, 4925);
  add(kDay, Verdict::pass, 0, 5600);
  const std::vector<YieldGroup> types = groups(GroupBy::type);
  ASSERT_EQ(types.size(), 2U);
  EXPECT_EQ(types[0].name, "4925");
  EXPECT_EQ(types[1].name, "5600");
  EXPECT_EQ(types[1].passed, 2U);
  const YieldGroup total = total_of(types);
  EXPECT_EQ(total.inspected, 3U);
  EXPECT_NEAR(total.yield.value, 2.0 / 3.0, 1e-12);
}

TEST_F(Yield, moulds_are_in_the_order_of_their_numbers_and_an_unknown_one_is_0) {
  for (const int mould : {12, 3, 0, 3}) {
    add(kDay, mould == 3 ? Verdict::fail : Verdict::pass, mould == 3 ? 604 : 0);
    slabs_.back().mould = static_cast<std::uint16_t>(mould);
  }
  const std::vector<YieldGroup> moulds = groups(GroupBy::mould);
  ASSERT_EQ(moulds.size(), 3U);
  EXPECT_EQ(moulds[0].name, "0");
  EXPECT_EQ(moulds[1].name, "3");
  EXPECT_EQ(moulds[1].failed, 2U);
  EXPECT_EQ(moulds[2].name, "12");
  EXPECT_EQ(moulds[2].passed, 1U);
}

TEST(Shifts, rise_and_are_times_of_the_day) {
  EXPECT_EQ(parse_shifts("05:30").value(), Shifts{330});
  EXPECT_EQ(parse_shifts("06:00,18:00").value(), (Shifts{360, 1080}));
  for (const char* wrong : {"", "6", "24:00", "06:60", "14:00,06:00", "06:00,06:00", "06:00,", "06:00 14:00", "-1:00"})
    EXPECT_FALSE(parse_shifts(wrong).ok()) << wrong;
}

TEST(Pareto, orders_the_reasons_and_adds_the_rest) {
  std::vector<ParetoBar> bars;
  for (std::size_t i = 1; i <= 20; ++i) bars.push_back({"reason " + std::to_string(i), i, 1});
  const report::Figure figure = pareto_figure(bars, report::Language::en);
  EXPECT_EQ(figure.alt.find("Pareto of the reasons: reason 20: 21; reason 19: 20;"), 0U) << figure.alt;
  EXPECT_NE(figure.alt.find("all others: 54;"), std::string::npos) << figure.alt;
  EXPECT_FALSE(report::svg_of(figure, "a").empty());
  EXPECT_FALSE(report::svg_of(pareto_figure({}, report::Language::zh), "b").empty()) << "without reasons";
}

}  // namespace
}  // namespace slabd::cli::trend
