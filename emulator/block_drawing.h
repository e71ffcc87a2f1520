// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "base/base.h"
#include "emulator/concrete_block.h"
#include "emulator/scan_drawing.h"
#include "emulator/slab_scene.h"

/// Drawing of one block of a slab, either as a polyhedron or as real concrete.
namespace slabd::emulator {

// Scans of a concrete block by a fringe-projection scanner: rays from one origin, two cameras and a projector that
// must all see a point, and the errors of each effect. Errors are never part of the truth.

struct ConcreteScanner {
  std::uint64_t seed = 1;  ///< determines cameras, lens, scale and ripple, which one scanner keeps from scan to scan
  std::size_t columns = 1000;  ///< along scanner X; 1000 x 1428: a pitch of 0.35 mm at the block
  std::size_t rows = 1428;     ///< along scanner Y
  double field_x_mm = 350.0;   ///< at the nominal stand-off
  double field_y_mm = 500.0;
  bool organised = true;            ///< keep the grid, NaN for missing points; the effect `misfit` loses it
  double step_mm = 0.0;             ///< coordinates are rounded to multiples of this; 0: not rounded
  double noise_mm = kNoValue;       ///< instead of the effect `noise`: standard deviation along the ray
  double outlier_share = kNoValue;  ///< instead of the effect `outliers`: share of the returned points
};

/// Pose of the scanner over the block, reported by the robot and real.
struct ConcreteView {
  Pose T_block_scanner_reported;
  Pose T_scanner_block;  ///< real
};
/// The view of effects `pose`, `offset`, `tilt` and `standoff`, starting from the nominal view.
[[nodiscard]] ConcreteView concrete_view(const EffectStrengths& effects, std::uint64_t seed);

/// One scan of one block.
struct ConcreteScan {
  DrawnScan drawn;
  ConcreteTruth truth;
};

/// Casts the block of `order` and draws it from `T_scanner_block` into `xyz` (3 floats a point, scanner frame, mm;
/// resized). `scan_seed` determines noise, outliers and gaps. The same arguments give the same bits. Takes about 1.5 s
/// for 1000 x 1428, 3 s for a full grid.
[[nodiscard]] ConcreteScan draw_concrete(const Recipe& recipe, const ConcreteOrder& order, const Pose& T_scanner_block,
                                         const ConcreteScanner& scanner, std::uint64_t scan_seed,
                                         std::vector<float>& xyz);

/// Moves all points away from `origin_mm` by the relative `expansion`: the block of a warm slab.
void expand(double expansion, const Vec3& origin_mm, std::span<float> xyz);

struct DrawnBlock {
  DrawnScan scan;
  std::optional<ConcreteTruth> concrete;  ///< set for real concrete only
};

/// Draws block `station` of `recipe` into `xyz` (3 floats a point, scanner frame, mm; resized). `block_seed`
/// determines the marks on the concrete, `scan_seed` noise, outliers and gaps. Code::config if the block is not in
/// front of the scanner.
[[nodiscard]] Result<DrawnBlock> draw_block(const Recipe& recipe, const StationTruth& station,
                                            const Pose& T_scanner_block, const ScannerTraits& traits,
                                            std::uint64_t block_seed, std::uint64_t scan_seed, std::vector<float>& xyz);

}  // namespace slabd::emulator
