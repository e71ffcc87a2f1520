// SPDX-License-Identifier: Apache-2.0
//
// Items that gauges measure. A reading comes with its own state: whether it belongs to the slab, is fresh and checked
// was decided when SLAB_END arrived (base/gauge.h). Here it is compared with the nominal, the formula is applied, and U
// follows from three parts: gauge, reference (the masters), thermal. The same readings give the same items, so that a
// stored slab is reproduced.
#include <cmath>

#include "algo/items/slab_seats.h"
#include "algo/items/uncertainty.h"

namespace slabd::algo {
namespace {

/// A gauge of a mean reads the dimension itself, so it must be near the nominal. The nominal of a flatness is 0, and
/// the terms of the other formulas have none.
void doubt_far_gauges(const Recipe& recipe, ItemId id, GaugeReadings& gauges) {
  const GaugeFormula& formula = recipe.formula(id);
  const double nominal = recipe.tolerance(id).nominal.value;
  if (formula.kind != FormulaKind::mean || !(std::abs(nominal) > 0.0)) return;
  for (GaugeReading& reading : gauges)
    for (const GaugeName& name : formula.gauges)
      if (reading.gauge == name && reading.state == GaugeState::ok &&
          !(std::abs(reading.value - nominal) <= limits::kGaugeOffShareMax * std::abs(nominal)))
        reading.state = GaugeState::not_plausible;
}

}  // namespace

void measure_gauge_items(const Recipe& recipe, const SlabFacts& slab, const Thermal& thermal, SlabResult& out) {
  out.gauges = slab.gauges;
  for (const ItemId id : kGaugeItemIds) doubt_far_gauges(recipe, id, out.gauges);
  for (const ItemId id : kGaugeItemIds) {
    if (!recipe.tolerance(id).given) continue;
    Item item = designed_item(recipe, slab.design, id);
    const FormulaValue measured = evaluate(recipe.formula(id), out.gauges);
    item.value = measured.value;
    if (has_value(item.value)) {
      part(item.budget, BudgetPart::gauge) = measured.u_gauge;
      part(item.budget, BudgetPart::reference) = measured.u_master;
      item.U = 2.0 * std::hypot(measured.u_gauge, measured.u_master);
      // All formulas are of degree one: the value grows with the slab.
      state_at_reference(thermal, item.value, item);
    }
    item.verdict = judge(item, recipe.guard);
    (void)out.items.push(item);
  }
}

}  // namespace slabd::algo
