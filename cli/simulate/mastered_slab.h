// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "calib/calib.h"
#include "cli/simulate/simulate_calibration.h"
#include "emulator/slab_scene.h"

namespace slabd::cli::simulate {

/// `slabctl simulate calibration --kind slab`: a mastered slab in the cell and the inspected seats of `order.views`
/// rounds, for `slabctl calibrate stations --visits`. Makes `order.out_dir` and writes visits.txt, certificate.txt and
/// truth.json (the real flange pose of every station). Returns the exit status.
[[nodiscard]] int write_mastered_slab(const CalibrationOrder& order);

/// Certificate of this slab's seats with the exact values; U as stated.
[[nodiscard]] calib::MasterCertificate master_certificate(const Recipe& recipe, const emulator::SlabTruth& slab,
                                                          double sigma_mm = 0.005);

}  // namespace slabd::cli::simulate
