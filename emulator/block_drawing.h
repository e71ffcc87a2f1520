// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "emulator/concrete_block.h"
#include "emulator/scan_drawing.h"
#include "emulator/slab_scene.h"

/// One block of a slab, drawn as the line has it: a polyhedron or real concrete.
namespace slabd::simulate {

struct DrawnBlock {
  DrawnScan scan;
  std::optional<ConcreteTruth> concrete;  ///< real concrete only
};

/// Draws block `station` of `recipe` into `xyz` (3 floats a point, scanner frame, mm; resized). `block_seed` decides
/// what is on the concrete, `scan_seed` noise, outliers and gaps. config: the block is not in front of the scanner.
[[nodiscard]] Result<DrawnBlock> draw_block(const Recipe& recipe, const StationTruth& station,
                                            const Pose& T_scanner_block, const ScannerTraits& traits,
                                            std::uint64_t block_seed, std::uint64_t scan_seed, std::vector<float>& xyz);

}  // namespace slabd::simulate
