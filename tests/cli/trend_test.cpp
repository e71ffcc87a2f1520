// SPDX-License-Identifier: Apache-2.0
//
// Trends of planted slabs: each picture and each figure says what happened, and none contradicts the verdicts.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "base/prng.h"
#include "cli/trend/comparison.h"
#include "cli/trend/multi_vari.h"
#include "cli/trend/trend_figure.h"
#include "planted_item.h"

namespace slabd::cli::trend {
namespace {

using study::Judgement;

/// `slabs` slabs of three blocks; block 3 has the offset `off`.
std::vector<storage::ItemValue> values(int slabs, double off) {
  std::vector<storage::ItemValue> list;
  for (int slab = 1; slab <= slabs; ++slab)
    for (int station = 1; station <= 3; ++station) {
      storage::ItemValue value;
      value.slab_key = slab;
      value.item = item_of(ItemId::seat_slope, station, 1.4 + 0.001 * (slab % 3) + (station == 3 ? off : 0.0));
      list.push_back(value);
    }
  return list;
}

TEST(Trend, capability_is_that_of_the_worst_block_and_not_of_all_together) {
  const Trend trend = trend_of(ItemId::seat_slope, 0, values(60, 0.2));
  EXPECT_EQ(trend.capable_block, 3);
  EXPECT_LT(trend.capable.cpk.value, 0.0) << "every value of block 3 lies outside";
  EXPECT_EQ(trend.singles.count, 60U);
}

TEST(Trend, a_slab_with_a_block_missing_is_not_a_shift_of_the_mean) {
  std::vector<storage::ItemValue> list = values(60, 0.05);
  list.erase(list.begin() + 3 * 40 + 2);
  const Trend trend = trend_of(ItemId::seat_slope, 0, list);
  EXPECT_EQ(trend.incomplete, 1U);
  EXPECT_EQ(trend.chart.count, 59U);
  for (const Signal signal : trend.chart.signals) EXPECT_EQ(signal, Signal::none);
  ASSERT_EQ(trend.points.size(), 60U) << "the slab stays in the chart";
  EXPECT_EQ(trend.points[40].blocks, 2U);
  EXPECT_FALSE(has_value(trend.points[40].value)) << "the mean of two blocks is another quantity";
  EXPECT_TRUE(has_value(trend.points[40].highest));
}

TEST(Trend, values_judged_by_other_limits_are_left_out_and_counted) {
  std::vector<storage::ItemValue> list = values(60, 0.0);
  for (std::size_t i = 0; i < 30; ++i) list[i].item.upper = 1.6;
  const Trend trend = trend_of(ItemId::seat_slope, 0, list);
  EXPECT_EQ(trend.other_limits, 30U);
  EXPECT_EQ(trend.chart.count, 50U);
  EXPECT_EQ(trend.upper, 1.5);
}

TEST(Trend, limits_of_the_newest_slab_count_also_for_a_block_that_it_lacks) {
  std::vector<storage::ItemValue> list = values(60, 0.0);
  for (std::size_t i = 3 * 30; i < list.size(); ++i) list[i].item.upper = 1.6;  // a new recipe
  std::erase_if(list, [](const storage::ItemValue& v) { return v.slab_key > 30 && v.item.station == 3; });
  storage::ItemValue unseen;
  unseen.slab_key = 60;
  unseen.item = Item();
  unseen.item.station = 3;
  unseen.item.verdict = Verdict::not_measured;
  list.push_back(unseen);
  const Trend trend = trend_of(ItemId::seat_slope, 0, list);
  EXPECT_EQ(trend.other_limits, 90U);
  EXPECT_EQ(trend.not_measured, 1U);
  EXPECT_EQ(trend.upper, 1.6);
}

TEST(Trend, a_block_is_capable_by_its_own_limits) {
  std::vector<storage::ItemValue> list = values(60, 0.2);
  for (storage::ItemValue& value : list)
    if (value.item.station == 3) value.item.upper = 1.9;  // so that it is within its limits
  const Trend trend = trend_of(ItemId::seat_slope, 0, list);
  EXPECT_EQ(trend.other_limits, 0U);
  EXPECT_GT(trend.capable.cpk.value, 1.0);
  EXPECT_TRUE(trend.limits_differ) << "no pair of limits is that of all blocks";
  EXPECT_FALSE(trend_of(ItemId::seat_slope, 0, values(60, 0.2)).limits_differ);
}

TEST(Trend, capability_is_empty_while_the_chart_is_preliminary) {
  std::vector<storage::ItemValue> list = values(60, 0.2);
  std::erase_if(list, [](const storage::ItemValue& v) { return v.slab_key > 20 && v.item.station == 1; });
  const Trend trend = trend_of(ItemId::seat_slope, 0, list);
  EXPECT_TRUE(trend.chart.preliminary());
  EXPECT_FALSE(has_value(trend.capable.cp.value));
  EXPECT_FALSE(has_value(trend.capable.cpk.value)) << "though a block has 60 values";
}

TEST(Trend, the_document_says_what_was_left_out_and_whose_capability_it_is) {
  std::vector<storage::ItemValue> list = values(60, 0.2);
  for (storage::ItemValue& value : list) value.slab_type = 5600;
  for (std::size_t i = 0; i < 9; ++i) list[i].item.upper = 1.6;
  for (std::size_t i = 9; i < 12; ++i) list[i].item.value = kNoValue;  // one whole slab
  list[12].item.value = kNoValue;                                      // and one block
  const Trend trend = trend_of(ItemId::seat_slope, 0, list);
  EXPECT_EQ(trend.slab_type, 5600);
  EXPECT_EQ(trend.incomplete, 2U);
  for (const report::Language language : {report::Language::en, report::Language::zh}) {
    const std::string html = report::html(document_of(trend, language));
    const bool zh = language == report::Language::zh;
    for (const std::string text :
         {zh ? "限值与最新板不同的数值</th><td class=\"words\">9<"
             : "other limits than the newest</th><td class=\"words\">9<",
          zh ? "缺少承轨台数值的板</th><td class=\"words\">2<" : "block's value missing</th><td class=\"words\">2<",
          zh ? "最差的承轨台 3，56 个数值" : "block 3, the worst, 56 values", "5600"})
      EXPECT_NE(html.find(text), std::string::npos) << text;
    EXPECT_EQ(html.find("<p class=\"verdict"), std::string::npos) << "it is about no single slab";
  }
}

TEST(Trend, a_jump_is_a_signal_though_both_values_lie_within_the_limits) {
  std::vector<double> list;
  for (int i = 0; i < 60; ++i) list.push_back(0.1 * (i % 2));
  list[30] = -0.14;
  list[31] = 0.24;
  const Individuals chart = individuals(list);
  ASSERT_GT(0.38, chart.range_control);
  EXPECT_EQ(chart.signals[31], Signal::jump);
}

/// A line of `slabs` slabs of 18 blocks: jaw distances of 380 mm with limits of 0.5 mm; sigma 0.05 mm.
std::vector<storage::ItemValue> line_of(int slabs, std::uint64_t seed = 1) {
  Prng prng(seed);
  std::vector<storage::ItemValue> list;
  for (int slab = 1; slab <= slabs; ++slab)
    for (int station = 1; station <= 18; ++station) {
      storage::ItemValue value;
      value.slab_key = slab;
      value.slab_id.assign("S-" + std::to_string(slab));
      value.slab_type = 5600;
      value.began_utime_us = 1'763'681'281'000'000 + 600'000'000LL * slab;
      value.item = item_of(ItemId::jaw_distance, station, 380.0 + 0.05 * prng.normal());
      value.item.nominal = 380.0;
      value.item.lower = 379.5;
      value.item.upper = 380.5;
      list.push_back(value);
    }
  return list;
}
Item& at(std::vector<storage::ItemValue>& list, int slab, int station) {
  return list[static_cast<std::size_t>(18 * (slab - 1) + station - 1)].item;
}
std::string document_text(const Trend& trend) {
  return report::html(document_of(trend, report::Language::en));
}

TEST(Planted, a_good_line_is_capable_and_has_nothing_outside) {
  const Trend trend = trend_of(ItemId::jaw_distance, 0, line_of(100));
  EXPECT_EQ(trend.judgement, Judgement::capable) << judgement_reason(trend, report::Language::en);
  EXPECT_EQ(trend.whole.model, Model::normal);
  EXPECT_NEAR(trend.whole.ppk.value, 0.5 / 0.15, 0.2);
  EXPECT_EQ(trend.whole.outside.count, 0U);
  EXPECT_LT(trend.whole.outside.share.high, 0.003);
}

TEST(Planted, good_lines_are_capable_although_chance_gives_some_signals) {
  int capable = 0;
  std::size_t signals = 0;
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    const Trend trend = trend_of(ItemId::jaw_distance, 0, line_of(100, seed));
    capable += trend.judgement == Judgement::capable ? 1 : 0;
    signals += trend.signals();
  }
  EXPECT_GE(capable, 46);
  EXPECT_LT(static_cast<double>(signals), kSignalsByChance * 50.0 * 100.0);
}

TEST(Planted, one_block_0_8_mm_off_is_named_and_the_line_is_not_capable) {
  std::vector<storage::ItemValue> list = line_of(100);
  at(list, 57, 11).value += 0.8;
  at(list, 57, 11).verdict = Verdict::fail;
  const Trend trend = trend_of(ItemId::jaw_distance, 0, list);
  EXPECT_NE(trend.judgement, Judgement::capable);
  EXPECT_EQ(trend.whole.model, Model::percentiles) << "one value of 1800 makes the distribution another one";
  EXPECT_LT(trend.whole.ppk.value, 1.2) << "as good as one value of 1800 outside permits";
  ASSERT_EQ(trend.outside.size(), 1U);
  EXPECT_EQ(trend.outside[0].key, 57);
  EXPECT_EQ(trend.outside[0].item.station, 11);
  EXPECT_EQ(trend.points[56].outside, 1U);
  EXPECT_NEAR(trend.points[56].highest, 380.8, 0.2);
  const std::string html = document_text(trend);
  for (const char* text : {"slab 57 &quot;S-57&quot;, block 11: 380.", "1 of 1800 values outside the limits"})
    EXPECT_NE(html.find(text), std::string::npos) << text;
  EXPECT_EQ(html.find(">capable"), std::string::npos);
}

TEST(Planted, the_same_block_in_a_chart_of_its_own_has_a_performance_below_one) {
  std::vector<storage::ItemValue> list = line_of(100);
  at(list, 57, 11).value += 0.8;
  std::erase_if(list, [](const storage::ItemValue& v) { return v.item.station != 11; });
  const Trend trend = trend_of(ItemId::jaw_distance, 11, list);
  EXPECT_GT(trend.capable.cpk.value, 1.33) << "the scatter from slab to slab hardly sees it";
  EXPECT_LT(trend.whole.ppk.value, 1.0) << "one value lies outside";
  EXPECT_EQ(trend.judgement, Judgement::not_capable);
  EXPECT_EQ(trend.points[56].signal, Signal::beyond_limits);
}

TEST(Planted, a_drift_and_a_shift_change_are_named_by_rule_and_slab) {
  for (const bool drift : {true, false}) {
    std::vector<storage::ItemValue> list = line_of(80);
    for (storage::ItemValue& value : list)
      value.item.value += drift ? 0.001 * static_cast<double>(value.slab_key) : value.slab_key > 40 ? 0.05 : 0.0;
    const Trend trend = trend_of(ItemId::jaw_distance, 0, list);
    EXPECT_GT(trend.signals(), 10U);
    EXPECT_NE(trend.judgement, Judgement::capable);
    const std::vector<std::string> lines = signal_lines(trend, report::Language::en);
    const auto names = [&](const std::string& text) {
      return std::any_of(lines.begin(), lines.end(),
                         [&](const std::string& line) { return line.find(text) != std::string::npos; });
    };
    EXPECT_TRUE(names("beyond the control limits: slab ") || names("nine in a row on one side of the mean: slab "));
    EXPECT_NE(document_text(trend).find("Signals of the control chart"), std::string::npos);
  }
}

TEST(Planted, four_moulds_as_one_part_are_not_a_normal_distribution) {
  std::vector<storage::ItemValue> list = line_of(100);
  for (storage::ItemValue& value : list) value.item.value += 0.2 * (static_cast<double>(value.slab_key % 4) - 1.5);
  const Trend trend = trend_of(ItemId::jaw_distance, 0, list);
  EXPECT_EQ(trend.whole.model, Model::percentiles);
  EXPECT_LT(trend.whole.p, kFitLevel);
  EXPECT_NE(trend.judgement, Judgement::capable);
}

TEST(Planted, a_flatness_has_no_negative_lower_limit_and_a_fitted_distribution) {
  Prng prng(5);
  std::vector<storage::ItemValue> list = line_of(100);
  for (storage::ItemValue& value : list) {
    value.item.id = ItemId::seat_flatness;
    value.item.value = 0.03 * std::exp(0.5 * prng.normal());
    value.item.nominal = 0.0;
    value.item.lower = kNoValue;
    value.item.upper = 0.3;
  }
  const Trend trend = trend_of(ItemId::seat_flatness, 0, list);
  EXPECT_FALSE(trend.chart.lower_control < 0.0);
  EXPECT_EQ(trend.whole.model, Model::lognormal);
  EXPECT_FALSE(has_value(trend.whole.pp.value)) << "one limit only";
  EXPECT_NEAR(trend.whole.ppk.value, std::log(10.0) / 1.5, 0.15);
  std::erase_if(list, [](const storage::ItemValue& v) { return v.item.station != 7; });
  EXPECT_FALSE(trend_of(ItemId::seat_flatness, 7, list).chart.lower_control < 0.0);
}

TEST(Planted, seat_positions_show_the_largest_deviation_and_not_a_mean_of_zero) {
  std::vector<storage::ItemValue> list = line_of(60);
  for (storage::ItemValue& value : list) {
    value.item.id = ItemId::seat_vertical;
    value.item.value -= 380.0;
    value.item.nominal = 0.0;
    value.item.lower = -0.5;
    value.item.upper = 0.5;
  }
  at(list, 30, 4).value = -0.45;
  const Trend trend = trend_of(ItemId::seat_vertical, 0, list);
  EXPECT_EQ(trend.value_is, ValueIs::largest);
  EXPECT_DOUBLE_EQ(trend.points[29].value, 0.45);
  EXPECT_EQ(trend.points[29].signal, Signal::beyond_limits);
  EXPECT_GT(trend.chart.mean, 0.05);
  EXPECT_FALSE(trend.chart.lower_control < 0.0);
}

TEST(Planted, the_capability_table_has_a_row_for_each_item_with_its_judgement) {
  std::vector<storage::ItemValue> bad = line_of(50, 2);
  for (const int slab : {3, 20, 41}) at(bad, slab, 4).value = 381.0;
  const std::vector<Trend> trends = {trend_of(ItemId::jaw_distance, 0, line_of(50)),
                                     trend_of(ItemId::jaw_distance, 0, bad)};
  for (const report::Language language : {report::Language::en, report::Language::zh}) {
    const report::Table table = capability_table(trends, language);
    ASSERT_EQ(table.rows.size(), 2U);
    EXPECT_EQ(report::verdict_of(table.rows[0]), Verdict::pass);
    EXPECT_EQ(report::verdict_of(table.rows[1]), Verdict::fail);
    EXPECT_EQ(table.rows[1][2].text, "3 / 900");
    EXPECT_NE(report::html(document_of(trends, language)).find("3 / 900"), std::string::npos);
  }
}

TEST(MultiVari, separates_a_mould_a_slab_and_the_rest) {
  const std::vector<storage::ItemValue> good = line_of(100);
  EXPECT_GT(sources_of(trend_of(ItemId::jaw_distance, 0, good)).rest, 0.9);
  std::vector<storage::ItemValue> mould = good;
  std::vector<storage::ItemValue> slab = good;
  for (storage::ItemValue& value : mould) value.item.value += 0.1 * (value.item.station % 3);
  for (storage::ItemValue& value : slab) value.item.value += 0.1 * static_cast<double>(value.slab_key % 4);
  const Sources of_mould = sources_of(trend_of(ItemId::jaw_distance, 0, mould));
  // Variances: 0.0067 (mean square deviation of 0, 0.1 and 0.2) times 18 / 17, and 0.0025.
  EXPECT_NEAR(of_mould.blocks, 0.0071 / (0.0071 + 0.0025), 0.04);
  EXPECT_LT(of_mould.slabs, 0.03);
  const Sources of_slab = sources_of(trend_of(ItemId::jaw_distance, 0, slab));
  EXPECT_GT(of_slab.slabs, 0.75);
  EXPECT_LT(of_slab.blocks, 0.03);
  EXPECT_FALSE(has_value(sources_of(trend_of(ItemId::jaw_distance, 0, line_of(2))).rest)) << "two slabs";
}

TEST(MultiVari, is_in_the_document_with_every_block) {
  std::vector<storage::ItemValue> list = line_of(60);
  list.erase(list.begin() + 18 * 30 + 5);  // a missing block
  const Trend trend = trend_of(ItemId::jaw_distance, 0, list);
  const report::Figure figure = multi_vari_figure(trend, report::Language::en);
  for (int station = 1; station <= 18; ++station)
    EXPECT_NE(figure.alt.find(" " + std::to_string(station) + ": 3"), std::string::npos) << figure.alt;
  EXPECT_NE(document_text(trend).find("Multi-vari"), std::string::npos);
}

TEST(Comparison, between_two_slabs_names_the_place_that_differs_by_more_than_U) {
  std::vector<Item> a;
  for (int station = 1; station <= 18; ++station) {
    Item item = item_of(ItemId::jaw_distance, station, 380.0);
    item.U = 0.05;
    a.push_back(item);
  }
  std::vector<Item> b = a;
  b[10].value += 0.8;
  b[3].value += 0.05;
  b[5].value = kNoValue;
  const std::vector<PlaceDifference> places = differences_of(a, b);
  ASSERT_EQ(places.size(), 18U);
  EXPECT_EQ(places[0].a.station, 11);
  EXPECT_NEAR(places[0].difference, 0.8, 1e-9);
  EXPECT_NEAR(places[0].en, 0.8 / (0.05 * std::sqrt(2.0)), 1e-9);
  EXPECT_EQ(std::count_if(places.begin(), places.end(), [](const PlaceDifference& p) { return p.differs(); }), 1);
  EXPECT_EQ(places.back().a.station, 6) << "not measured";
}

TEST(Comparison, between_two_periods_proves_a_shift_and_not_the_scatter) {
  const auto of = [](double shift, std::uint64_t seed) {
    std::vector<storage::ItemValue> list = line_of(40, seed);
    for (storage::ItemValue& value : list) value.item.value += shift;
    return trend_of(ItemId::jaw_distance, 0, list);
  };
  const PeriodDifference shifted = difference_of(of(0.0, 1), of(0.05, 2), 20);
  EXPECT_TRUE(shifted.differs());
  EXPECT_NEAR(shifted.difference.value, 0.05, 0.01);
  int proven = 0;
  for (std::uint64_t seed = 3; seed < 103; ++seed) proven += difference_of(of(0.0, 1), of(0.0, seed), 1).differs();
  EXPECT_LE(proven, 20) << "5 of 100 by chance, and the first period is the same in all";
  EXPECT_FALSE(has_value(difference_of(of(0.0, 1), trend_of(ItemId::jaw_distance, 0, line_of(1)), 1).difference.low));
}

}  // namespace
}  // namespace slabd::cli::trend
