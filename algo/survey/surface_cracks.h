// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "algo/survey/surface_reference.h"
#include "base/fixed.h"

namespace slabd::algo {

/// A crack as a path over the raster, step by step along one axis.
struct CrackPath {
  static constexpr std::size_t kStepsMax = 160;
  bool along_y = true;      ///< the axis it runs along: y, across the rail, or x
  std::uint16_t first = 0;  ///< first step, of kCrackStep cells
  std::uint16_t steps = 0;
  std::array<std::uint16_t, kStepsMax> at{};  ///< of each step: cell across the axis, of the first of two
  double strength = 0.0;                      ///< sum over the steps of what is missing beyond the limit
  double missing = 0.0;                       ///< ... and of what is missing, in cells
};
/// Cells in a step.
inline constexpr std::size_t kCrackStep = 3;
inline constexpr std::size_t kCracksMax = 4;  ///< of either direction
using CrackPaths = FixedVector<CrackPath, kCracksMax>;

/// Bytes of memory that `find_cracks` works on.
inline constexpr std::size_t kCrackBytes = 16 * kSurfaceCells / kCrackStep;

/// Finds the paths, up to 45 degrees off the axis, along which less of the surface is seen where it is expected than
/// beside them: its points lie deeper, or there are none. Strongest first. False: in this scan a crack would not be
/// told from the grid of its points. No heap; 0.3 ms.
[[nodiscard]] bool find_cracks(const SurfaceField& field, bool along_y, std::span<std::byte> memory, CrackPaths& paths);

}  // namespace slabd::algo
