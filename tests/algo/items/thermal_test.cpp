// SPDX-License-Identifier: Apache-2.0
//
// Lengths at the reference temperature, from slabs whose points really move apart.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include "item_simulation.h"
#include "tests/algo/block_inspection.h"

namespace slabd {
namespace {

constexpr double kConcrete_per_K = 1e-5;

ThermalSettings settings() {
  ThermalSettings t;
  t.given = true;
  t.reference_c = {20.0, true};
  t.cte_per_K = {kConcrete_per_K, true};
  t.u_cte_per_K = {1e-6, true};
  t.u_temperature_K = {2.0, true};
  t.unknown_low_c = {-10.0, true};
  t.unknown_high_c = {60.0, true};
  return t;
}

SlabFacts at(double temperature_c) {
  SlabFacts facts;
  facts.temperature_c = temperature_c;
  return facts;
}

const Item* find(const SlabResult& slab, ItemId id, int station) {
  for (const Item& item : slab.items)
    if (item.id == id && item.station == station) return &item;
  return nullptr;
}

/// Moves what was observed of every seat away from the slab's centre.
void expand(std::vector<BlockResult>& blocks, double expansion) {
  const Pose T_base_slab = simulation::Line::T_base_slab();
  const auto grow = [&](Vec3& p) { p = T_base_slab * Vec3((1.0 + expansion) * (T_base_slab.inverse() * p)); };
  for (BlockResult& block : blocks) {
    grow(block.observation.p_base);
    grow(block.observation.jaw_outer_base);
  }
}

TEST(Thermal, a_warm_slab_reads_what_it_has_at_the_reference) {
  Recipe recipe = simulation::recipe_with_uncertainty();
  recipe.thermal = settings();
  recipe.thermal.u_cte_per_K.value = recipe.thermal.u_temperature_K.value = 0.0;
  const simulation::Line line(recipe, {0.02, rad_from_deg(0.001)});
  Prng prng(5);
  const simulation::BuiltSlab built = simulation::varied(recipe, prng);
  for (const bool has_unequal_rows : {false, true}) {
    simulation::Measured cold = line.measure(built, simulation::none(), prng);
    if (has_unequal_rows)
      for (const std::size_t k : {0U, 1U, 2U}) cold.blocks[k] = {};
    algo::inspect_slab(recipe, cold.blocks, line.sigma(), line.T_base_slab(), cold.slab, {}, at(20.0));
    for (const double temperature_c : {-10.0, 60.0}) {
      std::vector<BlockResult> blocks = cold.blocks;
      expand(blocks, kConcrete_per_K * (temperature_c - 20.0));
      SlabResult warm;
      algo::inspect_slab(recipe, blocks, line.sigma(), line.T_base_slab(), warm, {}, at(temperature_c));
      ASSERT_EQ(warm.items.size(), cold.slab.items.size());
      double most_mm = 0.0;
      for (std::size_t i = 0; i < warm.items.size(); ++i) {
        const Item& item = warm.items[i];
        EXPECT_EQ(has_value(item.value), has_value(cold.slab.items[i].value));
        if (!has_value(item.value)) continue;
        EXPECT_NEAR(item.value, cold.slab.items[i].value, 1e-3) << info(item.id).name << int{item.station};
        EXPECT_EQ(item.verdict, cold.slab.items[i].verdict) << info(item.id).name << int{item.station};
        if (info(item.id).unit == ItemUnit::mm) most_mm = std::max(most_mm, std::abs(item.measured - item.value));
      }
      EXPECT_NEAR(most_mm, 1'896.0 * kConcrete_per_K * std::abs(temperature_c - 20.0), 0.02) << "across the track";
    }
  }
}

TEST(Thermal, the_displaced_one_of_two_seats_is_to_blame_at_any_temperature) {
  Recipe recipe = simulation::recipe_with_uncertainty();
  recipe.thermal = settings();
  const simulation::Line line(recipe, {0.02, rad_from_deg(0.001)});
  for (const double temperature_c : {-10.0, 20.0, 50.0}) {
    SCOPED_TRACE(temperature_c);
    Prng prng(3);
    std::vector<BlockResult> blocks = line.measure(simulation::nominal(recipe), simulation::none(), prng).blocks;
    expand(blocks, kConcrete_per_K * (temperature_c - 20.0));
    // Station 9 is at the end of its row: inward if the slab is warm, outward if it is cold.
    const Vec3 off_mm(temperature_c < 20.0 ? 1.2 : -1.2, 0.0, 0.0);
    const Vec3 off_base_mm = simulation::Line::T_base_slab().rotation * off_mm;
    blocks[8].observation.p_base += off_base_mm;
    blocks[8].observation.jaw_outer_base += off_base_mm;
    SlabResult slab;
    algo::inspect_slab(recipe, blocks, line.sigma(), line.T_base_slab(), slab, {}, at(temperature_c));
    EXPECT_EQ(slab.station_verdict[8], Verdict::fail);
    EXPECT_NE(slab.station_verdict[7], Verdict::fail);
  }
}

TEST(Thermal, without_the_recipe_s_table_nothing_is_corrected) {
  const simulation::Line line(simulation::recipe_with_uncertainty(), {0.02, rad_from_deg(0.001)});
  Prng prng(6);
  simulation::Measured m = line.measure(simulation::nominal(line.recipe()), simulation::none(), prng);
  SlabResult warm;
  algo::inspect_slab(line.recipe(), m.blocks, line.sigma(), line.T_base_slab(), warm, {}, at(45.0));
  for (std::size_t i = 0; i < warm.items.size(); ++i) {
    const Item& item = warm.items[i];
    EXPECT_FALSE(has_value(item.measured));
    EXPECT_TRUE(item.value == m.slab.items[i].value || !has_value(item.value));
    EXPECT_EQ(item.budget[static_cast<std::size_t>(BudgetPart::thermal)], 0.0);
  }
}

/// Temperature and expansion drawn from the recipe's assumptions; the PLC's value is off, or missing.
void expect_coverage(bool is_known) {
  Recipe recipe = simulation::recipe_with_uncertainty();
  recipe.thermal = settings();
  const simulation::Line line(recipe, {0.02, rad_from_deg(0.001), 0.017, 1e-5});
  Prng prng(is_known ? 7 : 8);
  std::map<ItemId, std::array<int, 2>> covered;
  for (int i = 0; i < 300; ++i) {
    const simulation::BuiltSlab built = simulation::varied(recipe, prng);
    simulation::Measured truth = line.measure(built, simulation::none(), prng);
    simulation::Measured measured = line.measure(built, simulation::Errors{}, prng);
    const double temperature_c = -10.0 + 70.0 * prng.uniform();
    const double cte = kConcrete_per_K + 1e-6 * prng.normal();
    expand(measured.blocks, cte * (temperature_c - 20.0));
    SlabResult slab;
    algo::inspect_slab(recipe, measured.blocks, line.sigma(), line.T_base_slab(), slab, {},
                       at(is_known ? temperature_c + 2.0 * prng.normal() : kNoValue));
    for (const ItemId id : {ItemId::seat_lateral, ItemId::seat_spacing, ItemId::large_jaw_distance}) {
      const int station = 1 + static_cast<int>(8.0 * prng.uniform());
      const Item* const item = find(slab, id, station);
      const Item* const real = find(truth.slab, id, station);
      ASSERT_TRUE(item != nullptr && real != nullptr);
      // The truth was measured without a temperature; its slab is at the reference.
      ++covered[id][std::abs(item->value - real->measured) <= item->U ? 1 : 0];
    }
  }
  for (const auto& [id, count] : covered)
    EXPECT_GE(count[1], static_cast<int>(300 * 0.935) - 17) << info(id).name << ", four standard deviations: 17";
}

TEST(Thermal, U_covers_with_the_temperature_known) {
  expect_coverage(true);
}
TEST(Thermal, U_covers_with_the_temperature_unknown) {
  expect_coverage(false);
}

TEST(Thermal, an_unknown_temperature_costs_uncertainty) {
  const Thermal unknown = thermal_of(settings(), kNoValue);
  EXPECT_EQ(unknown.expansion, 0.0);
  // Mean square over -30..40 K.
  EXPECT_NEAR(unknown.u, std::sqrt((1e-10 + 1e-12) * (64'000.0 + 27'000.0) / (3.0 * 70.0)), 1e-12);
  const Thermal known = thermal_of(settings(), 50.0);
  EXPECT_NEAR(known.expansion, 3e-4, 1e-15);
  EXPECT_NEAR(known.u, std::hypot(2e-5, 3e-5), 1e-12);
  EXPECT_LT(known.u, unknown.u);
}

TEST(Thermal, a_temperature_that_no_slab_has_is_unknown) {
  EXPECT_NEAR(slab_temperature_c(2931), 19.95, 1e-9);
  for (const int dk : {0, 200, 2431, 3532, 6000, 65535})
    EXPECT_FALSE(has_value(slab_temperature_c(static_cast<std::uint16_t>(dk)))) << dk;
  for (const int dk : {2432, 3531}) EXPECT_TRUE(has_value(slab_temperature_c(static_cast<std::uint16_t>(dk)))) << dk;
}

TEST(Thermal, a_warm_block_s_lengths_are_those_at_the_reference) {
  scene::Block block;
  block.jaw_distance_mm = 380.3;
  const auto measured = [&](double expansion, double temperature_c) {
    scene::Cloud cloud = scene::take(block, scene::Scan{});
    const Vec3 origin = cloud.T_block_scanner.inverse().translation_mm;
    for (std::size_t i = 0; i < cloud.xyz.size(); ++i)
      cloud.xyz[i] += static_cast<float>(
          expansion * (static_cast<double>(cloud.xyz[i]) - origin[static_cast<Eigen::Index>(i % 3)]));
    Recipe recipe = scene::p5600();
    recipe.thermal = settings();
    return algo::inspect(std::move(cloud), recipe, Pose::identity(), 0, at(temperature_c));
  };
  const BlockResult cold = measured(0.0, 20.0);
  const BlockResult warm = measured(4e-4, 60.0);
  for (const ItemId id : {ItemId::jaw_distance, ItemId::casing_spacing}) {
    const Item& at_reference = algo::item(warm, id);
    EXPECT_NEAR(at_reference.value, algo::item(cold, id).value, 0.01) << info(id).name;
    EXPECT_NEAR(at_reference.measured - at_reference.value, 4e-4 * at_reference.value, 1e-6) << info(id).name;
    EXPECT_GT(at_reference.U, algo::item(cold, id).U) << info(id).name;
  }
  const Item& slope = algo::item(warm, ItemId::seat_slope);
  EXPECT_FALSE(has_value(slope.measured));
}

}  // namespace
}  // namespace slabd
