// SPDX-License-Identifier: Apache-2.0
#include "cli/terminal/render.h"

#include <gtest/gtest.h>

#include <array>

namespace slabd::cli {
namespace {

constexpr report::Style kPlain{false, false};
constexpr report::Style kUnicode{false, true};
constexpr report::Style kColour{true, true};

TEST(Render, every_verdict_has_its_own_symbol_in_both_alphabets) {
  for (const report::Style style : {kPlain, kUnicode}) {
    std::vector<std::string_view> seen;
    for (const Verdict v : {Verdict::none, Verdict::pass, Verdict::fail, Verdict::not_measured, Verdict::aborted,
                            Verdict::indeterminate}) {
      for (const std::string_view other : seen) EXPECT_NE(report::symbol(v, style), other);
      seen.push_back(report::symbol(v, style));
    }
  }
  EXPECT_EQ(report::verdict_text(Verdict::pass, kUnicode), "✓ pass");
  EXPECT_EQ(report::verdict_text(Verdict::fail, kPlain), "X fail");
  EXPECT_EQ(report::verdict_text(Verdict::fail, kColour), "\x1b[1;31m✗ fail\x1b[0m");
}

TEST(Render, columns_line_up_whatever_the_cells_are_written_in) {
  EXPECT_EQ(report::display_width("abc"), 3U);
  EXPECT_EQ(report::display_width("承轨台 4"), 8U);
  EXPECT_EQ(report::display_width("\x1b[1;31m✗ fail\x1b[0m"), 6U);
  report::Table table{"项目", "值"};
  table.add("坡度", 1);
  table.add("abcd", 22);
  EXPECT_EQ(report::text_of(table),
            "项目  值\n"
            "--------\n"
            "坡度   1\n"
            "abcd  22\n");
}

TEST(Render, map_shows_the_rows_as_they_lie_on_the_slab) {
  std::array<Verdict, 18> verdicts;
  verdicts.fill(Verdict::pass);
  verdicts[0] = Verdict::fail;           // station 1: upper left
  verdicts[8] = Verdict::indeterminate;  // station 9: upper right
  verdicts[9] = Verdict::not_measured;   // station 10: lower right
  verdicts[17] = Verdict::none;          // station 18: lower left
  EXPECT_EQ(slab_map(verdicts, kPlain),
            "            1   2   3   4   5   6   7   8   9\n"
            "  Y > 0     X   +   +   +   +   +   +   +   ?\n"
            "  Y < 0     .   +   +   +   +   +   +   +   0\n"
            "           18  17  16  15  14  13  12  11  10\n");
  EXPECT_NE(slab_map(verdicts, kUnicode).find("  Y > 0     ✗   ✓"), std::string::npos);
}

TEST(Render, map_counts_the_findings_behind_a_block) {
  std::array<Verdict, 6> verdicts;
  verdicts.fill(Verdict::pass);
  verdicts[5] = Verdict::fail;
  const std::array<std::size_t, 6> damaged = {0, 2, 32, 0, 0, 1};
  EXPECT_EQ(slab_map(verdicts, kPlain, damaged),
            "            1   2   3\n"
            "  Y > 0     +   +!2 +!9\n"
            "  Y < 0     X!1 +   +\n"
            "            6   5   4\n");
}

TEST(Render, item_table_is_the_papers_table_5_with_verdicts) {
  std::array<Item, 3> items;
  items[0] = {ItemId::seat_slope, Verdict::fail, true, 4, 0, 1.591140, 1.432096, 1.332218, 1.548158, 0.02, 36.0};
  items[1] = {ItemId::seat_flatness, Verdict::not_measured, true, 4, 0};
  items[1].upper = 1.0;
  items[2] = {ItemId::seat_std, Verdict::none, false, 4, 0, 0.0301};
  EXPECT_EQ(item_table(items, kPlain),
            "characteristic      nominal            limits  measured  deviation       U  verdict\n"
            "------------------------------------------------------------------------------------------\n"
            "seat_slope [deg]     1.4321  1.3322 .. 1.5482    1.5911     0.1590  0.0200  X fail\n"
            "  ratio_n                                        36.000\n"
            "seat_flatness [mm]        -          <= 1.000         -          -       -  0 not_measured\n"
            "seat_std [mm]             -              info     0.030          -       -  . none\n");
}

TEST(Render, item_table_says_how_probably_a_value_conforms_where_that_is_in_doubt) {
  std::array<Item, 2> items;
  items[0] = {ItemId::seat_flatness, Verdict::pass, true, 4, 0, 0.2, 0.0, kNoValue, 1.0, 0.1};
  items[1] = {ItemId::jaw_distance, Verdict::indeterminate, true, 4, 0, 380.45, 380.0, 379.5, 380.5, 0.1};
  EXPECT_EQ(item_table(items, kPlain),
            "characteristic      nominal              limits  measured  deviation      U  conforms  verdict\n"
            "------------------------------------------------------------------------------------------------------\n"
            "seat_flatness [mm]    0.000            <= 1.000     0.200      0.200  0.100            + pass\n"
            "jaw_distance [mm]   380.000  379.500 .. 380.500   380.450      0.450  0.100    84.1 %  ? indeterminate\n");
}

TEST(Render, seat_notes_name_operator_noise_and_defect) {
  SeatFeature seat;
  EXPECT_EQ(seat_notes(seat, 1.5), "");
  seat.flatness_mm = 0.1;
  EXPECT_EQ(seat_notes(seat, 1.5), "flatness from cell mean 1.5 mm, least-squares plane\n");
  seat.flatness_noise_mm = 0.0281;
  seat.defect = {0.15, 12, 27.0, -0.4, 10.0, -20.0};
  EXPECT_EQ(seat_notes(seat, kNoValue),
            "flatness from cell mean, least-squares plane; a perfectly flat seat would read 0.028 mm with this noise\n"
            "defect: 27.0 mm2 sunk up to 0.400 mm at x 10.0 mm, s -20.0 mm (12 cells beyond 0.150 mm)\n");
}

TEST(Render, slab_items_name_their_stations) {
  std::array<Item, 1> items;
  items[0].id = ItemId::seat_spacing;
  items[0].station = 3;
  items[0].station_to = 4;
  EXPECT_NE(item_table(items, kPlain, true).find("seat_spacing [mm] 3-4"), std::string::npos);
}

TEST(Render, columns_align_by_what_is_seen_not_by_bytes) {
  report::Table table{"a", "b<"};
  table.add("✓", "x");
  table.add("zz", "\x1b[32my\x1b[0m");
  EXPECT_EQ(report::text_of(table), "a   b\n-----\n✓   x\nzz  \x1b[32my\x1b[0m\n");
}

TEST(Render, reasons_name_the_item_or_the_code_and_its_cure) {
  EXPECT_EQ(reason_text(0), "");
  EXPECT_EQ(reason_text(604), "604: jaw_distance");
  EXPECT_EQ(reason_text(615), "615: warp");
  EXPECT_EQ(reason_text(617), "617: surface of the block is displaced, broken out, cracked or missing");
  EXPECT_EQ(reason_words(402), "402: no supporting block was found, or the station was never scanned");
  EXPECT_NE(reason_text(402).find(std::string(cure(Code::block_not_found))), std::string::npos);
}

}  // namespace
}  // namespace slabd::cli
