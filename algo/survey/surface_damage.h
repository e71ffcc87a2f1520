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

/// A finding with what decides about it.
struct FoundSurface {
  SurfaceFinding finding;
  double extent_mm = 0.0;    ///< longest, on the face
  double diameter_mm = 0.0;  ///< of the circle of equal area
  bool is_pore = false;
};

/// All of a block, as it is found. Damage and pores are kept apart, so that many pores never hide damage.
struct FoundSurfaces {
  FixedVector<FoundSurface, limits::kFindingsMax> damage;  ///< the largest area first
  FixedVector<FoundSurface, limits::kFindingsMax> pores;   ///< likewise
  std::uint32_t pore_count = 0;
  double pore_area_mm2 = 0.0;
  double pore_largest_mm = 0.0;
  double pore_deepest_mm = 0.0;
  double damage_extent_mm = 0.0;
  double damage_depth_mm = kNoValue;  ///< of the damage with the longest extent
  double seen_mm2 = 0.0;

  void add(const FoundSurface& found);
};

/// Joins cells of `field` that touch and lie off, or were not seen, and says what they are. A pit with an equal-area
/// diameter of up to `pore_max_mm` is a pore. `marks` and `stack`: kSurfaceCells each. No heap; 0.3 ms.
void group_cells(const BlockModel& model, const SurfaceTable& table, const SurfaceField& field, double pore_max_mm,
                 std::span<std::uint8_t> marks, std::span<std::uint32_t> stack, FoundSurfaces& found);

/// A crack's path as a finding; its cells are taken out of `field`, so that no group is made of them.
void add_crack(const BlockModel& model, const SurfaceTable& table, const CrackPath& path, SurfaceField& field,
               FoundSurfaces& found);

/// Floats of memory that the search takes.
inline constexpr std::size_t kSurfaceFloats = 800'000;
/// A pit is a pore as long as its diameter is no larger than this many times the recipe's limit; then it is damage.
inline constexpr double kPoreReserve = 1.25;

/// Fills `result.findings`, `result.pores`, `result.edges`, and the items surface_pores and block_damage where `result`
/// has them, from the raster of a registered scan whose seat plane was fitted; `map` says how far the scan reaches.
/// What lies beyond the scan's field of view is not missing, nor is what nearly all of its like do not return. The same
/// answer on one thread and two. No heap; 1.5 ms.
void find_pores_and_damage(const BlockModel& model, const SurfaceTable& table, std::span<const SurfaceCell> cells,
                           const DeviationMap& map, std::span<float> memory, Team& team, BlockResult& result);

}  // namespace slabd::algo
