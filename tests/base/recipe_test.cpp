// SPDX-License-Identifier: Apache-2.0
#include "base/recipe.h"

#include <gtest/gtest.h>

namespace slabd {
namespace {

Recipe slab(int pairs, double length_mm, double pitch_mm, double overhang_mm) {
  Recipe recipe;
  recipe.slab.pairs = static_cast<std::uint8_t>(pairs);
  recipe.slab.length_mm.value = length_mm;
  recipe.slab.pitch_mm.value = pitch_mm;
  recipe.slab.first_pair_from_end_mm.value = overhang_mm;
  recipe.slab.seat_centre_distance_mm.value = 1516.0;
  recipe.slab.block_origin_z_mm.value = 30.0;
  return recipe;
}

TEST(SlabGeometry, numbers_blocks_the_robots_way_round) {
  const Recipe p5600 = slab(9, 5600, 630, 280);
  const auto at = [&](int station) { return T_slab_block(p5600, station).translation_mm; };
  EXPECT_EQ(at(1), Vec3(-2520, 758, 30));
  EXPECT_EQ(at(9), Vec3(2520, 758, 30));
  EXPECT_EQ(at(10), Vec3(2520, -758, 30));
  EXPECT_EQ(at(18), Vec3(-2520, -758, 30));
  for (int station = 1; station <= 18; ++station) {
    EXPECT_EQ(at(station).x(), at(opposite_station(p5600, station)).x()) << station;
    EXPECT_EQ(at(station).y(), -at(opposite_station(p5600, station)).y()) << station;
    // Y of every block points away from the track centre.
    const Vec3 outward = T_slab_block(p5600, station).rotation * Vec3(0, 1, 0);
    EXPECT_GT(outward.y() * at(station).y(), 0.0) << station;
  }
}

TEST(SlabGeometry, another_type_is_other_numbers_only) {
  const Recipe p4925 = slab(8, 4925, 617, 303);
  EXPECT_EQ(p4925.stations(), 16);
  EXPECT_NEAR(T_slab_block(p4925, 8).translation_mm.x(), 2159.5, 1e-9);
  EXPECT_NEAR(T_slab_block(p4925, 9).translation_mm.x(), 2159.5, 1e-9);
  EXPECT_EQ(opposite_station(p4925, 1), 16);
}

TEST(NominalView, looks_straight_down_on_the_block) {
  const Pose T = nominal_T_block_scanner();
  EXPECT_LT((T * Vec3(0, 0, 600)).norm(), 1e-12);
  EXPECT_LT((T.rotation * Vec3(0, 0, 1) - Vec3(0, 0, -1)).norm(), 1e-12);
}

TEST(BlankItem, starts_as_not_measured_with_the_recipes_limits) {
  Recipe recipe;
  Tolerance& t = recipe.tolerances[static_cast<std::size_t>(ItemId::jaw_distance)];
  t.nominal.value = 380.0;
  t.lower = 379.5;
  t.upper = 380.5;
  t.U = 0.15;
  t.required = true;
  const Item item = blank_item(recipe, ItemId::jaw_distance, 4);
  EXPECT_EQ(item.verdict, Verdict::not_measured);
  EXPECT_FALSE(has_value(item.value));
  EXPECT_TRUE(item.required);
  EXPECT_EQ(item.upper, 380.5);
  EXPECT_EQ(item.station, 4);
}

}  // namespace
}  // namespace slabd
