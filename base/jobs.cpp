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

Pose T_flange_scanner_of(const SlabHeader& slab, std::size_t arm) {
  if (arm == 0) return slab.T_flange_scanner;
  if (arm <= slab.more_arms.size()) return slab.more_arms[arm - 1].T_flange_scanner;
  Pose none;
  none.rotation.coeffs().setConstant(kNoValue);
  none.translation_mm.setConstant(kNoValue);
  return none;
}

Pose stored_T_base_scanner(const SlabHeader& slab, const Attempt& attempt) {
  const Pose T_robot_scanner = attempt.T_base_flange * T_flange_scanner_of(slab, attempt.arm);
  const Pose corrected = attempt.splice.source == SpliceSource::corrected
                             ? attempt.splice.T_base_reported * T_robot_scanner
                             : T_robot_scanner;
  return attempt.splice.tied ? attempt.splice.T_base_robot * corrected : corrected;
}

}  // namespace slabd
