// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "algo/algo.h"
#include "base/jobs.h"
#include "tests/algo/scene.h"

namespace slabd::algo {
namespace {

/// Eighteen good blocks at their places, and a recipe with the items of gauges.
struct Slab {
  Recipe recipe = scene::p5600();
  std::vector<BlockResult> blocks = std::vector<BlockResult>(18);
  SlabFacts facts;

  Slab() {
    const double cant = std::atan(1.0 / 40.0);
    for (int station = 1; station <= 18; ++station) {
      BlockResult& b = blocks[static_cast<std::size_t>(station - 1)];
      b.station = static_cast<std::uint8_t>(station);
      Item item = blank_item(recipe, ItemId::jaw_distance, station);
      item.value = item.nominal;
      item.verdict = Verdict::pass;
      EXPECT_TRUE(b.items.push(item));
      b.verdict = Verdict::pass;
      const Pose T = T_slab_block(recipe, station);
      SeatObservation& o = b.observation;
      o.ok = o.jaw_ok = o.top_ok = true;
      o.p_base = T.translation_mm;
      o.n_base = T.rotation * Vec3(0.0, -std::sin(cant), std::cos(cant));
      o.jaw_outer_base =
          T * Vec3(0.0, 190.0 * std::cos(cant) - 10.0 * std::sin(cant), 190.0 * std::sin(cant) + 10.0 * std::cos(cant));
      o.top_n_base = T.rotation * Vec3::UnitZ();
    }
    add(ItemId::slab_length, "mean(length_left, length_right)", 5600.0, 5597.0, 5603.0);
    add(ItemId::bottom_flatness, "plane4_flatness(b1, b2, b3, b4)", 0.0, kNoValue, 3.0);
    for (const char* name : {"length_left", "length_right"}) reading(name, 5600.0);
    for (const char* name : {"b1", "b2", "b3", "b4"}) reading(name, 0.0);
  }
  void add(ItemId id, const char* formula, double nominal, double lower, double upper) {
    Tolerance& t = recipe.tolerances[static_cast<std::size_t>(id)];
    t.given = t.required = true;
    t.nominal.value = nominal;
    t.lower = lower;
    t.upper = upper;
    recipe.formulas[gauge_item_index(id)] = parse_formula(formula).value();
  }
  void reading(const char* name, double value) {
    GaugeReading r;
    r.gauge = name;
    r.state = GaugeState::ok;
    r.value = value;
    r.u = 0.08;
    r.u_master = 0.02;
    EXPECT_TRUE(facts.gauges.push(r));
  }
  GaugeReading& gauge(std::string_view name) {
    for (GaugeReading& r : facts.gauges)
      if (r.gauge == name) return r;
    ADD_FAILURE() << name;
    return facts.gauges[0];
  }
  SlabResult inspect() {
    SlabResult out;
    inspect_slab(recipe, blocks, {0.02, rad_from_deg(0.001)}, Pose::identity(), out, {}, facts);
    return out;
  }
};

const Item& item(const SlabResult& r, ItemId id) {
  const Item* found = find_item(r.items.begin(), r.items.end(), id);
  EXPECT_NE(found, nullptr);
  return *found;
}

TEST(GaugeItems, are_judged_with_the_parts_gauge_and_reference) {
  Slab slab;
  slab.gauge("length_left").value = 5601.0;
  const SlabResult r = slab.inspect();
  EXPECT_EQ(r.verdict, Verdict::pass) << r.reason;
  const Item& length = item(r, ItemId::slab_length);
  EXPECT_NEAR(length.value, 5600.5, 1e-9);
  EXPECT_NEAR(length.budget[static_cast<std::size_t>(BudgetPart::gauge)], 0.08 / std::sqrt(2.0), 1e-12);
  EXPECT_NEAR(length.budget[static_cast<std::size_t>(BudgetPart::reference)], 0.02, 1e-12);
  EXPECT_NEAR(length.U, 2.0 * std::hypot(0.08 / std::sqrt(2.0), 0.02), 1e-12);
  EXPECT_EQ(find_item(r.items.begin(), r.items.end(), ItemId::slab_width), nullptr) << "the recipe does not have it";
  EXPECT_EQ(r.gauges.size(), 6U) << "kept with the slab";
}

TEST(GaugeItems, a_length_outside_fails_with_620_and_without_a_bit) {
  Slab slab;
  slab.gauge("length_left").value = slab.gauge("length_right").value = 5604.0;
  const SlabResult r = slab.inspect();
  EXPECT_EQ(r.verdict, Verdict::fail);
  EXPECT_EQ(r.reason, 620);
  EXPECT_EQ(r.fail_mask, 0);
  slab.gauge("length_left").value = slab.gauge("length_right").value = 5600.0;
  slab.gauge("b1").value = 7.0;
  EXPECT_EQ(slab.inspect().reason, 623);
  slab.gauge("b1").value = 6.0;
  EXPECT_EQ(slab.inspect().verdict, Verdict::indeterminate) << "within U of its limit";
}

TEST(GaugeItems, a_gauge_without_a_usable_value_is_114_and_never_a_pass) {
  for (std::size_t state = 1; state < kGaugeStates; ++state) {
    Slab slab;
    slab.gauge("length_right").state = static_cast<GaugeState>(state);
    const SlabResult r = slab.inspect();
    EXPECT_EQ(r.verdict, Verdict::not_measured) << name(static_cast<GaugeState>(state));
    EXPECT_EQ(r.reason, 114);
    EXPECT_EQ(item(r, ItemId::slab_length).verdict, Verdict::not_measured);
    EXPECT_EQ(item(r, ItemId::bottom_flatness).verdict, Verdict::pass);
  }
  Slab slab;
  slab.facts.gauges.clear();
  EXPECT_EQ(slab.inspect().reason, 114);
}

TEST(GaugeItems, a_failing_block_keeps_its_reason_when_a_gauge_is_missing) {
  Slab slab;
  slab.facts.gauges.clear();
  slab.blocks[3].items[0].verdict = Verdict::fail;
  slab.blocks[3].verdict = Verdict::fail;
  slab.blocks[3].reason = 604;
  const SlabResult r = slab.inspect();
  EXPECT_EQ(r.verdict, Verdict::fail);
  EXPECT_EQ(r.reason, 604);
}

TEST(GaugeItems, an_item_that_is_not_required_does_not_hold_up_the_slab) {
  Slab slab;
  slab.facts.gauges.clear();
  for (const ItemId id : {ItemId::slab_length, ItemId::bottom_flatness})
    slab.recipe.tolerances[static_cast<std::size_t>(id)].required = false;
  EXPECT_EQ(slab.inspect().verdict, Verdict::pass);
}

TEST(GaugeItems, a_value_in_metres_or_of_another_dimension_is_not_plausible) {
  for (const double value : {5.6, 2500.0, 5.6e6, -5600.0}) {
    Slab slab;
    slab.gauge("length_left").value = value;
    const SlabResult r = slab.inspect();
    EXPECT_EQ(r.verdict, Verdict::not_measured) << value;
    EXPECT_EQ(r.reason, 114) << value;
    EXPECT_EQ(find_gauge(r.gauges, "length_left")->state, GaugeState::not_plausible);
    EXPECT_EQ(find_gauge(r.gauges, "length_left")->value, value) << "kept for people";
  }
}

TEST(GaugeItems, are_stated_at_the_reference_temperature) {
  Slab slab;
  ThermalSettings& thermal = slab.recipe.thermal;
  thermal.given = true;
  thermal.reference_c.value = 20.0;
  thermal.cte_per_K.value = 1e-5;
  thermal.u_cte_per_K.value = 1e-6;
  thermal.u_temperature_K.value = 2.0;
  thermal.unknown_low_c.value = -10.0;
  thermal.unknown_high_c.value = 50.0;
  slab.facts.temperature_c = 40.0;
  const Item length = item(slab.inspect(), ItemId::slab_length);
  EXPECT_NEAR(length.measured, 5600.0, 1e-9);
  EXPECT_NEAR(length.value, 5600.0 / (1.0 + 2e-4), 1e-6);
  EXPECT_NEAR(length.budget[static_cast<std::size_t>(BudgetPart::thermal)], 5600.0 * std::hypot(2e-5, 2e-5), 1e-3);
}

TEST(GaugeItems, stored_readings_give_the_same_items_again) {
  Slab slab;
  slab.gauge("length_left").value = 5.6;
  const SlabResult first = slab.inspect();
  slab.facts = facts_of(SlabHeader{}, first);
  const SlabResult again = slab.inspect();
  EXPECT_EQ(again.verdict, first.verdict);
  EXPECT_EQ(again.reason, first.reason);
  ASSERT_EQ(again.gauges.size(), first.gauges.size());
  for (std::size_t i = 0; i < first.gauges.size(); ++i) EXPECT_EQ(again.gauges[i].state, first.gauges[i].state);
}

}  // namespace
}  // namespace slabd::algo
