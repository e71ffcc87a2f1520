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

}  // namespace slabd
