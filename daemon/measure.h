// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "algo/algo.h"
#include "base/base.h"
#include "base/jobs.h"
#include "hal/hal.h"

/// Measures blocks and judges slabs, for the daemon and for slabctl.
namespace slabd::daemon {

/// Denoises, registers, extracts and judges, with the clock between the stages. This is the only path from a scan to a
/// block result, used by the daemon's worker and by `slabctl inspect`. The result is `inspector.result()`; it is
/// complete in any case. An error is one sentence on why the block could not be measured. `read_ms` is copied into the
/// result. `verified`: the scanner's acceptance for the slab; `slab`: its own facts; `scanner_drift`: of this
/// scan (Attempt). No heap.
[[nodiscard]] Status measure_block(algo::BlockInspector& inspector, const hal::Clock& clock, int station,
                                   const Pose& T_base_block, const Pose& T_base_scanner, algo::Cloud cloud,
                                   const ScanShape& read, double read_ms, const ScannerNumbers& verified = {},
                                   const SlabFacts& slab = {}, double scanner_drift = kNoValue);

/// Packs the data that a report draws of the last measured block; empty maps if the block was not found. No heap; 1 ms.
void pack_maps(const algo::BlockInspector& inspector, BlockMaps& maps);

/// "slabd 1.0.0+g0a7ddc5": identifies the software in every record by its commit.
[[nodiscard]] FixedString<64> software_version();

/// Judges the slab from the records of its stations, [station - 1], each block with the splice of its scan. The only
/// path to a slab's verdict, in the daemon and in a replay of a stored slab. `basis` has a recipe. `blocks` has room
/// for one block per station. No heap.
void judge_slab(const SlabBasis& basis, std::span<const StationRecord> stations, std::span<BlockResult> blocks,
                SlabResult& out);

}  // namespace slabd::daemon
