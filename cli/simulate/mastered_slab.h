// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "cli/simulate/simulate_calibration.h"

namespace slabd::simulate {

/// `slabctl simulate calibration --kind slab`: a mastered slab in the cell and what the inspection saw of its seats on
/// `order.views` rounds, for `slabctl calibrate stations --visits`. Makes `order.out_dir` and writes visits.txt,
/// certificate.txt and truth.json (where every station's flange really stood). Returns the exit status.
[[nodiscard]] int write_mastered_slab(const CalibrationOrder& order);

}  // namespace slabd::simulate
