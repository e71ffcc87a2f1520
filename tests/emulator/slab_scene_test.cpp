// SPDX-License-Identifier: Apache-2.0
#include "emulator/slab_scene.h"

#include <gtest/gtest.h>

#include "tests/config/reference_recipe.h"

namespace slabd::emulator {
namespace {

Cell some_cell() {
  Cell cell;
  cell.T_base_slab.translation_mm = Vec3(1800.0, 100.0, 300.0);
  cell.T_base_slab.rotation = rotation_from_kuka_abc(0.3, 0.01, -0.02);
  cell.T_flange_scanner.translation_mm = Vec3(10.0, -20.0, 150.0);
  cell.T_flange_scanner.rotation = rotation_from_kuka_abc(0.2, 0.1, 0.05);
  return cell;
}

SlabVariation exact() {
  SlabVariation v;
  v.casting = v.placement_mm = v.placement_deg = v.robot_mm = 0.0;
  return v;
}

TEST(SlabScene, exact_slab_shows_every_block_in_the_nominal_view) {
  const Recipe recipe = cli::reference_recipe();
  const auto slab = cast_slab(recipe, some_cell(), exact(), {});
  ASSERT_TRUE(slab);
  const Pose nominal = nominal_T_block_scanner().inverse();
  for (int k = 1; k <= 18; ++k) {
    const Pose seen = T_scanner_block(slab.value(), some_cell(), k);
    EXPECT_LT((seen.translation_mm - nominal.translation_mm).norm(), 1e-9) << k;
    EXPECT_LT(angle_between_rad(seen.rotation, nominal.rotation), 1e-9) << k;
    EXPECT_NEAR(true_value(recipe, slab.value().at(k), ItemId::seat_slope), deg_from_rad(std::atan(1.0 / 40.0)), 1e-12);
  }
}

/// The same cell with a second robot on the other side of the slab, which is off its tied place by the given motion.
Cell two_robots(double mm = 0.0, double deg = 0.0) {
  Cell cell = some_cell();
  FurtherArm arm;
  arm.T_base_robot = {rotation_from_kuka_abc(3.1, 0.002, -0.001), Vec3(3600.0, 250.0, -12.0)};
  arm.T_base_robot_real = moved_base(arm.T_base_robot, Vec3(1800.0, 100.0, 300.0), mm, deg, 5);
  arm.T_flange_scanner = {rotation_from_kuka_abc(-0.4, 0.05, 0.1), Vec3(-15.0, 30.0, 140.0)};
  cell.further.push_back(arm);
  return cell;
}

TEST(SlabScene, the_second_robot_sees_every_block_in_the_nominal_view) {
  const Recipe recipe = cli::reference_recipe();
  const Cell cell = two_robots();
  const auto slab = cast_slab(recipe, cell, exact(), {});
  ASSERT_TRUE(slab);
  const Pose nominal = nominal_T_block_scanner().inverse();
  for (int k = 1; k <= 18; ++k) {
    const Pose seen = T_scanner_block(slab.value(), cell, k, 1);
    EXPECT_LT((seen.translation_mm - nominal.translation_mm).norm(), 1e-9) << k;
    EXPECT_LT(angle_between_rad(seen.rotation, nominal.rotation), 1e-9) << k;
  }
}

TEST(SlabScene, the_first_robot_and_the_slab_are_the_same_with_and_without_a_second_one) {
  const Recipe recipe = cli::reference_recipe();
  const auto one = cast_slab(recipe, some_cell(), SlabVariation{}, {});
  const auto two = cast_slab(recipe, two_robots(), SlabVariation{}, {});
  ASSERT_TRUE(one && two);
  for (int k = 1; k <= 18; ++k) {
    EXPECT_EQ(one.value().at(k).T_base_flange_real.translation_mm, two.value().at(k).T_base_flange_real.translation_mm);
    EXPECT_EQ(one.value().at(k).T_slab_block.translation_mm, two.value().at(k).T_slab_block.translation_mm);
  }
}

TEST(SlabScene, an_error_of_the_tie_moves_all_that_the_second_robot_sees_and_nothing_of_the_first) {
  const Recipe recipe = cli::reference_recipe();
  const auto slab = cast_slab(recipe, two_robots(), exact(), {});
  ASSERT_TRUE(slab);
  const Cell tied = two_robots();
  const Cell shifted = two_robots(0.3, 0.0);
  const Cell turned = two_robots(0.0, 0.01);
  for (int k = 1; k <= 18; ++k) {
    const auto place = [&](const Cell& cell, std::size_t arm) {
      return T_scanner_block(slab.value(), cell, k, arm).translation_mm;
    };
    EXPECT_NEAR((place(shifted, 1) - place(tied, 1)).norm(), 0.3, 1e-9) << k;
    EXPECT_LT((place(turned, 1) - place(tied, 1)).norm(), rad_from_deg(0.01) * 3000.0) << k;
    EXPECT_EQ(place(shifted, 0), place(tied, 0)) << k;
  }
  const Pose& T = tied.further[0].T_base_robot;
  EXPECT_NEAR(deg_from_rad(angle_between_rad(turned.further[0].T_base_robot_real.rotation, T.rotation)), 0.01, 1e-9);
  EXPECT_NEAR((shifted.further[0].T_base_robot_real.translation_mm - T.translation_mm).norm(), 0.3, 1e-9);
}

TEST(SlabScene, no_block_is_in_view_of_a_robot_that_is_aside) {
  const Recipe recipe = cli::reference_recipe();
  const Cell cell = two_robots();
  const auto slab = cast_slab(recipe, cell, SlabVariation{}, {});
  ASSERT_TRUE(slab);
  constexpr double kLookMax_mm = 300.0;  // [robot] look_mm
  for (const std::size_t arm : {0UL, 1UL})
    for (int k = 1; k <= 18; ++k) {
      const Pose T_base_robot = arm == 0 ? Pose{} : cell.further[0].T_base_robot;
      const Pose& T_flange_scanner = arm == 0 ? cell.T_flange_scanner : cell.further[0].T_flange_scanner;
      const Pose T_base_scanner = T_base_robot * slab.value().aside[arm] * T_flange_scanner;
      const Vec3 p = T_base_scanner.inverse() * (cell.T_base_slab * T_slab_block(recipe, k).translation_mm);
      EXPECT_GT(std::hypot(p.x(), p.y()), kLookMax_mm) << "arm " << arm << ", block " << k;
    }
}

TEST(SlabScene, defects_change_their_block_and_no_other) {
  const Recipe recipe = cli::reference_recipe();
  const std::vector<Defect> defects = {{DefectKind::slope, 4, 36.0},
                                       {DefectKind::jaw_distance, 9, 0.8},
                                       {DefectKind::lateral, 12, -0.9},
                                       {DefectKind::missing, 17, 0.0}};
  const auto with = cast_slab(recipe, some_cell(), SlabVariation{}, defects);
  const auto without = cast_slab(recipe, some_cell(), SlabVariation{}, {});
  ASSERT_TRUE(with && without);
  for (int k = 1; k <= 18; ++k) {
    const StationTruth& a = with.value().at(k);
    const StationTruth& b = without.value().at(k);
    EXPECT_EQ(a.block.slope_rad == b.block.slope_rad, k != 4) << k;
    EXPECT_NEAR(a.block.jaw_distance_mm - b.block.jaw_distance_mm, k == 9 ? 0.8 : 0.0, 1e-12) << k;
    EXPECT_NEAR(a.offset_slab_mm.y() - b.offset_slab_mm.y(), k == 12 ? -0.9 : 0.0, 1e-12) << k;
    EXPECT_EQ(a.block.present, k != 17) << k;
  }
  EXPECT_NEAR(with.value().at(4).block.slope_rad, std::atan(1.0 / 36.0), 1e-15);
}

TEST(SlabScene, robot_defect_moves_the_report_and_not_the_robot) {
  const Recipe recipe = cli::reference_recipe();
  const std::vector<Defect> defects = {{DefectKind::robot, 5, 1.0}};
  const auto slab = cast_slab(recipe, some_cell(), exact(), defects);
  ASSERT_TRUE(slab);
  const StationTruth& truth = slab.value().at(5);
  const Vec3 off = truth.T_base_flange_reported.translation_mm - truth.T_base_flange_real.translation_mm;
  EXPECT_NEAR(off.norm(), 1.0, 1e-9);
  EXPECT_NEAR(off.dot(some_cell().T_base_slab.rotation * Vec3::UnitZ()), 1.0, 1e-9);
}

TEST(SlabScene, defects_of_the_slab_are_its_items_and_leave_the_others_alone) {
  const Recipe recipe = cli::reference_recipe();
  const auto slab = cast_slab(recipe, some_cell(), exact(),
                              std::vector<Defect>{{DefectKind::corner_level, 0, 1.2},
                                                  {DefectKind::warp_left, 0, 2.0},
                                                  {DefectKind::warp_right, 0, -1.0},
                                                  {DefectKind::along, 3, 0.7},
                                                  {DefectKind::large_jaw, 6, 0.9}});
  ASSERT_TRUE(slab);
  const auto truth = [&](ItemId id, int k = 0) { return true_slab_value(recipe, slab.value(), id, k); };
  EXPECT_NEAR(truth(ItemId::corner_level), 1.2, 1e-9);
  EXPECT_NEAR(truth(ItemId::warp_left), 2.0, 1e-9);
  EXPECT_NEAR(truth(ItemId::warp_right), -1.0, 1e-9);
  EXPECT_NEAR(truth(ItemId::seat_spacing, 1), 630.0, 1e-9);
  EXPECT_NEAR(truth(ItemId::seat_spacing, 2), 630.7, 1e-9);
  EXPECT_NEAR(truth(ItemId::seat_spacing, 3), 629.3, 1e-9);
  // Difference without twist and bend, which tilt the pair's blocks relative to each other; the planted 0.9 mm.
  EXPECT_NEAR(truth(ItemId::large_jaw_distance, 6) - truth(ItemId::large_jaw_distance, 4), 0.9, 2e-3);
  EXPECT_NEAR(truth(ItemId::large_jaw_distance, 4), 1895.38, 5e-3);
  EXPECT_EQ(true_value(recipe, slab.value().at(6), ItemId::jaw_distance),
            true_value(recipe, slab.value().at(5), ItemId::jaw_distance));
  EXPECT_TRUE(std::isnan(truth(ItemId::seat_slope, 3)));
  // The top moves with a bent slab.
  EXPECT_NEAR(slab.value().at(5).offset_slab_mm.z(), 2.0, 0.01);
  EXPECT_EQ(slab.value().at(5).block.slab_top_shift_mm, 0.0);
}

TEST(SlabScene, robot_repeatability_has_its_standard_deviation_and_is_new_for_every_slab) {
  const Recipe recipe = cli::reference_recipe();
  SlabVariation variation = exact();
  variation.robot_sigma_mm = 0.017;
  variation.robot_sigma_deg = 0.002;
  double sum2_mm2 = 0.0;
  double sum2_deg2 = 0.0;
  Vec3 first = Vec3::Zero();
  for (std::uint32_t slab_no = 1; slab_no <= 60; ++slab_no) {
    variation.slab_no = slab_no;
    const auto slab = cast_slab(recipe, some_cell(), variation, {});
    ASSERT_TRUE(slab);
    for (int k = 1; k <= 18; ++k) {
      const StationTruth& truth = slab.value().at(k);
      sum2_mm2 += (truth.T_base_flange_real.translation_mm - truth.T_base_flange_reported.translation_mm).squaredNorm();
      const double turn =
          deg_from_rad(angle_between_rad(truth.T_base_flange_real.rotation, truth.T_base_flange_reported.rotation));
      sum2_deg2 += turn * turn;
    }
    const Vec3 at_one = slab.value().at(1).T_base_flange_real.translation_mm;
    EXPECT_NE(at_one, first);
    first = at_one;
  }
  // 3240 components: 1.24 % standard error.
  EXPECT_NEAR(std::sqrt(sum2_mm2 / 3240.0), 0.017, 0.05 * 0.017);
  EXPECT_NEAR(std::sqrt(sum2_deg2 / 3240.0), 0.002, 0.05 * 0.002);
}

TEST(SlabScene, good_casting_stays_well_inside_the_tolerances) {
  const Recipe recipe = cli::reference_recipe();
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    SlabVariation variation;
    variation.seed = seed;
    const auto slab = cast_slab(recipe, some_cell(), variation, {});
    ASSERT_TRUE(slab);
    for (int k = 1; k <= 18; ++k)
      for (const ItemId id : {ItemId::seat_slope, ItemId::jaw_angle_inner, ItemId::jaw_angle_outer,
                              ItemId::jaw_distance, ItemId::casing_spacing, ItemId::casing_protrusion_inner}) {
        const Tolerance& t = recipe.tolerance(id);
        const double value = true_value(recipe, slab.value().at(k), id);
        EXPECT_GT(value, t.lower + t.U) << info(id).name << " block " << k << " seed " << seed;
        EXPECT_LT(value, t.upper - t.U) << info(id).name << " block " << k << " seed " << seed;
      }
  }
}

TEST(SlabScene, is_decided_by_seed_and_slab_number) {
  const Recipe recipe = cli::reference_recipe();
  SlabVariation variation;
  const auto first = cast_slab(recipe, some_cell(), variation, {});
  const auto again = cast_slab(recipe, some_cell(), variation, {});
  variation.slab_no = 2;
  const auto other = cast_slab(recipe, some_cell(), variation, {});
  ASSERT_TRUE(first && again && other);
  EXPECT_EQ(first.value().T_base_slab.translation_mm, again.value().T_base_slab.translation_mm);
  EXPECT_EQ(first.value().at(3).block.jaw_distance_mm, again.value().at(3).block.jaw_distance_mm);
  EXPECT_NE(first.value().T_base_slab.translation_mm, other.value().T_base_slab.translation_mm);
  EXPECT_NE(first.value().at(3).block.jaw_distance_mm, other.value().at(3).block.jaw_distance_mm);
  // The robot's error does not depend on the slab.
  EXPECT_EQ(first.value().at(3).T_base_flange_real.translation_mm,
            other.value().at(3).T_base_flange_real.translation_mm);
}

TEST(SlabScene, defect_on_a_block_the_recipe_does_not_have_is_refused) {
  Recipe recipe = cli::reference_recipe();
  recipe.slab.pairs = 8;
  const std::vector<Defect> defects = {{DefectKind::missing, 17, 0.0}};
  const auto slab = cast_slab(recipe, some_cell(), SlabVariation{}, defects);
  ASSERT_FALSE(slab);
  EXPECT_NE(slab.error().text.view().find("1..16"), std::string_view::npos);
}

}  // namespace
}  // namespace slabd::emulator
