// SPDX-License-Identifier: Apache-2.0
#include "base/jobs.h"

namespace slabd {

SlabFacts facts_of(const SlabHeader& slab) {
  SlabFacts facts;
  facts.temperature_c = slab_temperature_c(slab.temperature_dk);
  if (const Result<SlabDesign> design = parse_design(slab.design_text.view())) {
    facts.design = design.value();
  } else {
    facts.design.given = true;
    facts.design.seats.fill({Vec3::Constant(kNoValue), kNoValue});
  }
  return facts;
}

SlabFacts facts_of(const SlabHeader& slab, const SlabResult& ended) {
  SlabFacts facts = facts_of(slab);
  facts.gauges = ended.gauges;
  // The judgement decides again which values are plausible.
  for (GaugeReading& reading : facts.gauges)
    if (reading.state == GaugeState::not_plausible) reading.state = GaugeState::ok;
  return facts;
}

}  // namespace slabd
