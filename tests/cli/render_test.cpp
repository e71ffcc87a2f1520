// SPDX-License-Identifier: Apache-2.0
#include "cli/render.h"

#include <gtest/gtest.h>

#include <array>

namespace slabd::cli {
namespace {

constexpr Style kPlain{false, false};
constexpr Style kUnicode{false, true};
constexpr Style kColour{true, true};

TEST(Render, every_verdict_has_its_own_symbol_in_both_alphabets) {
  for (const Style style : {kPlain, kUnicode}) {
    std::vector<std::string_view> seen;
    for (const Verdict v : {Verdict::none, Verdict::pass, Verdict::fail, Verdict::not_measured, Verdict::aborted,
                            Verdict::indeterminate}) {
      for (const std::string_view other : seen) EXPECT_NE(symbol(v, style), other);
      seen.push_back(symbol(v, style));
    }
  }
  EXPECT_EQ(verdict_text(Verdict::pass, kUnicode), "✓ pass");
  EXPECT_EQ(verdict_text(Verdict::fail, kPlain), "X fail");
  EXPECT_EQ(verdict_text(Verdict::fail, kColour), "\x1b[1;31m✗ fail\x1b[0m");
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

TEST(Render, item_table_is_the_papers_table_5_with_verdicts) {
  std::array<Item, 3> items;
  items[0] = {ItemId::seat_slope, Verdict::fail, true, 4, 0, 1.591140, 1.432096, 1.332218, 1.548158, 0.03, 36.0};
  items[1] = {ItemId::seat_flatness, Verdict::not_measured, true, 4, 0};
  items[1].upper = 1.0;
  items[2] = {ItemId::seat_std, Verdict::none, false, 4, 0, 0.0301};
  EXPECT_EQ(item_table(items, kPlain),
            "characteristic      nominal            limits  measured  deviation       U  verdict\n"
            "------------------------------------------------------------------------------------------\n"
            "seat_slope [deg]     1.4321  1.3322 .. 1.5482    1.5911     0.1590  0.0300  X fail\n"
            "  ratio_n                                        36.000\n"
            "seat_flatness [mm]        -          <= 1.000         -          -       -  0 not_measured\n"
            "seat_std [mm]             -              info     0.030          -       -  . none\n");
}

TEST(Render, slab_items_name_their_stations) {
  std::array<Item, 1> items;
  items[0].id = ItemId::seat_spacing;
  items[0].station = 3;
  items[0].station_to = 4;
  EXPECT_NE(item_table(items, kPlain, true).find("seat_spacing [mm] 3-4"), std::string::npos);
}

TEST(Render, columns_align_by_what_is_seen_not_by_bytes) {
  const std::string text = table({{"a", "b<"}, {"✓", "x"}, {"zz", "\x1b[32my\x1b[0m"}});
  EXPECT_EQ(text, "a   b\n-----\n✓   x\nzz  \x1b[32my\x1b[0m\n");
}

TEST(Render, reasons_name_the_item_or_the_code_and_its_cure) {
  EXPECT_EQ(reason_text(0), "");
  EXPECT_EQ(reason_text(604), "604: jaw_distance");
  EXPECT_EQ(reason_text(615), "615: warp");
  EXPECT_EQ(reason_words(402), "402: no supporting block was found, or the station was never scanned");
  EXPECT_NE(reason_text(402).find(std::string(cure(Code::block_not_found))), std::string::npos);
}

}  // namespace
}  // namespace slabd::cli
