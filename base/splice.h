// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "base/jobs.h"

namespace slabd {

/// Where the scanner stood when a stored scan was taken: the pose as stored, the hand-eye of its slab, and the
/// station's correction where it held. Equal records give equal bits, today and in ten years.
[[nodiscard]] inline Pose stored_T_base_scanner(const SlabHeader& slab, const Attempt& attempt) {
  const Pose T_base_scanner = attempt.T_base_flange * slab.T_flange_scanner;
  return attempt.splice.source == SpliceSource::corrected ? attempt.splice.T_base_reported * T_base_scanner
                                                          : T_base_scanner;
}

}  // namespace slabd
