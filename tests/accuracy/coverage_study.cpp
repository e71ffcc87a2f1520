// SPDX-License-Identifier: Apache-2.0
//
// Tests that the stated U covers the truth and is not larger than necessary. Thousands of slabs are simulated at the
// level of fitted features (tests/algo/items/item_simulation.h). The first setting has the reference recipe's
// assumptions, in which the scanner's form error dominates. The second has a scanner a hundred times better, in which
// noise, robot and registration dominate.
#include <fmt/core.h>

#include "tests/accuracy/studies.h"
#include "tests/algo/items/item_simulation.h"

namespace slabd::accuracy {
namespace {

/// One station in kFlatnessEvery gets simulated flatness cells: 6 800 normal numbers each.
constexpr int kFlatnessEvery = 9;

void report(const char* setting, const std::vector<simulation::Coverage>& result, Table& table) {
  for (const simulation::Coverage& c : result) {
    const char* unit = name(info(c.id).unit).data();
    const std::string what =
        fmt::format("{}: {}{}", setting, info(c.id).name, c.slab_frame && c.id == ItemId::seat_slope ? " (slab)" : "");
    table.at_least(what + ", covered", 100.0 * c.share(), 93.5, "%");
    table.at_most(what + ", mean U / needed", c.waste(), 1.3, "");
    table.tell(what + ", mean U", c.mean_U, unit);
  }
}

}  // namespace

bool coverage_study(const StudyOptions& options, Table& table) {
  const int slabs = options.cases(2000, 100);
  Recipe recipe = simulation::recipe_with_uncertainty();
  const simulation::Line assumed(recipe, {0.02, rad_from_deg(0.001), 0.017, 1e-5});
  report("form", simulation::coverage(assumed, simulation::Errors{}, slabs, options.first, kFlatnessEvery), table);

  UncertaintySettings& u = recipe.uncertainty;
  for (Nominal* part : {&u.scanner_form_mm, &u.scanner_length_ppm, &u.reference_mm, &u.reference_rad})
    part->value *= 0.01;
  const simulation::Line fine(recipe, {0.0, 0.0, 0.017, 1e-5});
  report("noise", simulation::coverage(fine, simulation::Errors{}, slabs, options.first, kFlatnessEvery), table);
  return true;
}

}  // namespace slabd::accuracy
