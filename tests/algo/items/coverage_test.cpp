// SPDX-License-Identifier: Apache-2.0
//
// Test that U covers the truth. A small version of the accuracy program's study `coverage`, with limits so wide that
// only a wrong budget exceeds them.
#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "item_simulation.h"

namespace slabd {
namespace {

using simulation::Coverage;

/// 200 slabs: for items that occur once per slab the standard deviation of the share is 1.5 %.
constexpr int kSlabs = 200;

void expect_true_U(const std::vector<Coverage>& result) {
  for (const Coverage& c : result) {
    const double n = static_cast<double>(c.count);
    const double share_min = 0.935 - 4.0 * std::sqrt(0.935 * 0.065 / n);
    EXPECT_GE(c.share(), share_min) << info(c.id).name << (c.slab_frame ? " (slab)" : "") << " of " << c.count;
    EXPECT_LE(c.waste(), 1.3 + 2.0 / std::sqrt(n)) << info(c.id).name << (c.slab_frame ? " (slab)" : "");
  }
  EXPECT_EQ(result.size(), 17U) << "nine items of a block, eight of the slab";
}

TEST(Coverage, holds_for_every_item_when_the_form_of_the_scanner_dominates) {
  const simulation::Line line(simulation::recipe_with_uncertainty(), {0.02, rad_from_deg(0.001), 0.017, 1e-5});
  expect_true_U(simulation::coverage(line, simulation::Errors{}, kSlabs, 1, 20));
}

TEST(Coverage, holds_for_every_item_when_noise_robot_and_registration_dominate) {
  Recipe recipe = simulation::recipe_with_uncertainty();
  recipe.uncertainty.scanner_form_mm.value = 0.0005;
  recipe.uncertainty.scanner_length_ppm.value = 0.5;
  recipe.uncertainty.reference_mm.value = 0.0001;
  recipe.uncertainty.reference_rad.value = 1e-7;
  const simulation::Line line(recipe, {0.0, 0.0, 0.017, 1e-5});
  expect_true_U(simulation::coverage(line, simulation::Errors{}, kSlabs, 1, 20));
}

TEST(Coverage, holds_for_flatness_from_below_for_flat_and_for_bowed_seats) {
  const simulation::Line line(simulation::recipe_with_uncertainty(), {0.02, rad_from_deg(0.001)});
  for (const double bow_mm : {0.0, 0.03, 0.1, -0.3}) {
    int covered = 0;
    double U = 0.0;
    std::vector<double> errors;
    Prng prng(9);
    for (int k = 0; k < 80; ++k) {
      simulation::BuiltBlock block;
      block.bow_mm = bow_mm;
      block.form_shape = k % 4;
      simulation::Errors with;
      simulation::Errors without = simulation::none();
      with.flatness = without.flatness = true;
      Prng silent(1);
      const BlockResult measured = line.measure_block(1, block, with, prng);
      const BlockResult truth = line.measure_block(1, block, without, silent);
      const auto flatness = [](const BlockResult& r) -> const Item& {
        return *find_item(r.items.begin(), r.items.end(), ItemId::seat_flatness);
      };
      errors.push_back(flatness(measured).value - flatness(truth).value);
      EXPECT_LT(flatness(truth).value, flatness(measured).value + flatness(measured).U) << "bow " << bow_mm;
      covered += errors.back() <= flatness(measured).U ? 1 : 0;
      U += flatness(measured).U / 80.0;
    }
    std::sort(errors.begin(), errors.end());
    EXPECT_GE(covered, 72) << "bow " << bow_mm;
    EXPECT_LE(U, 1.5 * errors[75]) << "bow " << bow_mm;
  }
}

}  // namespace
}  // namespace slabd
