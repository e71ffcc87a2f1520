// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "calib/calib.h"
#include "cli/simulate/simulate_calibration.h"
#include "emulator/slab_scene.h"

namespace slabd::simulate {

/// `slabctl simulate calibration --kind slab`: a mastered slab in the cell and what the inspection saw of its seats on
/// `order.views` rounds, for `slabctl calibrate stations --visits`. Makes `order.out_dir` and writes visits.txt,
/// certificate.txt and truth.json (where every station's flange really stood). Returns the exit status.
[[nodiscard]] int write_mastered_slab(const CalibrationOrder& order);

/// What a laboratory would say of this slab's seats, exactly; U as stated.
[[nodiscard]] calib::MasterCertificate master_certificate(const Recipe& recipe, const SlabTruth& slab,
                                                          double sigma_mm = 0.005);

}  // namespace slabd::simulate
