// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "algo/denoise/denoise.h"

namespace slabd::algo {

/// Denoises a scan that has lost its grid but not its lattice: whose points, in whatever order, still lie on evenly
/// spaced rays, parallel or through the scanner's origin. The same points are kept whatever their order; points in no
/// order are brought into that of the lattice (algo/denoise/lattice_order.h). Needs order and keep as large as the
/// lattice (limits::kScanPointsMax is enough for every scan). False, and no point that has all coordinates lost, when
/// there is no such lattice.
[[nodiscard]] bool denoise_lattice(Cloud& cloud, const DenoiseWorkspace& memory, Team& team, ScanCounts& counts);

}  // namespace slabd::algo
