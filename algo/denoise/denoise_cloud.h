// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "algo/denoise/denoise.h"

namespace slabd::algo {

/// Denoises points in whatever order they come; see remove_isolated.
[[nodiscard]] bool denoise_cloud(Cloud& cloud, const DenoiseWorkspace& work, ScanCounts& counts);

}  // namespace slabd::algo
