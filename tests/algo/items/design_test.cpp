// SPDX-License-Identifier: Apache-2.0
//
// Curve slabs against the straight slab with the same casting errors.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "base/jobs.h"
#include "item_simulation.h"
#include "tests/algo/block_inspection.h"

namespace slabd {
namespace {

/// A curve slab: up to 15 mm across, 8 mm up, 4 mm along and 0.3 degrees, smooth along the slab as a track is.
SlabDesign curve(Prng& prng, const Recipe& recipe) {
  const auto around = [&](double reach) { return reach * (2.0 * prng.uniform() - 1.0); };
  const double bend = around(1.0);
  const double cant_mm = around(8.0);
  const double slope_deg = around(0.3);
  SlabDesign design;
  design.given = true;
  for (int station = 1; station <= recipe.stations(); ++station) {
    const bool left = station <= recipe.slab.pairs;
    const Vec3 place = T_slab_block(recipe, station).translation_mm;
    const double along = place.x() / 2'520.0;
    SeatDesign& seat = design.seats[static_cast<std::size_t>(station - 1)];
    seat.offset_mm = Vec3((left ? 1.0 : -1.0) * 4.0 * bend * along, 15.0 * bend * (along * along - 0.5),
                          (left ? 1.0 : -1.0) * cant_mm * 0.5 * (1.0 + along));
    seat.slope_rad = rad_from_deg((left ? 1.0 : -1.0) * slope_deg);
  }
  return design;
}

/// The seats of a straight slab, moved to where the mould of the design has them.
void move_to(const SlabDesign& design, const Recipe& recipe, std::vector<BlockResult>& blocks) {
  const Pose T_base_slab = simulation::Line::T_base_slab();
  for (int station = 1; station <= recipe.stations(); ++station) {
    BlockResult& block = blocks[static_cast<std::size_t>(station - 1)];
    const Pose T = T_slab_block(recipe, station);
    const SeatDesign& seat = design.at(station);
    const Pose in_block{Quat(Eigen::AngleAxisd(seat.slope_rad, Vec3::UnitX())), Vec3::Zero()};
    const Pose moved{Quat::Identity(), seat.offset_mm};
    const Pose M = T_base_slab * moved * T * in_block * T.inverse() * T_base_slab.inverse();
    SeatObservation& o = block.observation;
    o.p_base = M * o.p_base;
    o.jaw_outer_base = M * o.jaw_outer_base;
    o.n_base = M.rotation * o.n_base;
    // A block's own slope is measured against the slab's top, which the mould does not turn.
    for (Item& item : block.items)
      if (item.id == ItemId::seat_slope) {
        const double shift = deg_from_rad(seat.slope_rad);
        item.value += shift;
        const Item designed = designed_item(recipe, design, item.id, station);
        item.nominal = designed.nominal;
        item.lower = designed.lower;
        item.upper = designed.upper;
        item.verdict = judge(item, recipe.guard);
      }
  }
}

/// True if every judged item of the slab passes. The simulated blocks have no flatness, so that no slab does.
bool all_pass(const SlabResult& slab) {
  return std::all_of(slab.items.begin(), slab.items.end(), [](const Item& item) {
    return item.verdict == Verdict::pass || (!has_value(item.lower) && !has_value(item.upper));
  });
}

SlabFacts with(const SlabDesign& design) {
  SlabFacts facts;
  facts.design = design;
  return facts;
}

TEST(Design, a_curve_slab_has_the_verdicts_of_the_straight_one_with_the_same_errors) {
  const Recipe recipe = simulation::recipe_with_uncertainty();
  const simulation::Line line(recipe, {0.02, rad_from_deg(0.001)});
  Prng prng(11);
  int differ = 0;
  int passed = 0;
  for (int i = 0; i < 1'000; ++i) {
    const simulation::BuiltSlab built = simulation::varied(recipe, prng);
    const simulation::Measured straight = line.measure(built, simulation::Errors{}, prng);
    const SlabDesign design = curve(prng, recipe);
    std::vector<BlockResult> blocks = straight.blocks;
    move_to(design, recipe, blocks);
    SlabResult slab;
    algo::inspect_slab(recipe, blocks, line.sigma(), line.T_base_slab(), slab, {}, with(design));
    ASSERT_EQ(slab.items.size(), straight.slab.items.size());
    for (std::size_t k = 0; k < slab.items.size(); ++k) {
      const Item& a = straight.slab.items[k];
      const Item& b = slab.items[k];
      EXPECT_NEAR(b.deviation(), a.deviation(), 0.02) << info(a.id).name << int{a.station} << " of slab " << i;
      if (a.verdict != b.verdict) ++differ;
    }
    passed += all_pass(slab) ? 1 : 0;
  }
  // A value at its very limit may fall to either side: levers and the frame's weights are those of a turned seat.
  EXPECT_LE(differ, 1'000 * 100 / 500) << "items of 100,000";
  EXPECT_GT(passed, 0);
}

TEST(Design, a_large_jaw_distance_counts_for_the_jaw_that_is_out_of_its_designed_place) {
  const Recipe recipe = simulation::recipe_with_uncertainty();
  const simulation::Line line(recipe, {0.02, rad_from_deg(0.001)});
  for (const double bend_mm : {-8.0, 0.0, 8.0}) {
    for (const int station : {3, 16}) {
      SCOPED_TRACE(testing::Message() << "bend " << bend_mm << " mm, station " << station);
      Prng prng(13);
      std::vector<BlockResult> blocks = line.measure(simulation::nominal(recipe), simulation::none(), prng).blocks;
      SlabDesign design;
      design.given = true;
      for (int i = 1; i <= recipe.stations(); ++i)
        design.seats[static_cast<std::size_t>(i - 1)].offset_mm = Vec3(0.0, bend_mm, 0.0);
      move_to(design, recipe, blocks);
      // Too far inward by more than the tolerance.
      const double inward = station == 3 ? -1.6 : 1.6;
      blocks[static_cast<std::size_t>(station - 1)].observation.jaw_outer_base +=
          line.T_base_slab().rotation * Vec3(0.0, inward, 0.0);
      SlabResult slab;
      algo::inspect_slab(recipe, blocks, line.sigma(), line.T_base_slab(), slab, {}, with(design));
      EXPECT_EQ(slab.station_verdict[static_cast<std::size_t>(station - 1)], Verdict::fail);
      EXPECT_EQ(slab.station_reason[static_cast<std::size_t>(station - 1)], 613);
      EXPECT_NE(slab.station_verdict[static_cast<std::size_t>(18 - station)], Verdict::fail);
    }
  }
}

TEST(Design, the_neighbour_s_sheet_and_the_straight_nominal_never_pass) {
  const Recipe recipe = simulation::recipe_with_uncertainty();
  const simulation::Line line(recipe, {0.02, rad_from_deg(0.001)});
  Prng prng(12);
  const simulation::Measured straight = line.measure(simulation::nominal(recipe), simulation::none(), prng);
  int own = 0;
  for (int i = 0; i < 200; ++i) {
    const SlabDesign design = curve(prng, recipe);
    std::vector<BlockResult> blocks = straight.blocks;
    move_to(design, recipe, blocks);
    const auto passes_by = [&](const SlabDesign& sheet) {
      SlabResult slab;
      algo::inspect_slab(recipe, blocks, line.sigma(), line.T_base_slab(), slab, {}, with(sheet));
      return all_pass(slab);
    };
    own += passes_by(design) ? 1 : 0;
    EXPECT_FALSE(passes_by(curve(prng, recipe))) << i;
    EXPECT_FALSE(passes_by(SlabDesign{})) << i;
  }
  EXPECT_EQ(own, 200);
}

TEST(Design, shifts_nominal_and_limits_together) {
  Recipe recipe = scene::p5600();
  SlabDesign design;
  design.given = true;
  design.seats[0] = {Vec3(1.0, 2.0, 3.0), rad_from_deg(0.2)};
  const auto shift = [&](ItemId id, int station, int to) {
    const Item plain = blank_item(recipe, id, station, to);
    const Item item = designed_item(recipe, design, id, station, to);
    EXPECT_NEAR(item.upper - plain.upper, item.nominal - plain.nominal, 1e-12) << info(id).name;
    if (has_value(plain.lower)) {
      EXPECT_NEAR(item.lower - plain.lower, item.nominal - plain.nominal, 1e-12);
    }
    return item.nominal - plain.nominal;
  };
  EXPECT_NEAR(shift(ItemId::seat_slope, 1, 0), 0.2, 1e-12);
  EXPECT_NEAR(shift(ItemId::seat_spacing, 1, 2), -1.0, 1e-12);
  EXPECT_NEAR(shift(ItemId::seat_spacing, 2, 3), 0.0, 1e-12);
  EXPECT_NEAR(shift(ItemId::seat_lateral, 1, 0), 0.0, 1e-12) << "a deviation from the designed place";
  EXPECT_NEAR(shift(ItemId::corner_level, 0, 0), 3.0, 1e-12);
  EXPECT_NEAR(shift(ItemId::warp_left, 0, 0), -1.5, 1e-3);
  EXPECT_NEAR(shift(ItemId::warp_right, 0, 0), 0.0, 1e-12);
  EXPECT_NEAR(shift(ItemId::large_jaw_distance, 1, 18), 2.0, 0.1);
  EXPECT_NEAR(shift(ItemId::jaw_distance, 1, 0), 0.0, 1e-12);
}

TEST(Design, a_stored_design_that_cannot_be_read_measures_nothing) {
  SlabHeader header;
  header.design_text = "1,0,0,0,0;2,x";
  const SlabFacts facts = facts_of(header);
  EXPECT_TRUE(facts.design.given);
  EXPECT_FALSE(T_slab_block(scene::p5600(), facts.design, 3).translation_mm.allFinite());
  for (const char* text : {"x", "1", "1,2,3,4,5", "0,0,0,0,0;", "19,0,0,0,0;", "1,0,0,0,nan;", "1,,0,0,0;", ";"})
    EXPECT_FALSE(parse_design(text).ok()) << text;
  EXPECT_FALSE(parse_design("").value().given);
}

/// The seat of a curve slab is drawn 6 mm higher above the slab's top and steeper by 0.3 degrees.
TEST(Design, a_block_is_measured_as_it_is_designed) {
  scene::Block block;
  block.cant_ratio = 1.0 / std::tan(std::atan(1.0 / 40.0) + rad_from_deg(0.3));
  scene::Scan scan;
  SlabDesign design;
  design.given = true;
  design.seats[3] = {Vec3::Zero(), rad_from_deg(0.3)};
  const BlockResult designed =
      algo::inspect(scene::take(block, scan), scene::p5600(), Pose::identity(), 0, with(design));
  const Item& slope = algo::item(designed, ItemId::seat_slope);
  EXPECT_EQ(slope.verdict, Verdict::pass) << slope.value << " of " << slope.nominal;
  EXPECT_NEAR(slope.deviation(), 0.0, 0.003);
  EXPECT_EQ(algo::item(algo::inspect(scene::take(block, scan)), ItemId::seat_slope).verdict, Verdict::fail)
      << "as a straight slab";
  // The next straight block is measured as before.
  EXPECT_EQ(algo::inspect(scene::Block{}).verdict, Verdict::pass);
}

}  // namespace
}  // namespace slabd
