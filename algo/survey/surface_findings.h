// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "algo/algo.h"
#include "algo/block_model.h"
#include "algo/features/face_points.h"
#include "base/team.h"

/// Areas of seat and jaws that are displaced or missing, also where no item is measured: the whole bearing plane and
/// both jaw faces, up to a rim along their edges.
namespace slabd::algo {

namespace findings {
/// A place this far off its fitted face (mm) is displaced. Twice what cast concrete and a scanner's form error leave
/// over a whole seat; three times the deepest pore that a flatness of 1.0 mm permits would be a finding by itself.
inline constexpr double kDisplaced_mm = 1.0;
inline constexpr double kCell_mm = 2.5;  ///< sixteen cells make the least area that is reported
/// Rim along the edges in which nothing is looked for (mm): there are fillets of up to 8 mm radius (5.6 mm along each
/// face of an edge of 110 degrees), chamfers and flash.
inline constexpr double kRim_mm = 7.0;
/// Beyond a casing's rim: mortar, caps and their shadows.
inline constexpr double kCasingRim_mm = 8.0;
/// A point of a face is looked for this far from it along its normal. The broken surface of a jaw's corner lies there.
inline constexpr double kReach_mm = 30.0;
/// Points that are looked at, about: five in each cell of a jaw.
inline constexpr std::size_t kLooked = 450'000;
}  // namespace findings

/// What the survey of a scan has left, for a first look.
struct SurveyedSurface {
  DeviationMap map;
  std::array<const ListedPoints*, 2> jaws{};  ///< points of the inner and the outer jaw
};

inline constexpr std::size_t kFindingFloats = 300'000;
/// Fills `result.findings` from a registered scan whose seat plane was fitted; a jaw without a plane is left out. Only
/// cells that the scan's field of view surrounds can be missing. `memory`: kFindingFloats. The same answer on one
/// thread and two. No heap; 0.5 ms for a block without a suspicious place, 8 ms for others.
void find_surface_damage(const Cloud& cloud, const BlockModel& model, const Pose& T_block_scanner,
                         const SurveyedSurface& surveyed, std::span<float> memory, Team& team, BlockResult& result);
/// Is any place suspicious? What find_surface_damage asks first.
[[nodiscard]] bool has_suspicious_surface(const BlockModel& model, const SurveyedSurface& surveyed,
                                          std::span<float> memory, const BlockResult& result);

}  // namespace slabd::algo
