// SPDX-License-Identifier: Apache-2.0
#include "report/slab_view.h"

#include <gtest/gtest.h>

#include <vector>

#include "planted_item.h"
#include "report/content.h"

namespace slabd::cli {
namespace {

TEST(SlabView, result_of_the_slab_replaces_the_item_of_the_block) {
  storage::SlabRecord record;
  const Item own = item_of(ItemId::seat_slope, 5, 1.52);
  EXPECT_EQ(report::final_item(record, 5, own).value, 1.52) << "an open slab has only the block's";
  Item spacing = item_of(ItemId::seat_slope, 5, 9.0);
  spacing.station_to = 6;
  ASSERT_TRUE(record.slab.items.push(spacing));
  ASSERT_TRUE(record.slab.items.push(item_of(ItemId::seat_slope, 4, 1.0)));
  EXPECT_EQ(report::final_item(record, 5, own).value, 1.52);
  ASSERT_TRUE(record.slab.items.push(item_of(ItemId::seat_slope, 5, 1.49)));
  EXPECT_EQ(report::final_item(record, 5, own).value, 1.49);
  EXPECT_EQ(report::final_item(record, 5, item_of(ItemId::jaw_distance, 5, 380.0)).value, 380.0);
}

TEST(SlabView, an_item_for_information_does_not_replace_any_item) {
  storage::SlabRecord record;
  Item in_slab = item_of(ItemId::seat_slope, 5, 1.49);
  in_slab.lower = in_slab.upper = kNoValue;
  in_slab.verdict = Verdict::none;
  ASSERT_TRUE(record.slab.items.push(in_slab));
  EXPECT_EQ(report::final_item(record, 5, item_of(ItemId::seat_slope, 5, 1.52)).value, 1.52);
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

TEST(SlabView, the_tie_is_a_column_of_the_budget_of_a_slab_by_two_robots) {
  storage::SlabRecord record;
  record.summary.header.stations = 2;
  Item item = item_of(ItemId::large_jaw_distance, 1, 1895.4);
  item.station_to = 2;
  item.U = 0.2;
  item.budget[0] = 0.06;
  item.budget[static_cast<std::size_t>(BudgetPart::tie)] = 0.08;
  ASSERT_TRUE(record.slab.items.push(item));
  auto table = report::budget_table(record, report::Language::en);
  ASSERT_TRUE(table);
  const std::size_t columns = table->columns.size();
  ASSERT_EQ(table->rows.size(), 1U);
  EXPECT_EQ(table->rows[0].size(), columns);
  record.summary.header.tie_id = "ti-0123456789ab";
  table = report::budget_table(record, report::Language::en);
  ASSERT_TRUE(table);
  EXPECT_EQ(table->columns.size(), columns + 1);
  ASSERT_EQ(table->rows[0].size(), columns + 1);
  EXPECT_EQ(table->rows[0].back().text, "0.08000");
}

TEST(SlabView, a_name_says_whether_it_is_a_key_or_an_id) {
  EXPECT_EQ(report::slab_name("12").key, 12);
  EXPECT_EQ(report::slab_name("12").id, "12");
  EXPECT_EQ(report::slab_name("key:12").key, 12);
  EXPECT_EQ(report::slab_name("key:12").id, "");
  EXPECT_EQ(report::slab_name("id:12").key, std::nullopt);
  EXPECT_EQ(report::slab_name("id:12").id, "12");
  EXPECT_EQ(report::slab_name("0012").key, std::nullopt) << "as a works numbers its slabs";
  EXPECT_EQ(report::slab_name("0012").id, "0012");
  EXPECT_EQ(report::slab_name("key:0012").key, 12);
  EXPECT_EQ(report::slab_name("LINE-12").key, std::nullopt);
  EXPECT_EQ(report::slab_name("key:LINE").key, std::nullopt);
  EXPECT_EQ(report::slab_name("12").no, 12U) << "where neither key nor id is there";
  EXPECT_EQ(report::slab_name("no:12").no, 12U);
  for (const std::string& padded : {std::string("S-1   "), std::string("  S-1\t"), std::string("S-1\0\0", 5),
                                    std::string("\0S-1 \0", 6), std::string("id: S-1 "), std::string(" id:S-1")})
    EXPECT_EQ(report::slab_name(padded).id, "S-1") << "as copied from a PLC";
  EXPECT_EQ(report::slab_name("12  ").key, 12);
  EXPECT_EQ(report::slab_name("A B").id, "A B");
  EXPECT_EQ(report::slab_name("   ").id, "");
  EXPECT_EQ(report::slab_name("no:12").key, std::nullopt);
  EXPECT_EQ(report::slab_name("no:12").id, "");
  EXPECT_EQ(report::slab_name("key:12").no, std::nullopt);
  EXPECT_EQ(report::slab_name("id:12").no, std::nullopt);
}

}  // namespace
}  // namespace slabd::cli
