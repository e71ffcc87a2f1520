// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "emulator/block_scene.h"
#include "emulator/concrete_effects.h"
#include "emulator/warming.h"

/// Errors that the emulated scanner adds to a surface: noise, outliers and gaps.
namespace slabd::emulator {

/// Correlation of the noise of two points of one scan over their distance; both shapes have fallen to 1/e at the
/// correlation length along a row.
enum class NoiseShape : std::uint8_t {
  gaussian,     ///< exp(-r^2 / L^2): smooth, as from a filter
  exponential,  ///< exp(-(|dx| + |dy|) / L): rough with a long tail
};

struct ScannerTraits {
  std::size_t columns = 2048;  ///< along scanner X
  std::size_t rows = 2448;     ///< along scanner Y
  double field_x_mm = 350.0;   ///< perspective: at the nominal stand-off
  double field_y_mm = 500.0;
  Projection projection = Projection::parallel;
  bool organised = true;              ///< keep the grid, NaN for missing points
  double noise_mm = 0.03;             ///< standard deviation along the ray
  double noise_correlation_mm = 0.0;  ///< 0: independent noise at every point
  NoiseShape noise_shape = NoiseShape::gaussian;
  double outlier_share = 0.005;  ///< of the returned points, uniformly 1..60 mm before or behind the surface
  double missing_share = 0.02;
  /// Set if the blocks are real concrete (emulator/concrete_block.h) instead of polyhedra: always in perspective, with
  /// noise, outliers and gaps by these effects. Used by draw_block only.
  std::optional<EffectStrengths> concrete;
  std::vector<ConcreteDefect> damage;  ///< on the concrete
  std::uint64_t scanner_seed = 1;      ///< concrete: cameras, lens and scale of the scanner
  Warming warming;                     ///< since ScannerPeer::start; not used by draw_scan
};
inline constexpr double kOutlierMin_mm = 1.0;
inline constexpr double kOutlierMax_mm = 60.0;

struct DrawnScan {
  std::size_t width = 0;  ///< 0 = unorganised
  std::size_t height = 0;
  std::size_t valid = 0;  ///< finite points, outliers included
  std::size_t outliers = 0;
  std::size_t missing = 0;    ///< dropped at random
  std::size_t no_return = 0;  ///< rays into a bore
};

/// Draws one scan into `xyz` (3 floats a point; resized) of a surface made for the same projection. The same seed
/// gives the same bits. Takes about 0.2 s for the full grid, 0.5 s with correlated noise.
[[nodiscard]] DrawnScan draw_scan(const BlockSurface& surface, const ScannerTraits& traits, std::uint64_t seed,
                                  std::vector<float>& xyz);

/// Correlated noise of standard deviation 1 over the grid of `traits`, row by row. Stationary up to the edges.
[[nodiscard]] std::vector<float> noise_field(const ScannerTraits& traits, std::uint64_t seed);

}  // namespace slabd::emulator
