// SPDX-License-Identifier: Apache-2.0
#include "report/slab_view.h"

#include <gtest/gtest.h>

#include <vector>

#include "cli/trend/trend_figure.h"

namespace slabd::cli {
namespace {

Item item_of(ItemId id, int station, double value) {
  Item item;
  item.id = id;
  item.station = static_cast<std::uint8_t>(station);
  item.value = value;
  item.nominal = 1.4;
  item.lower = 1.3;
  item.upper = 1.5;
  item.verdict = Verdict::pass;
  return item;
}

TEST(SlabView, result_of_the_slab_replaces_the_item_of_the_block) {
  storage::SlabRecord record;
  const Item own = item_of(ItemId::seat_slope, 5, 1.52);
  EXPECT_EQ(final_item(record, 5, own).value, 1.52) << "an open slab has only the block's";
  Item spacing = item_of(ItemId::seat_slope, 5, 9.0);
  spacing.station_to = 6;
  ASSERT_TRUE(record.slab.items.push(spacing));
  ASSERT_TRUE(record.slab.items.push(item_of(ItemId::seat_slope, 4, 1.0)));
  EXPECT_EQ(final_item(record, 5, own).value, 1.52);
  ASSERT_TRUE(record.slab.items.push(item_of(ItemId::seat_slope, 5, 1.49)));
  EXPECT_EQ(final_item(record, 5, own).value, 1.49);
  EXPECT_EQ(final_item(record, 5, item_of(ItemId::jaw_distance, 5, 380.0)).value, 380.0);
}

TEST(SlabView, an_item_for_information_does_not_replace_any_item) {
  storage::SlabRecord record;
  Item in_slab = item_of(ItemId::seat_slope, 5, 1.49);
  in_slab.lower = in_slab.upper = kNoValue;
  in_slab.verdict = Verdict::none;
  ASSERT_TRUE(record.slab.items.push(in_slab));
  EXPECT_EQ(final_item(record, 5, item_of(ItemId::seat_slope, 5, 1.52)).value, 1.52);
}

TEST(SlabView, the_budget_is_that_of_the_item_that_was_judged) {
  storage::SlabRecord record;
  record.summary.header.stations = 1;
  storage::SlabBlock block;
  block.attempt.station = 1;
  block.phase = StationPhase::measured;
  const auto with_U = [](ItemId id, double U) {
    Item item = item_of(id, 1, 1.43);
    item.U = U;
    item.budget[0] = 0.5 * U;
    return item;
  };
  ASSERT_TRUE(block.block.items.push(with_U(ItemId::seat_slope, 0.02)));
  record.blocks.push_back(block);
  Item in_slab = with_U(ItemId::seat_slope, 0.01);
  in_slab.lower = in_slab.upper = kNoValue;  // for information: the slab top beside the seat is the datum
  ASSERT_TRUE(record.slab.items.push(in_slab));
  ASSERT_TRUE(record.slab.items.push(with_U(ItemId::seat_lateral, 0.3)));
  auto table = report::budget_table(record, report::Language::en);
  ASSERT_TRUE(table);
  ASSERT_EQ(table->rows.size(), 2U);
  EXPECT_EQ(table->rows[0][3].text, "0.0200");
  EXPECT_EQ(table->rows[1][3].text, "0.300");
  record.slab.items[0].upper = 1.5;  // the slab's frame is the datum
  table = report::budget_table(record, report::Language::en);
  EXPECT_EQ(table->rows[0][3].text, "0.0100");
}

TEST(SlabView, a_name_says_whether_it_is_a_key_or_an_id) {
  EXPECT_EQ(slab_name("12").key, 12);
  EXPECT_EQ(slab_name("12").id, "12");
  EXPECT_EQ(slab_name("key:12").key, 12);
  EXPECT_EQ(slab_name("key:12").id, "");
  EXPECT_EQ(slab_name("id:12").key, std::nullopt);
  EXPECT_EQ(slab_name("id:12").id, "12");
  EXPECT_EQ(slab_name("0012").key, std::nullopt) << "as a works numbers its slabs";
  EXPECT_EQ(slab_name("0012").id, "0012");
  EXPECT_EQ(slab_name("key:0012").key, 12);
  EXPECT_EQ(slab_name("LINE-12").key, std::nullopt);
  EXPECT_EQ(slab_name("key:LINE").key, std::nullopt);
  EXPECT_EQ(slab_name("12").no, 12U) << "where neither key nor id is there";
  EXPECT_EQ(slab_name("no:12").no, 12U);
  for (const std::string& padded : {std::string("S-1   "), std::string("  S-1\t"), std::string("S-1\0\0", 5),
                                    std::string("\0S-1 \0", 6), std::string("id: S-1 "), std::string(" id:S-1")})
    EXPECT_EQ(slab_name(padded).id, "S-1") << "as copied from a PLC";
  EXPECT_EQ(slab_name("12  ").key, 12);
  EXPECT_EQ(slab_name("A B").id, "A B");
  EXPECT_EQ(slab_name("   ").id, "");
  EXPECT_EQ(slab_name("no:12").key, std::nullopt);
  EXPECT_EQ(slab_name("no:12").id, "");
  EXPECT_EQ(slab_name("key:12").no, std::nullopt);
  EXPECT_EQ(slab_name("id:12").no, std::nullopt);
}

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
  const trend::Trend trend = trend::trend_of(ItemId::seat_slope, 0, values(60, 0.2));
  EXPECT_EQ(trend.capable_block, 3);
  EXPECT_LT(trend.capable.cpk.value, 0.0) << "every value of block 3 lies outside";
  EXPECT_EQ(trend.singles.count, 60U);
}

TEST(Trend, a_slab_with_a_block_missing_is_not_a_shift_of_the_mean) {
  std::vector<storage::ItemValue> list = values(60, 0.05);
  list.erase(list.begin() + 3 * 40 + 2);
  const trend::Trend trend = trend::trend_of(ItemId::seat_slope, 0, list);
  EXPECT_EQ(trend.incomplete, 1U);
  EXPECT_EQ(trend.chart.count, 59U);
  for (const trend::Signal signal : trend.chart.signals) EXPECT_EQ(signal, trend::Signal::none);
}

TEST(Trend, values_judged_by_other_limits_are_left_out_and_counted) {
  std::vector<storage::ItemValue> list = values(60, 0.0);
  for (std::size_t i = 0; i < 30; ++i) list[i].item.upper = 1.6;
  const trend::Trend trend = trend::trend_of(ItemId::seat_slope, 0, list);
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
  const trend::Trend trend = trend::trend_of(ItemId::seat_slope, 0, list);
  EXPECT_EQ(trend.other_limits, 90U);
  EXPECT_EQ(trend.not_measured, 1U);
  EXPECT_EQ(trend.upper, 1.6);
}

TEST(Trend, a_block_is_capable_by_its_own_limits) {
  std::vector<storage::ItemValue> list = values(60, 0.2);
  for (storage::ItemValue& value : list)
    if (value.item.station == 3) value.item.upper = 1.9;  // so that it is within its limits
  const trend::Trend trend = trend::trend_of(ItemId::seat_slope, 0, list);
  EXPECT_EQ(trend.other_limits, 0U);
  EXPECT_GT(trend.capable.cpk.value, 1.0);
}

TEST(Trend, capability_is_empty_while_the_chart_is_preliminary) {
  std::vector<storage::ItemValue> list = values(60, 0.2);
  std::erase_if(list, [](const storage::ItemValue& v) { return v.slab_key > 20 && v.item.station == 1; });
  const trend::Trend trend = trend::trend_of(ItemId::seat_slope, 0, list);
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
  const trend::Trend trend = trend::trend_of(ItemId::seat_slope, 0, list);
  EXPECT_EQ(trend.slab_type, 5600);
  EXPECT_EQ(trend.incomplete, 2U);
  for (const report::Language language : {report::Language::en, report::Language::zh}) {
    const std::string html = report::html(trend::document_of(trend, language));
    const bool zh = language == report::Language::zh;
    for (const std::string text : {zh ? "限值与最新板不同的数值</th><td>9<" : "other limits than the newest</th><td>9<",
                                   zh ? "缺少承轨台数值的板</th><td>2<" : "block's value missing</th><td>2<",
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
  const trend::Individuals chart = trend::individuals(list);
  ASSERT_GT(0.38, chart.range_control);
  EXPECT_EQ(chart.signals[31], trend::Signal::jump);
}

}  // namespace
}  // namespace slabd::cli
