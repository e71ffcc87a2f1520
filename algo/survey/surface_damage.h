// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "algo/algo.h"
#include "algo/block_model.h"
#include "algo/survey/surface_raster.h"
#include "algo/survey/surface_reference.h"
#include "base/base.h"
#include "base/fixed.h"
#include "base/team.h"

/// Pores and damage everywhere on the block: seat, jaws and shoulders with their edges.
namespace slabd::algo {

/// A crack as a path over the raster, step by step along one axis.
struct CrackPath {
  static constexpr std::size_t kStepsMax = 160;
  bool along_y = true;      ///< direction: along y, across the rail, or x
  std::uint16_t first = 0;  ///< first step, of kCrackStep cells
  std::uint16_t steps = 0;
  std::array<std::uint16_t, kStepsMax> at{};  ///< for each step: cell across the axis, the first of two
  double strength = 0.0;                      ///< sum over the steps of the missing share beyond the limit
  double missing = 0.0;                       ///< ... and of the missing surface, in cells
};
/// Cells in a step.
inline constexpr std::size_t kCrackStep = 3;
inline constexpr std::size_t kCracksMax = 4;  ///< in each direction
using CrackPaths = FixedVector<CrackPath, kCracksMax>;

/// Bytes of memory for `find_cracks`.
inline constexpr std::size_t kCrackBytes = 16 * kSurfaceCells / kCrackStep;

/// Finds the paths, up to 45 degrees off the axis, along which less of the expected surface is seen than beside them:
/// its points are deeper, or missing. Strongest first. False if a crack could not be distinguished from the grid of
/// points in this scan. No heap; 0.3 ms.
[[nodiscard]] bool find_cracks(const SurfaceField& field, bool along_y, std::span<std::byte> memory, CrackPaths& paths);

/// A finding with its classification values.
struct FoundSurface {
  SurfaceFinding finding;
  double extent_mm = 0.0;    ///< longest extent, on the face
  double diameter_mm = 0.0;  ///< of the circle of equal area
  bool is_pore = false;
};

/// All findings of a block. Damage and pores are separate, so that many pores never hide damage.
struct FoundSurfaces {
  FixedVector<FoundSurface, limits::kFindingsMax> damage;  ///< the largest area first
  FixedVector<FoundSurface, limits::kFindingsMax> pores;   ///< the same order
  std::uint32_t pore_count = 0;
  double pore_area_mm2 = 0.0;
  double pore_largest_mm = 0.0;
  double pore_deepest_mm = 0.0;
  double damage_extent_mm = 0.0;
  double damage_depth_mm = kNoValue;  ///< of the damage with the longest extent
  double seen_mm2 = 0.0;

  void add(const FoundSurface& found);
};

/// Finds connected cells of `field` that are off or were not seen, and classifies them. A pit with an equal-area
/// diameter of up to `pore_max_mm` is a pore, also a larger one too shallow for damage. `marks` and `stack`:
/// kSurfaceCells each. No heap; 0.3 ms.
void group_cells(const BlockModel& model, const SurfaceTable& table, const SurfaceField& field, double pore_max_mm,
                 std::span<std::uint8_t> marks, std::span<std::uint32_t> stack, FoundSurfaces& found);

/// Adds a crack's path as a finding. Its cells are removed from `field`, so that they form no group.
void add_crack(const BlockModel& model, const SurfaceTable& table, const CrackPath& path, SurfaceField& field,
               FoundSurfaces& found);

/// Floats of memory for the search.
inline constexpr std::size_t kSurfaceFloats = 800'000;
/// A pit is a pore up to this many times the recipe's limit of its diameter; above that it is damage if it is deep.
inline constexpr double kPoreReserve = 1.25;

/// Fills `result.findings`, `result.pores`, `result.edges`, and the items surface_pores and block_damage if `result`
/// has them, from the raster of a registered scan whose seat plane was fitted. `map` gives the extent of the scan.
/// Places beyond the field of view are not missing, nor are places that nearly always return no points. The same result
/// with one or two threads. No heap; 1.5 ms.
void find_pores_and_damage(const BlockModel& model, const SurfaceTable& table, std::span<const SurfaceCell> cells,
                           const DeviationMap& map, std::span<float> memory, Team& team, BlockResult& result);

}  // namespace slabd::algo
