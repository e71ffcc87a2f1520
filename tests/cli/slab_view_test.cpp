// SPDX-License-Identifier: Apache-2.0
#include "cli/slab_view.h"

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

TEST(SlabView, what_the_slab_made_of_a_blocks_item_takes_its_place) {
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

TEST(SlabView, what_is_for_information_takes_the_place_of_nothing) {
  storage::SlabRecord record;
  Item in_slab = item_of(ItemId::seat_slope, 5, 1.49);
  in_slab.lower = in_slab.upper = kNoValue;
  in_slab.verdict = Verdict::none;
  ASSERT_TRUE(record.slab.items.push(in_slab));
  EXPECT_EQ(final_item(record, 5, item_of(ItemId::seat_slope, 5, 1.52)).value, 1.52);
}

TEST(SlabView, a_name_says_whether_it_is_a_key_or_an_id) {
  EXPECT_EQ(slab_name("12").key, 12);
  EXPECT_EQ(slab_name("12").id, "12");
  EXPECT_EQ(slab_name("key:12").key, 12);
  EXPECT_EQ(slab_name("key:12").id, "");
  EXPECT_EQ(slab_name("id:12").key, std::nullopt);
  EXPECT_EQ(slab_name("id:12").id, "12");
  EXPECT_EQ(slab_name("LINE-12").key, std::nullopt);
  EXPECT_EQ(slab_name("key:LINE").key, std::nullopt);
}

/// `slabs` slabs of three blocks; block 3 lies off.
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

TEST(Trend, a_slab_with_a_block_missing_is_no_shift_of_the_mean) {
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
