// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "algo/survey/surface_cracks.h"
#include "algo/survey/surface_reference.h"
#include "base/base.h"

namespace slabd::algo {

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

}  // namespace slabd::algo
