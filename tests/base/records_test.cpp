// SPDX-License-Identifier: Apache-2.0
#include "base/records.h"

#include <gtest/gtest.h>

#include <set>
#include <string_view>

#include "base/plc.h"

namespace slabd {
namespace {

Item judged(ItemId id, Verdict verdict, bool required, int station = 0, double value = 0.0) {
  Item item;
  item.id = id;
  item.verdict = verdict;
  item.required = required;
  item.station = static_cast<std::uint8_t>(station);
  item.value = value;
  item.nominal = 0.0;
  return item;
}

TEST(Reason, names_the_lowest_item_that_decided) {
  const std::array items = {judged(ItemId::jaw_distance, Verdict::fail, true),
                            judged(ItemId::jaw_angle_inner, Verdict::fail, true),
                            judged(ItemId::seat_slope, Verdict::pass, true)};
  EXPECT_EQ(reason_for(Verdict::fail, items.begin(), items.end(), Code::ok), 602);
  EXPECT_EQ(fail_mask(items.begin(), items.end()), (1U << 2U) | (1U << 4U));
}

TEST(Reason, prefers_the_code_when_no_value_was_measured) {
  const std::array items = {judged(ItemId::seat_slope, Verdict::not_measured, true),
                            judged(ItemId::casing_skew_inner, Verdict::not_measured, false)};
  EXPECT_EQ(reason_for(Verdict::not_measured, items.begin(), items.end(), Code::block_not_found), 402);
  EXPECT_EQ(reason_for(Verdict::not_measured, items.begin(), items.end(), Code::ok), 600);
  EXPECT_EQ(open_mask(items.begin(), items.end()), (1U << 0U) | (1U << 8U));
  EXPECT_EQ(reason_for(Verdict::pass, items.begin(), items.end(), Code::ok), 0);
}

TEST(Reason, is_a_code_if_no_register_has_a_bit_for_the_item) {
  const std::array items = {judged(ItemId::seat_std, Verdict::fail, true)};
  EXPECT_EQ(reason_for(Verdict::fail, items.begin(), items.end(), Code::ok), static_cast<int>(Code::fit_failed));
  EXPECT_EQ(reason_for(Verdict::fail, items.begin(), items.end(), Code::interrupted),
            static_cast<int>(Code::interrupted));
  EXPECT_EQ(fail_mask(items.begin(), items.end()), 0U);
  EXPECT_EQ(open_mask(items.begin(), items.end()), 0U);
}

TEST(Reason, is_617_for_a_finding_and_only_if_the_items_would_pass) {
  BlockResult block;
  std::array items = {judged(ItemId::seat_slope, Verdict::pass, true),
                      judged(ItemId::jaw_distance, Verdict::pass, true)};
  EXPECT_EQ(with_findings(Verdict::pass, block), Verdict::pass);
  EXPECT_EQ(reason_with_findings(Verdict::pass, items.begin(), items.end(), Code::ok, block), 0);
  ASSERT_TRUE(block.findings.push(SurfaceFinding{}));
  for (const Verdict verdict : {Verdict::fail, Verdict::not_measured, Verdict::indeterminate, Verdict::aborted})
    EXPECT_EQ(with_findings(verdict, block), verdict);
  EXPECT_EQ(with_findings(Verdict::pass, block), Verdict::indeterminate);
  EXPECT_EQ(reason_with_findings(Verdict::indeterminate, items.begin(), items.end(), Code::ok, block), 617);
  items[1].verdict = Verdict::indeterminate;
  EXPECT_EQ(reason_with_findings(Verdict::indeterminate, items.begin(), items.end(), Code::ok, block), 604);
  items[1].verdict = Verdict::fail;
  EXPECT_EQ(reason_with_findings(Verdict::fail, items.begin(), items.end(), Code::ok, block), 604);
}

TEST(Doubts, have_a_word_each_and_a_reason_where_a_fit_gave_one) {
  std::set<std::string_view> words, reasons;
  for (std::size_t i = 0; i < kPlaneDoubts; ++i) {
    const auto doubt = static_cast<PlaneDoubt>(i);
    words.insert(name(doubt));
    reasons.insert(reason_of(doubt));
  }
  EXPECT_EQ(words.size(), kPlaneDoubts);
  EXPECT_EQ(reasons.size(), kPlaneDoubts - 1) << "none and not_fitted have an empty one";
  words.clear();
  reasons.clear();
  for (std::size_t i = 0; i < kCasingDoubts; ++i) {
    const auto doubt = static_cast<CasingDoubt>(i);
    words.insert(name(doubt));
    reasons.insert(reason_of(doubt));
  }
  EXPECT_EQ(words.size(), kCasingDoubts);
  EXPECT_EQ(reasons.size(), kCasingDoubts - 1) << "none and not_measured have an empty one";
}

TEST(Findings, have_a_text_with_place_and_size) {
  SurfaceFinding f;
  f.kind = FindingKind::chip;
  f.face = FindingFace::jaw_outer;
  f.x_mm = 81.2;
  f.s_mm = 190.4;
  f.length_mm = 40.0;
  f.width_mm = 12.5;
  f.area_mm2 = 500.0;
  EXPECT_EQ(sentence(f).view(), "chip on the outer jaw at x 81 mm, s 190 mm: 40 x 12 mm, 500 mm2");
  f.depth_mm = 15.02;
  EXPECT_EQ(sentence(f).view(), "chip on the outer jaw at x 81 mm, s 190 mm: 40 x 12 mm, 500 mm2, up to 15.0 mm deep");
}

TEST(Pores, beyond_depth_or_share_fail_and_the_text_names_which) {
  PoreSummary pores;
  EXPECT_TRUE(sentence(pores).empty());
  pores = {12, 8.1, 3.4, 0.004, {}};
  EXPECT_EQ(sentence(pores).view(), "12 pores, largest 8.1 mm, deepest 3.4 mm, 0.40 % of the area");
  EXPECT_EQ(with_pore_limits(Verdict::pass, pores), Verdict::pass);
  pores.limits = {5.0, 0.01};
  EXPECT_EQ(sentence(pores).view(),
            "12 pores, largest 8.1 mm, deepest 3.4 mm (at most 5 mm), 0.40 % of the area (at most 1 %)");
  for (const Verdict verdict : {Verdict::pass, Verdict::indeterminate, Verdict::fail, Verdict::not_measured})
    EXPECT_EQ(with_pore_limits(verdict, pores), verdict);
  pores.limits.depth_max_mm = 3.0;
  EXPECT_NE(sentence(pores).view().find("deepest 3.4 mm (more than 3 mm)"), std::string_view::npos);
  EXPECT_EQ(with_pore_limits(Verdict::pass, pores), Verdict::fail);
  EXPECT_EQ(with_pore_limits(Verdict::indeterminate, pores), Verdict::fail);
  EXPECT_EQ(with_pore_limits(Verdict::not_measured, pores), Verdict::not_measured);
  pores.limits = {5.0, 0.002};
  EXPECT_NE(sentence(pores).view().find("0.40 % of the area (more than 0.2 %)"), std::string_view::npos);
  EXPECT_EQ(with_pore_limits(Verdict::pass, pores), Verdict::fail);
}

TEST(Scan, warns_of_coordinates_that_are_rounded_more_than_usual) {
  ScanCounts scan;
  EXPECT_TRUE(scan_warning(scan).empty());
  scan.step_mm = Vec3(0.01, 0.01, 0.005);
  EXPECT_TRUE(scan_warning(scan).empty());
  scan.step_mm.z() = 0.1;
  EXPECT_NE(scan_warning(scan).view().find("0.01, 0.01, 0.1 mm"), std::string_view::npos) << scan_warning(scan).c_str();
}

TEST(Scan, warns_of_neighbours_that_share_their_noise) {
  ScanCounts scan;
  scan.lag_ratio = 2.8;
  EXPECT_TRUE(scan_warning(scan).empty());
  scan.lag_ratio = 2.0;
  EXPECT_TRUE(scan_warning(scan).view().starts_with("neighbouring points share their noise (2.0, without a filter 3)"));
  scan.step_mm.z() = 0.1;
  EXPECT_NE(scan_warning(scan).view().find("write more decimals; neighbouring points"), std::string_view::npos);
  EXPECT_TRUE(scan_warning(scan).view().ends_with("scanner's program"));
}

TEST(Registration, every_status_has_a_word_of_its_own) {
  EXPECT_EQ(name(RegistrationStatus::none), "none");
  EXPECT_EQ(name(RegistrationStatus::converged), "converged");
  EXPECT_EQ(name(RegistrationStatus::iteration_limit), "iteration_limit");
  EXPECT_EQ(name(RegistrationStatus::degenerate), "degenerate");
  EXPECT_EQ(name(RegistrationStatus::rejected), "rejected");
  EXPECT_EQ(name(static_cast<RegistrationStatus>(99)), "none");
}

TEST(SlabRecord, carries_the_worst_seat_of_each_kind_with_its_station) {
  SlabResult slab;
  for (const auto& [station, value] : {std::pair{3, 0.2}, std::pair{7, -0.6}, std::pair{11, 0.6}})
    ASSERT_TRUE(slab.items.push(judged(ItemId::seat_lateral, Verdict::pass, true, station, value)));
  slab.fail_mask = 1U << 4U;  // a block item: the slab's record includes its blocks
  slab.station_verdict[6] = Verdict::fail;
  slab.station_verdict[0] = Verdict::fail;
  const PlcResult record = slab_record(slab, 18);
  EXPECT_EQ(record.kind, 2);
  EXPECT_DOUBLE_EQ(record.deviation[9], -0.6);
  EXPECT_DOUBLE_EQ(record.deviation[10], 7.0);
  EXPECT_FALSE(has_value(record.deviation[11]));
  EXPECT_DOUBLE_EQ(record.deviation[13], 2.0);
  EXPECT_NE(record.verdict, Verdict::pass);
  EXPECT_EQ(record.fail_mask, 1U << 4U);
}

TEST(StationRecord, has_place_and_final_verdict_of_its_seat_once_the_slab_has_ended) {
  BlockResult block;
  block.station = 7;
  block.verdict = Verdict::pass;
  ASSERT_TRUE(block.items.push(judged(ItemId::seat_slope, Verdict::fail, true, 7, 0.3)));
  const PlcResult before = station_record(block);
  EXPECT_DOUBLE_EQ(before.deviation[0], 0.3);
  EXPECT_FALSE(has_value(before.deviation[9])) << "IR 51: only the slab's frame decides it";
  EXPECT_FALSE(has_value(before.deviation[10]));
  EXPECT_NE(before.fail_mask, 0);

  SlabResult slab;
  ASSERT_TRUE(slab.items.push(judged(ItemId::seat_slope, Verdict::pass, true, 7, 0.05)));
  ASSERT_TRUE(slab.items.push(judged(ItemId::seat_lateral, Verdict::fail, true, 7, -0.6)));
  ASSERT_TRUE(slab.items.push(judged(ItemId::seat_vertical, Verdict::pass, true, 7, 0.2)));
  ASSERT_TRUE(slab.items.push(judged(ItemId::seat_lateral, Verdict::pass, true, 8, 0.1)));
  slab.station_verdict[6] = Verdict::fail;
  slab.station_reason[6] = 601;
  const PlcResult after = station_record(block, slab);
  EXPECT_EQ(after.kind, 1);
  EXPECT_EQ(after.station, 7);
  EXPECT_EQ(after.verdict, Verdict::fail);
  EXPECT_EQ(after.reason, 601);
  EXPECT_DOUBLE_EQ(after.deviation[0], 0.05) << "of the slope the slab's own";
  EXPECT_DOUBLE_EQ(after.deviation[9], -0.6) << "IR 51";
  EXPECT_DOUBLE_EQ(after.deviation[10], 0.2) << "IR 52";
  const Item lateral = judged(ItemId::seat_lateral, Verdict::fail, true, 7, -0.6);
  EXPECT_EQ(after.fail_mask, fail_mask(&lateral, &lateral + 1));
}

TEST(StationRecord, has_the_local_slope_if_only_that_one_is_judged) {
  BlockResult block;
  block.station = 7;
  Item local = judged(ItemId::seat_slope, Verdict::fail, true, 7, 0.3);
  local.lower = -0.1;
  local.upper = 0.1;
  ASSERT_TRUE(block.items.push(local));
  for (const double in_slab_frame : {0.05, kNoValue}) {
    SlabResult slab;
    ASSERT_TRUE(
        slab.items.push(judged(ItemId::seat_slope, has_value(in_slab_frame) ? Verdict::none : Verdict::not_measured,
                               false, 7, in_slab_frame)));
    slab.station_verdict[6] = Verdict::fail;
    slab.station_reason[6] = 600;
    const PlcResult record = station_record(block, slab);
    EXPECT_DOUBLE_EQ(record.deviation[0], 0.3);
    EXPECT_EQ(record.fail_mask, fail_mask(&local, &local + 1));
    EXPECT_NE(record.fail_mask, 0);
    EXPECT_EQ(record.open_mask, 0);
  }
}

TEST(Sequence, never_uses_zero) {
  EXPECT_EQ(next_sequence(0), 1);
  EXPECT_EQ(next_sequence(1), 2);
  EXPECT_EQ(next_sequence(0xFFFF), 1);
}

}  // namespace
}  // namespace slabd
