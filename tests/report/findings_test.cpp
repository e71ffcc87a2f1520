// SPDX-License-Identifier: Apache-2.0
#include "report/findings.h"

#include <gtest/gtest.h>

#include "report/slab_view.h"

namespace slabd::report {
namespace {

/// An ended slab of 18 blocks, of which `count` are measured and pass.
storage::SlabRecord slab_with(int count) {
  storage::SlabRecord record;
  record.summary.header.stations = 18;
  record.summary.ended_utime_us = 1'763'681'999'000'000;
  record.summary.verdict = count == 18 ? Verdict::pass : Verdict::not_measured;
  for (int station = 1; station <= 18; ++station) {
    const auto i = static_cast<std::size_t>(station - 1);
    record.slab.station_verdict[i] = station <= count ? Verdict::pass : Verdict::not_measured;
    if (station > count) continue;
    storage::SlabBlock block;
    block.attempt.station = static_cast<std::uint8_t>(station);
    block.phase = StationPhase::measured;
    block.block.station = static_cast<std::uint8_t>(station);
    block.block.verdict = Verdict::pass;
    record.blocks.push_back(block);
  }
  return record;
}

Item item_of(ItemId id, int station, Verdict verdict, double value) {
  Item item;
  item.id = id;
  item.station = static_cast<std::uint8_t>(station);
  item.verdict = verdict;
  item.required = true;
  item.value = value;
  item.lower = 379.5;
  item.upper = 380.5;
  item.U = 0.05;
  return item;
}

TEST(Findings, a_partial_slab_has_two_sentences_and_not_one_for_each_item) {
  storage::SlabRecord record = slab_with(3);
  for (int station = 1; station <= 18; ++station)
    for (const ItemId id : {ItemId::seat_lateral, ItemId::seat_vertical})
      ASSERT_TRUE(record.slab.items.push(item_of(id, station, Verdict::not_measured, kNoValue)));
  ASSERT_TRUE(record.slab.items.push(item_of(ItemId::warp_left, 0, Verdict::not_measured, kNoValue)));
  const std::vector<Finding> findings = findings_of(record, Language::en);
  ASSERT_EQ(findings.size(), 2U);
  EXPECT_EQ(sentence_of(findings[0], Language::en), "Blocks 4-18: not scanned");
  EXPECT_EQ(sentence_of(findings[1], Language::en),
            "items of the slab not measured: seat, lateral position (18), seat, height (18), warp, row Y > 0");
  EXPECT_EQ(findings_of(record, Language::zh).size(), 2U);
}

TEST(Findings, an_aborted_slab_begins_with_the_abort) {
  storage::SlabRecord record = slab_with(3);
  record.summary.verdict = Verdict::aborted;
  record.summary.reason = 110;
  record.slab.station_verdict.fill(Verdict::none);
  const std::vector<Finding> findings = findings_of(record, Language::en);
  ASSERT_EQ(findings.size(), 2U);
  EXPECT_EQ(findings[0].verdict, Verdict::aborted);
  EXPECT_EQ(sentence_of(findings[1], Language::en).find("Blocks 4-18: "), 0U);
}

TEST(Findings, items_have_value_limits_U_and_place_and_failures_come_first) {
  storage::SlabRecord record = slab_with(18);
  auto& blocks = record.blocks;
  ASSERT_TRUE(blocks[3].block.items.push(item_of(ItemId::jaw_distance, 0, Verdict::indeterminate, 380.49)));
  ASSERT_TRUE(blocks[10].block.items.push(item_of(ItemId::jaw_distance, 0, Verdict::fail, 380.9)));
  ASSERT_TRUE(blocks[11].block.items.push(item_of(ItemId::jaw_distance, 0, Verdict::pass, 380.0)));
  const std::vector<Finding> findings = findings_of(record, Language::en);
  ASSERT_EQ(findings.size(), 2U);
  EXPECT_EQ(sentence_of(findings[0], Language::en),
            "Block 11, jaw distance: 380.900 mm, limits 379.500 .. 380.500, U 0.050");
  EXPECT_EQ(findings[1].stations, std::vector<int>{4});
  EXPECT_TRUE(is_objected(findings, 11));
  EXPECT_FALSE(is_objected(findings, 12));
}

// One chip among seats that are good otherwise.
TEST(Findings, one_chip_is_first_and_belongs_to_its_block) {
  storage::SlabRecord record = slab_with(18);
  SurfaceFinding chip;
  chip.kind = FindingKind::chip;
  chip.area_mm2 = 600.0;
  ASSERT_TRUE(record.blocks[6].block.findings.push(chip));
  ASSERT_TRUE(record.blocks[1].block.items.push(item_of(ItemId::jaw_distance, 0, Verdict::fail, 381.0)));
  const std::vector<Finding> findings = findings_of(record, Language::en);
  ASSERT_EQ(findings.size(), 2U);
  EXPECT_EQ(findings[0].stations, std::vector<int>{7});
  EXPECT_NE(findings[0].what.find("chip"), std::string::npos);
}

TEST(Ranges, join_neighbours_from_three_on) {
  EXPECT_EQ(ranges_text({}), "");
  EXPECT_EQ(ranges_text({4}), "4");
  EXPECT_EQ(ranges_text({3, 4}), "3, 4");
  EXPECT_EQ(ranges_text({1, 2, 3, 7, 9, 10, 11}), "1-3, 7, 9-11");
}

}  // namespace
}  // namespace slabd::report
