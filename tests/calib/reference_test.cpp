// SPDX-License-Identifier: Apache-2.0
#include "calib/reference.h"

#include <gtest/gtest.h>

#include <cmath>

#include "base/thermal.h"

namespace slabd::calib {
namespace {

constexpr const char* kText = R"(id = ref-block-01
date = 2026-03-14
slope_deg = 1.4321
slope_U_deg = 0.0020
jaw_distance_mm = 380.012
jaw_distance_U_mm = 0.006
)";

ReferenceBlock certified() {
  const auto c = parse_reference_certificate(kText, "ref.txt");
  EXPECT_TRUE(c.ok()) << c.error().text.view();
  return c.ok() ? c.value().block : ReferenceBlock{};
}

BlockResult measured(double slope_deg, double slope_U_deg, double jaw_mm, double jaw_U_mm) {
  BlockResult block;
  Item slope;
  slope.id = ItemId::seat_slope;
  slope.value = slope_deg;
  slope.U = slope_U_deg;
  Item jaw;
  jaw.id = ItemId::jaw_distance;
  jaw.value = jaw_mm;
  jaw.U = jaw_U_mm;
  EXPECT_TRUE(block.items.push(slope) && block.items.push(jaw));
  return block;
}

TEST(ReferenceCertificate, is_read_with_its_coverage_factor) {
  EXPECT_DOUBLE_EQ(certified().slope_rad, rad_from_deg(1.4321));
  EXPECT_DOUBLE_EQ(certified().jaw_distance_U_mm, 0.006);
  const auto other = parse_reference_certificate(std::string(kText) + "coverage_factor = 3\n", "ref.txt");
  ASSERT_TRUE(other.ok());
  EXPECT_DOUBLE_EQ(other.value().block.jaw_distance_U_mm, 0.004) << "k = 2 inside";
  const auto bad = parse_reference_certificate("id = x\n", "ref.txt");
  ASSERT_FALSE(bad.ok());
  EXPECT_NE(bad.error().text.view().find("ref.txt: the key date is missing"), std::string_view::npos);
}

TEST(ReferenceCheck, passes_within_what_both_uncertainties_allow) {
  EXPECT_TRUE(check_block(certified(), measured(1.4321, 0.03, 380.012, 0.05), {}).passed);
  EXPECT_TRUE(check_block(certified(), measured(1.4320 + 0.030, 0.03, 380.012, 0.05), {}).passed);
  const CalibrationCheck off = check_block(certified(), measured(1.4321 + 0.0302, 0.03, 380.012, 0.05), {});
  EXPECT_FALSE(off.passed);
  EXPECT_NE(off.note.view().find("slope is +0.0302 deg off"), std::string_view::npos) << off.note.view();
  const CalibrationCheck both = check_block(certified(), measured(1.5, 0.03, 379.0, 0.05), {});
  EXPECT_NE(both.note.view().find("jaw distance is -1.0120 mm off"), std::string_view::npos) << both.note.view();
}

TEST(ReferenceCheck, limits_of_the_configuration_may_be_tighter_never_wider) {
  const BlockResult block = measured(1.4321 + 0.02, 0.03, 380.012, 0.05);
  EXPECT_TRUE(check_block(certified(), block, {}).passed);
  EXPECT_FALSE(check_block(certified(), block, {rad_from_deg(0.01), kNoValue}).passed);
  EXPECT_FALSE(check_block(certified(), measured(1.4321 + 0.05, 0.03, 380.012, 0.05), {rad_from_deg(0.1), 5.0}).passed);
}

TEST(ReferenceCheck, the_distance_is_stated_at_the_temperature_of_the_certificate) {
  const std::string steel = std::string(kText) + "expansion_per_K = 11.5e-6\nexpansion_u_per_K = 0.5e-6\n";
  const auto c = parse_reference_certificate(steel, "ref.txt");
  ASSERT_TRUE(c.ok()) << c.error().text.view();
  constexpr double kWarm_c = 32.0;
  const double warm_mm = 380.012 * (1.0 + 11.5e-6 * (kWarm_c - 20.0));
  const BlockResult block = measured(1.4321, 0.03, warm_mm, 0.03);
  EXPECT_FALSE(check_block(c.value().block, block, {}).passed) << "0.052 mm longer";
  const CalibrationCheck known = check_block(c.value().block, block, {}, expansion_of(c.value(), kWarm_c));
  EXPECT_TRUE(known.passed);
  EXPECT_NEAR(known.jaw_distance_mm, 380.012, 1e-6);
  const double u_relative = std::hypot(11.5e-6 * 1.0, 12.0 * 0.5e-6);
  EXPECT_NEAR(known.jaw_distance_U_mm, std::hypot(0.03, 2.0 * warm_mm * u_relative), 1e-6);
  const CalibrationCheck unknown = check_block(c.value().block, block, {}, expansion_of(c.value(), kNoValue));
  EXPECT_TRUE(unknown.passed);
  EXPECT_DOUBLE_EQ(unknown.jaw_distance_mm, warm_mm);
  EXPECT_GT(unknown.jaw_distance_U_mm, 0.1);
  const auto silent = parse_reference_certificate(kText, "ref.txt");
  EXPECT_FALSE(expansion_of(silent.value(), kWarm_c).given) << "no expansion is stated";
}

TEST(ReferenceCheck, a_correction_for_a_slab_of_concrete_is_undone) {
  BlockResult block = measured(1.4321, 0.03, 380.012, 0.03);
  Item& jaw = block.items[1];
  jaw.budget[static_cast<std::size_t>(BudgetPart::noise)] = 0.015;
  state_at_reference({2e-4, 5e-5, true}, jaw.value, jaw);
  ASSERT_NEAR(jaw.value, 380.012 - 0.076, 1e-3);
  const CalibrationCheck check = check_block(certified(), block, {});
  EXPECT_TRUE(check.passed);
  EXPECT_DOUBLE_EQ(check.jaw_distance_mm, 380.012);
  EXPECT_NEAR(check.jaw_distance_U_mm, 0.03, 1e-12);
}

TEST(ReferenceCheck, items_without_value_or_U_fail) {
  const CalibrationCheck nothing = check_block(certified(), BlockResult{}, {});
  EXPECT_FALSE(nothing.passed);
  EXPECT_NE(nothing.note.view().find("slope was not measured"), std::string_view::npos);
  EXPECT_FALSE(check_block(certified(), measured(1.4321, kNoValue, 380.012, 0.05), {}).passed);
  EXPECT_FALSE(check_block(certified(), measured(1.4321, 0.03, kNoValue, 0.05), {}).passed);
}

TEST(MonitorBallCheck, measures_the_way_from_its_place) {
  const MonitorBall ball{Vec3(100.0, 200.0, 300.0), 19.05, 0.1};
  EXPECT_TRUE(check_ball(ball, Vec3(100.05, 200.0, 300.05)).passed);
  const CalibrationCheck off = check_ball(ball, Vec3(100.0, 200.2, 300.0));
  EXPECT_FALSE(off.passed);
  EXPECT_NEAR(off.off_mm.y(), 0.2, 1e-12);
  EXPECT_NE(off.note.view().find("0.200 mm from its place"), std::string_view::npos);
  EXPECT_FALSE(check_ball(ball, Vec3::Constant(kNoValue)).passed);
}

}  // namespace
}  // namespace slabd::calib
