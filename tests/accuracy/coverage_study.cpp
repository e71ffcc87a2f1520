// SPDX-License-Identifier: Apache-2.0
//
// Tests that the stated U covers the truth and is not larger than necessary. Thousands of slabs are simulated at the
// level of fitted features (tests/algo/items/item_simulation.h). The first setting has the reference recipe's
// assumptions, in which the scanner's form error dominates. The second has a scanner a hundred times better, in which
// noise, robot and registration dominate. Two more have two robots whose tie is off by 0.3 mm: one robot for each row,
// and one for each half of the slab's length.
#include <fmt/core.h>

#include <cmath>

#include "tests/accuracy/studies.h"
#include "tests/algo/items/item_simulation.h"

namespace slabd::accuracy {
namespace {

/// One station in kFlatnessEvery gets simulated flatness cells: 6 800 normal numbers each.
constexpr int kFlatnessEvery = 9;

/// Tie error in space and its turn about each axis, k = 1: an order of magnitude beyond a careful tie.
constexpr double kTie_mm = 0.3;
constexpr double kTie_rad = rad_from_deg(0.003);

/// The first setting with a second robot, which scans the stations first..last.
simulation::Line two_robots(const Recipe& recipe, const algo::StationSigma& sigma, int first, int last) {
  simulation::SecondRobot second;
  for (int station = first; station <= last; ++station) second.scans[static_cast<std::size_t>(station - 1)] = true;
  second.tie =
      simulation::independent_tie(kTie_mm / std::sqrt(3.0), kTie_rad, simulation::Line::T_base_slab().translation_mm);
  return {recipe, sigma, second};
}

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
  const algo::StationSigma sigma{0.02, rad_from_deg(0.001), 0.017, 1e-5};
  const simulation::Line assumed(recipe, sigma);
  report("form", simulation::coverage(assumed, simulation::Errors{}, slabs, options.first, kFlatnessEvery), table);
  report("two robots, tie error 0.3 mm, one a row",
         simulation::coverage(two_robots(recipe, sigma, 10, 18), simulation::Errors{}, slabs, options.first, 0), table);
  report("two robots, tie error 0.3 mm, one a half",
         simulation::coverage(two_robots(recipe, sigma, 6, 13), simulation::Errors{}, slabs, options.first, 0), table);

  UncertaintySettings& u = recipe.uncertainty;
  for (Nominal* part : {&u.scanner_form_mm, &u.scanner_length_ppm, &u.reference_mm, &u.reference_rad})
    part->value *= 0.01;
  const simulation::Line fine(recipe, {0.0, 0.0, 0.017, 1e-5});
  report("noise", simulation::coverage(fine, simulation::Errors{}, slabs, options.first, kFlatnessEvery), table);
  return true;
}

}  // namespace slabd::accuracy
