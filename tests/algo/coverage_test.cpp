// SPDX-License-Identifier: Apache-2.0
//
// Does U cover the truth? A small version of the accuracy program's study `coverage`; bands so wide that only a wrong
// budget leaves them.
#include <gtest/gtest.h>

#include "item_simulation.h"

namespace slabd {
namespace {

using simulation::Coverage;

/// 200 slabs: for the items there is one of per slab the share's standard deviation is 1.5 %.
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

TEST(Coverage, of_every_item_where_the_scanners_form_decides) {
  const simulation::Line line(simulation::recipe_with_uncertainty(), {0.02, rad_from_deg(0.001), 0.017, 1e-5});
  expect_true_U(simulation::coverage(line, simulation::Errors{}, kSlabs, 1, 20));
}

TEST(Coverage, of_every_item_where_noise_robot_and_registration_decide) {
  Recipe recipe = simulation::recipe_with_uncertainty();
  recipe.uncertainty.scanner_form_mm.value = 0.0005;
  recipe.uncertainty.scanner_length_ppm.value = 0.5;
  recipe.uncertainty.reference_mm.value = 0.0001;
  recipe.uncertainty.reference_rad.value = 1e-7;
  const simulation::Line line(recipe, {0.0, 0.0, 0.017, 1e-5});
  expect_true_U(simulation::coverage(line, simulation::Errors{}, kSlabs, 1, 20));
}

}  // namespace
}  // namespace slabd
