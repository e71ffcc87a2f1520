// SPDX-License-Identifier: Apache-2.0
#include "emulator/concrete_block.h"

#include <gtest/gtest.h>

#include "tests/config/reference_recipe.h"

namespace slabd::emulator {
namespace {

/// A block with the drawing's dimensions and without marks.
ConcreteOrder bare(const Recipe& recipe) {
  ConcreteOrder order;
  order.truth = nominal_truth(recipe);
  order.node_mm = 0.5;
  return order;
}

ConcreteBlock cast_with(const Recipe& recipe, std::string_view effect, double strength, std::uint64_t seed = 1,
                        double node_mm = 0.5) {
  ConcreteOrder order = bare(recipe);
  order.seed = seed;
  order.node_mm = node_mm;
  EXPECT_EQ(order.effects.take(std::string(effect) + "=" + std::to_string(strength)), std::nullopt);
  return ConcreteBlock::cast(recipe, order);
}

TEST(ConcreteBlock, bare_block_is_the_drawing) {
  const Recipe recipe = cli::reference_recipe();
  const ConcreteBlock block = ConcreteBlock::cast(recipe, bare(recipe));
  for (const double y : {-150.0, -70.0, 0.0, 33.3, 170.0})
    EXPECT_NEAR(block.field().height_mm(50.0, y), y / 40.0, 1e-5) << y;
  EXPECT_NEAR(block.field().height_mm(0.0, 220.0), 29.75, 1e-5);
  EXPECT_NEAR(block.field().height_mm(0.0, -220.0), 20.25, 1e-5);
  EXPECT_NEAR(block.field().height_mm(150.0, 0.0), -30.0, 1e-5);
  EXPECT_NEAR(block.field().height_mm(107.0, 0.0), (105.0 - 107.0) / std::tan(recipe.block.draft_rad.value), 1e-4);
  EXPECT_LT(block.truth().flatness_raw_mm, 1e-5);
  EXPECT_EQ(block.truth().flatness_form_mm, block.truth().flatness_raw_mm);
  EXPECT_TRUE(block.truth().marks.empty());
}

TEST(ConcreteBlock, fillet_at_the_jaw_has_its_radius) {
  const Recipe recipe = cli::reference_recipe();
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    const ConcreteBlock block = cast_with(recipe, "fillet", 1.0, seed, 0.25);
    for (std::size_t side = 0; side < 2; ++side) {
      const double radius = block.truth().fillet_mm[side + 1];
      EXPECT_GE(radius, 3.0);
      EXPECT_LE(radius, 5.0);
      // Gap between the corner and a circle that touches both of its faces.
      const double gap = radius * (1.0 / std::sin(0.5 * recipe.block.jaw_angle_rad.value) - 1.0);
      const Vec3& corner = block.jaw_corners()[side];
      double nearest = 1e9;
      for (double dy = -6.0; dy <= 6.0; dy += 0.01) {
        const double y = corner.y() + dy;
        nearest = std::min(nearest, std::hypot(dy, block.field().height_mm(0.0, y) - corner.z()));
      }
      EXPECT_NEAR(nearest, gap, 0.01) << side;
    }
  }
}

TEST(ConcreteBlock, pores_are_as_many_and_as_large_as_asked_for) {
  const Recipe recipe = cli::reference_recipe();
  const auto pores_of = [&](double strength) {
    const ConcreteBlock block = cast_with(recipe, "voids", strength);
    for (const PlantedMark& mark : block.truth().marks) {
      EXPECT_EQ(mark.kind, MarkKind::pore);
      EXPECT_GE(mark.length_mm * mark.width_mm, 0.25 - 1e-9);
      EXPECT_LE(mark.length_mm * mark.width_mm, 64.0 + 1e-9);
      EXPECT_LE(mark.depth_mm, 3.0);
      EXPECT_GT(mark.depth_mm, 0.0);
    }
    return block.truth().marks.size();
  };
  // Some pores are on the casings, which are plastic.
  EXPECT_GE(pores_of(1.0), 70U);
  EXPECT_LE(pores_of(1.0), 80U);
  EXPECT_GE(pores_of(0.25), 15U);
  EXPECT_LE(pores_of(0.25), 20U);
}

TEST(ConcreteBlock, the_pore_is_where_the_truth_has_it) {
  const Recipe recipe = cli::reference_recipe();
  const ConcreteBlock block = cast_with(recipe, "voids", 1.0, 1, 0.25);
  const PlantedMark* largest = nullptr;
  for (const PlantedMark& mark : block.truth().marks)
    if (mark.in_crop && (largest == nullptr || mark.depth_mm > largest->depth_mm)) largest = &mark;
  ASSERT_NE(largest, nullptr);
  EXPECT_NEAR(block.field().height_mm(largest->x_mm, largest->y_mm), largest->z_mm - largest->depth_mm,
              0.15 * largest->depth_mm);
  EXPECT_GT(block.truth().flatness_raw_mm, 0.05);
  EXPECT_LT(block.truth().flatness_form_mm, 1e-5);
}

TEST(ConcreteBlock, raw_flatness_is_no_less_than_that_of_the_form) {
  const Recipe recipe = cli::reference_recipe();
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    ConcreteOrder order = bare(recipe);
    order.effects = EffectStrengths(SurfaceKind::real);
    order.seed = seed;
    const ConcreteBlock block = ConcreteBlock::cast(recipe, order);
    EXPECT_GE(block.truth().flatness_raw_mm, block.truth().flatness_form_mm);
    EXPECT_GT(block.truth().flatness_form_mm, 0.02);
    EXPECT_LT(block.truth().flatness_form_mm, 0.15);
    EXPECT_LT(block.truth().raw_low_mm, 0.0);
    EXPECT_GT(block.truth().raw_high_mm, 0.0);
  }
}

