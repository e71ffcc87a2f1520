// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "algo/algo.h"
#include "base/base.h"
#include "base/jobs.h"
#include "hal/hal.h"

/// The one way a block is measured and a slab is judged, by the daemon and by slabctl.
namespace slabd::daemon {

/// Denoise, register, extract, judge, with the clock between the stages: the only path from a scan to a block result,
/// used by the daemon's worker and by `slabctl inspect`. The result is `inspector.result()` and complete either way;
/// an error says in a sentence why the block could not be measured. `read_ms` is carried into the result. `verified`:
/// the scanner's acceptance of the slab. No heap.
[[nodiscard]] Status measure_block(algo::BlockInspector& inspector, const hal::Clock& clock, int station,
                                   const Pose& T_base_block, const Pose& T_base_scanner, algo::Cloud cloud,
                                   const ScanShape& read, double read_ms, const ScannerNumbers& verified = {});

/// What a report will draw of the block measured last; empty maps when it was not found. No heap; 1 ms.
void pack_maps(const algo::BlockInspector& inspector, BlockMaps& maps);

/// "slabd 0.1.0+g0a7ddc5": identifies the software in every record, to the commit.
[[nodiscard]] FixedString<64> software_version();

/// Judges the slab from what its stations hold, [station - 1]: each block with what its scan was spliced with. The only
/// path to a slab's verdict, in the daemon and when a stored slab is replayed. `verified`: the scanner's acceptance
/// that the slab was begun with. `blocks` is room for one block per station. No heap.
void judge_slab(const Recipe& recipe, const ScannerNumbers& verified, std::span<const StationRecord> stations,
                const Pose& T_base_slab, std::span<BlockResult> blocks, SlabResult& out);

}  // namespace slabd::daemon
