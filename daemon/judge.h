// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "base/base.h"
#include "base/jobs.h"

namespace slabd::daemon {

/// Judges the slab from what its stations hold, [station - 1]: each block with what its scan was spliced with. The only
/// path to a slab's verdict, in the daemon and when a stored slab is replayed. `verified`: the scanner's acceptance
/// that the slab was begun with. `blocks` is room for one block per station. No heap.
void judge_slab(const Recipe& recipe, const ScannerNumbers& verified, std::span<const StationRecord> stations,
                const Pose& T_base_slab, std::span<BlockResult> blocks, SlabResult& out);

}  // namespace slabd::daemon