TEST(ConcreteBlock, grain_and_waviness_leave_the_seat_plane_where_it_is) {
  const Recipe recipe = cli::reference_recipe();
  ConcreteOrder order = bare(recipe);
  order.effects.set(Effect::grain, 2.0);
  order.effects.set(Effect::wave, 3.0);
  const ConcreteBlock block = ConcreteBlock::cast(recipe, order);
  PlaneSums sums;
  for (double x = -51.0; x <= 51.0; x += 0.5)
    for (double y = -74.5; y <= 74.5; y += 0.5) sums.add(x, y, block.field().height_mm(x, y) - y / 40.0);
  const Vec3 plane = sums.plane();
  EXPECT_LT(std::abs(plane[0]), 1e-3);
  EXPECT_LT(std::abs(plane[1]), 1e-5);
  EXPECT_LT(std::abs(plane[2]), 1e-5);
  EXPECT_GT(block.truth().flatness_form_mm, 0.05);
}

TEST(ConcreteBlock, a_dome_of_the_line_is_on_the_concrete_too) {
  const Recipe recipe = cli::reference_recipe();
  ConcreteOrder order = bare(recipe);
  order.truth.bump_mm = 1.0;
  const ConcreteBlock block = ConcreteBlock::cast(recipe, order);
  EXPECT_NEAR(block.truth().value(ItemId::seat_flatness), true_flatness_mm(recipe, order.truth), 0.01);
}

TEST(ConcreteBlock, defects_of_dimension_are_in_the_truth) {
  const Recipe recipe = cli::reference_recipe();
  ConcreteOrder order = bare(recipe);
  for (const char* text :
       {"slope=0.15", "jaw_distance=0.8", "jaw_angle=1.4", "casing_out=0.35", "casing_sunk=0.45", "spacing=0.9"})
    order.defects.push_back(parse_concrete_defect(text).value());
  const ConcreteTruth truth = ConcreteBlock::cast(recipe, order).truth();
  EXPECT_NEAR(truth.value(ItemId::seat_slope), deg_from_rad(std::atan(0.025)) + 0.15, 1e-9);
  EXPECT_NEAR(truth.value(ItemId::jaw_distance), 380.8, 1e-9);
  EXPECT_NEAR(truth.value(ItemId::jaw_angle_outer), 111.4, 1e-9);
  EXPECT_NEAR(truth.value(ItemId::jaw_angle_inner), 110.0, 1e-9);
  EXPECT_NEAR(truth.value(ItemId::casing_protrusion_outer), 0.35, 1e-9);
  EXPECT_NEAR(truth.value(ItemId::casing_protrusion_inner), -0.7, 1e-9);
  EXPECT_NEAR(truth.value(ItemId::casing_spacing), 233.9, 1e-9);
}

TEST(ConcreteBlock, defects_of_form_have_their_size) {
  const Recipe recipe = cli::reference_recipe();
  for (const char* text : {"depression=0.9", "hump=1.2", "bow=1.3"}) {
    ConcreteOrder order = bare(recipe);
    order.defects.push_back(parse_concrete_defect(text).value());
    const ConcreteTruth truth = ConcreteBlock::cast(recipe, order).truth();
    EXPECT_NEAR(truth.flatness_form_mm, order.defects[0].size, 0.12) << text;
  }
}

TEST(ConcreteBlock, damage_is_listed_and_lowers_the_surface) {
  const Recipe recipe = cli::reference_recipe();
  for (const char* text : {"chip_corner", "chip_seat", "chip_jaw", "crack"}) {
    ConcreteOrder order = bare(recipe);
    const ConcreteBlock whole = ConcreteBlock::cast(recipe, order);
    order.defects.push_back(parse_concrete_defect(text).value());
    const ConcreteBlock broken = ConcreteBlock::cast(recipe, order);
    ASSERT_EQ(broken.truth().marks.size(), 1U) << text;
    float deepest = 0.0F;
    for (std::size_t node = 0; node < whole.field().columns() * whole.field().rows(); ++node)
      deepest = std::max(deepest, whole.field().z(node) - broken.field().z(node));
    EXPECT_GT(deepest, 1.0F) << text;
  }
}

TEST(ConcreteBlock, the_same_order_gives_the_same_bits) {
  const Recipe recipe = cli::reference_recipe();
  ConcreteOrder order = bare(recipe);
  order.effects = EffectStrengths(SurfaceKind::real);
  const ConcreteBlock a = ConcreteBlock::cast(recipe, order);
  const ConcreteBlock b = ConcreteBlock::cast(recipe, order);
  order.seed = 2;
  const ConcreteBlock c = ConcreteBlock::cast(recipe, order);
  std::size_t differ = 0;
  for (std::size_t node = 0; node < a.field().columns() * a.field().rows(); ++node) {
    ASSERT_EQ(a.field().z(node), b.field().z(node));
    differ += a.field().z(node) != c.field().z(node) ? 1U : 0U;
  }
  EXPECT_GT(differ, a.field().columns() * a.field().rows() / 2);
}

}  // namespace
}  // namespace slabd::emulator
