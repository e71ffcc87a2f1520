// SPDX-License-Identifier: Apache-2.0
#include "base/items.h"

#include <gtest/gtest.h>

#include <vector>

namespace slabd {
namespace {

Item item(double value, double lower, double upper, double U) {
  Item i;
  i.value = value;
  i.lower = lower;
  i.upper = upper;
  i.U = U;
  i.nominal = 0.0;
  return i;
}

TEST(Judge, guard_band_makes_three_answers) {
  EXPECT_EQ(judge(item(0.30, -0.5, 0.5, 0.15), 1.0), Verdict::pass);
  EXPECT_EQ(judge(item(0.35, -0.5, 0.5, 0.15), 1.0), Verdict::pass);
  EXPECT_EQ(judge(item(0.36, -0.5, 0.5, 0.15), 1.0), Verdict::indeterminate);
  EXPECT_EQ(judge(item(0.64, -0.5, 0.5, 0.15), 1.0), Verdict::indeterminate);
  EXPECT_EQ(judge(item(0.66, -0.5, 0.5, 0.15), 1.0), Verdict::fail);
  EXPECT_EQ(judge(item(-0.66, -0.5, 0.5, 0.15), 1.0), Verdict::fail);
}

TEST(Judge, simple_acceptance_has_no_middle) {
  EXPECT_EQ(judge(item(0.49, -0.5, 0.5, 0.15), 0.0), Verdict::pass);
  EXPECT_EQ(judge(item(0.51, -0.5, 0.5, 0.15), 0.0), Verdict::fail);
}

TEST(Judge, one_sided_limits_look_at_one_side) {
  EXPECT_EQ(judge(item(-40.0, kNoValue, 1.0, 0.05), 1.0), Verdict::pass);
  EXPECT_EQ(judge(item(1.2, kNoValue, 1.0, 0.05), 1.0), Verdict::fail);
}

TEST(Judge, an_unmeasured_item_is_never_a_pass) {
  EXPECT_EQ(judge(item(kNoValue, -0.5, 0.5, 0.15), 1.0), Verdict::not_measured);
  EXPECT_EQ(judge(item(std::numeric_limits<double>::infinity(), -0.5, 0.5, 0.15), 1.0), Verdict::not_measured);
  EXPECT_EQ(judge(item(0.0, -0.5, 0.5, kNoValue), 1.0), Verdict::indeterminate);
  EXPECT_EQ(judge(item(0.0, -0.5, 0.5, 0.0), 1.0), Verdict::indeterminate);
  EXPECT_EQ(judge(item(0.0, kNoValue, kNoValue, 0.1), 1.0), Verdict::none);
}

TEST(Judge, without_U_an_item_is_indeterminate_in_simple_acceptance_too) {
  for (const double U : {kNoValue, 0.0}) {
    EXPECT_EQ(judge(item(0.0, -0.5, 0.5, U), 0.0), Verdict::indeterminate);
    EXPECT_EQ(judge(item(0.6, -0.5, 0.5, U), 0.0), Verdict::indeterminate);
    EXPECT_EQ(judge(item(kNoValue, -0.5, 0.5, U), 0.0), Verdict::not_measured);
    EXPECT_EQ(judge(item(0.0, kNoValue, kNoValue, U), 0.0), Verdict::none);
  }
}

TEST(Conformance, probability_of_one_limit_as_in_jcgm_106) {
  // U = 2 u throughout. T17 and T18 of the usual worked examples.
  EXPECT_NEAR(conformance_probability(item(-5.47, kNoValue, -5.40, 0.10)), 0.919243, 5e-7);
  EXPECT_NEAR(conformance_probability(item(507.0, 490.0, kNoValue, 17.2)), 0.975965, 5e-7);
  EXPECT_NEAR(conformance_probability(item(0.290, kNoValue, 0.300, 0.020)), 0.84134, 5e-6);
  EXPECT_NEAR(conformance_probability(item(0.300, kNoValue, 0.300, 0.020)), 0.5, 1e-12);
  EXPECT_NEAR(conformance_probability(item(0.310, kNoValue, 0.300, 0.020)), 0.15866, 5e-6);
}

TEST(Conformance, probability_of_two_limits) {
  EXPECT_NEAR(conformance_probability(item(1.342, 1.3321, 1.5321, 0.020)), 0.838913, 5e-7);
  EXPECT_NEAR(conformance_probability(item(0.0, -0.5, 0.5, 1.0)), 0.6826895, 5e-8);
  // Far outside the limits the small probability stays exact.
  EXPECT_NEAR(1.0 - conformance_probability(item(0.4, -0.5, 0.5, 0.05)), 3.1671e-5, 1e-9);
  EXPECT_GE(conformance_probability(item(50.0, -0.5, 0.5, 0.1)), 0.0);
}

TEST(Conformance, is_unknown_without_value_limits_or_U) {
  EXPECT_TRUE(std::isnan(conformance_probability(item(kNoValue, -0.5, 0.5, 0.1))));
  EXPECT_TRUE(std::isnan(conformance_probability(item(0.0, kNoValue, kNoValue, 0.1))));
  EXPECT_TRUE(std::isnan(conformance_probability(item(0.0, -0.5, 0.5, kNoValue))));
  EXPECT_TRUE(std::isnan(conformance_probability(item(0.0, -0.5, 0.5, 0.0))));
}

TEST(Conformance, guard_band_of_U_keeps_a_pass_above_97_percent) {
  // At the guarded limit (r = 2 in units of u) the risk on one side is Phi(-2).
  const Item at_guard = item(0.5 - 0.15, -0.5, 0.5, 0.15);
  EXPECT_EQ(judge(at_guard, 1.0), Verdict::pass);
  EXPECT_NEAR(conformance_probability(at_guard), 0.97725, 5e-6);
}

Verdict combined(std::vector<std::pair<Verdict, bool>> list) {
  std::vector<Item> items;
  for (const auto& [verdict, required] : list) {
    Item i;
    i.verdict = verdict;
    i.required = required;
    items.push_back(i);
  }
  return combine(items.data(), items.data() + items.size());
}

TEST(Combine, fail_beats_not_measured_beats_indeterminate_beats_pass) {
  using V = Verdict;
  EXPECT_EQ(combined({{V::pass, true}, {V::not_measured, true}, {V::indeterminate, true}, {V::fail, false}}), V::fail);
  EXPECT_EQ(combined({{V::pass, true}, {V::not_measured, true}, {V::indeterminate, true}}), V::not_measured);
  EXPECT_EQ(combined({{V::pass, true}, {V::not_measured, false}, {V::indeterminate, true}}), V::indeterminate);
  EXPECT_EQ(combined({{V::pass, true}, {V::not_measured, false}, {V::none, false}}), V::pass);
}

TEST(Combine, emptiness_and_information_alone_never_pass) {
  using V = Verdict;
  EXPECT_EQ(combined({}), V::not_measured);
  EXPECT_EQ(combined({{V::none, false}}), V::not_measured);
  EXPECT_EQ(combined({{V::none, true}, {V::pass, true}}), V::not_measured);
  EXPECT_EQ(combined({{V::not_measured, false}}), V::not_measured);
}

TEST(Verdict, zeroed_memory_is_not_a_pass) {
  EXPECT_NE(static_cast<Verdict>(0), Verdict::pass);
}

TEST(Items, every_item_has_a_name_that_finds_it) {
  for (std::size_t i = 0; i < kItemCount; ++i) {
    const auto id = static_cast<ItemId>(i);
    EXPECT_EQ(info(id).id, id);
    ASSERT_TRUE(item_from_name(info(id).name).has_value());
    EXPECT_EQ(*item_from_name(info(id).name), id);
  }
  EXPECT_FALSE(item_from_name("seat_slop").has_value());
}

TEST(Judge, a_lower_limit_alone_looks_at_one_side) {
  EXPECT_EQ(judge(item(40.0, 1.0, kNoValue, 0.05), 1.0), Verdict::pass);
  EXPECT_EQ(judge(item(1.02, 1.0, kNoValue, 0.05), 1.0), Verdict::indeterminate);
  EXPECT_EQ(judge(item(0.98, 1.0, kNoValue, 0.05), 1.0), Verdict::indeterminate);
  EXPECT_EQ(judge(item(0.9, 1.0, kNoValue, 0.05), 1.0), Verdict::fail);
  EXPECT_EQ(judge(item(0.9, 1.0, kNoValue, 0.05), 0.0), Verdict::fail);
}

TEST(Conformance, is_unknown_with_an_endless_U) {
  EXPECT_TRUE(std::isnan(conformance_probability(item(0.0, -0.5, 0.5, std::numeric_limits<double>::infinity()))));
}

TEST(Verdict, every_one_has_a_word_of_its_own) {
  const std::vector<Verdict> all = {Verdict::none,         Verdict::pass,    Verdict::fail,
                                    Verdict::not_measured, Verdict::aborted, Verdict::indeterminate};
  std::vector<std::string_view> words;
  for (const Verdict v : all) words.push_back(name(v));
  EXPECT_EQ(words, (std::vector<std::string_view>{"none", "pass", "fail", "not_measured", "aborted", "indeterminate"}));
  EXPECT_EQ(name(static_cast<Verdict>(77)), "none") << "an invalid byte is not a pass";
}

TEST(Combine, a_verdict_that_is_none_is_missing_where_one_is_required) {
  std::vector<Item> items(2);
  items[0].verdict = Verdict::pass;
  items[1].verdict = Verdict::none;
  EXPECT_EQ(combine(items.data(), items.data() + 2), Verdict::pass);
  items[1].required = true;
  EXPECT_EQ(combine(items.data(), items.data() + 2), Verdict::not_measured);
  items[1].verdict = Verdict::aborted;
  EXPECT_EQ(combine(items.data(), items.data() + 2), Verdict::not_measured);
  items[1].required = false;
  items[1].verdict = static_cast<Verdict>(77);
  EXPECT_NE(combine(items.data() + 1, items.data() + 2), Verdict::pass);
}

TEST(Items, every_budget_part_and_companion_has_a_word) {
  std::vector<std::string_view> parts;
  for (std::size_t i = 0; i < kBudgetParts; ++i) parts.push_back(name(static_cast<BudgetPart>(i)));
  EXPECT_EQ(parts, (std::vector<std::string_view>{"fit", "noise", "scanner", "registration", "calibration", "robot",
                                                  "reference", "thermal", "gauge", "tie"}));
  EXPECT_EQ(name(ItemUnit::mm), "mm");
  EXPECT_EQ(name(ItemUnit::deg), "deg");
  EXPECT_EQ(info(ItemId::seat_slope).companion, "ratio_n");
  EXPECT_EQ(info(ItemId::seat_flatness).companion, "min_zone_mm");
  EXPECT_EQ(info(ItemId::seat_std).companion, "cells_mm");
  EXPECT_EQ(info(ItemId::seat_vertical).companion, "unremoved_mm");
  EXPECT_EQ(info(ItemId::corner_level).companion, "quarter_mm");
  EXPECT_EQ(info(ItemId::seat_lateral).companion, "");
}

}  // namespace
}  // namespace slabd
