// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "algo/algo.h"
#include "algo/block_model.h"
#include "algo/features/face_points.h"
#include "base/team.h"

/// Displaced or missing areas of seat and jaws, also outside measured items: the whole bearing plane and both jaw
/// faces, up to a rim along their edges.
namespace slabd::algo {

namespace findings {
/// A place this far off its fitted face (mm) is displaced: twice the residual of cast concrete and a scanner's form
/// error over a whole seat. Three times the deepest pore within a flatness of 1.0 mm would be a finding by itself.
inline constexpr double kDisplaced_mm = 1.0;
inline constexpr double kCell_mm = 2.5;  ///< sixteen cells are the smallest area reported
/// Rim along the edges that is not searched (mm): it contains fillets of up to 8 mm radius (5.6 mm along each face of
/// an edge of 110 degrees), chamfers and flash.
inline constexpr double kRim_mm = 7.0;
/// Margin around a casing's rim: mortar, caps and their shadows.
inline constexpr double kCasingRim_mm = 8.0;
/// Search range of a face's points along its normal. The broken surface of a jaw's corner is within it.
inline constexpr double kReach_mm = 30.0;
/// Approximate number of points read: five in each cell of a jaw. More where a cell of the seat would have fewer than
/// kInCell, and one of a jaw four: a scan of many points may have few of them on the block.
inline constexpr std::size_t kLooked = 450'000;
inline constexpr double kInCell = 12.0;
}  // namespace findings

/// Results of the survey for a first test.
struct SurveyedSurface {
  DeviationMap map;
  std::array<const ListedPoints*, 2> jaws{};  ///< points of the inner and the outer jaw
  double points_per_mm2 = 0.0;                ///< on the seat
};

inline constexpr std::size_t kFindingFloats = 300'000;
/// Fills `result.findings` from a registered scan whose seat plane was fitted; a jaw without a plane is left out. Only
/// cells surrounded by the scan's field of view can be missing. `memory`: kFindingFloats. The same result with one or
/// two threads. No heap; 0.5 ms for a block without a suspicious place, 8 ms for others.
void find_surface_damage(const Cloud& cloud, const BlockModel& model, const Pose& T_block_scanner,
                         const SurveyedSurface& surveyed, std::span<float> memory, Team& team, BlockResult& result);

}  // namespace slabd::algo
