// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>

#include "algo/block_model.h"
#include "algo/survey/surface_raster.h"
#include "base/base.h"
#include "base/team.h"

/// What the scan shows in each cell of the surface raster beside what is expected there.
namespace slabd::algo {

/// How a cell is judged.
enum class SurfaceZone : std::uint8_t {
  none,  ///< not looked at: beside the block, around a casing, where a place is seldom seen, beside the field of view
  face,  ///< seat or jaw
  shoulder,     ///< undulates more than the formed faces
  foot,         ///< near a jaw's foot, which is rounded
  upper_edge,   ///< near a jaw's upper edge, which is rounded or chipped
  outer_edge,   ///< near the block's end or side, which are chamfered and worn
  corner,       ///< where the two meet
  behind_edge,  ///< a little further in, where only the longest chamfers reach
};

/// Cell by cell. A cell with too few points has no `off`.
struct SurfaceField {
  std::span<float> off;  ///< mean distance less the fitted face, the edges' usual profile and the local form, mm
  /// Likewise, but with the local form left in; along an outer edge beside a smooth line through the edge on both sides
  /// of the place instead of the edge's median, so that what is short shows; NaN where that line is not known.
  std::span<float> face_off;
  std::span<float> cover;  ///< share of the cell that lies off, if the rest of it lies where it is expected
  std::span<float> whole;  ///< points on the surface over the usual number of points
  std::span<SurfaceZone> zone;
  double edge_wear = 1.0;              ///< by how much more than usual the block's chamfers differ along themselves
  std::array<double, kFaces> usual{};  ///< points in a usual cell of each face; 0: not seen
  FixedVector<EdgeFeature, kEdgesMax> edges;

  [[nodiscard]] bool seen(std::size_t cell) const { return !std::isnan(off[cell]); }
  /// `off` at a place between the centres of two cells in a line of the raster; NaN where one was not seen.
  [[nodiscard]] float off_between(double place, std::size_t first, std::size_t stride) const {
    const std::size_t last = (stride == 1 ? kSurfaceColumns : kSurfaceRows) - 1;
    if (!(place >= 0.0 && place < static_cast<double>(last))) return std::numeric_limits<float>::quiet_NaN();
    const auto low = static_cast<std::size_t>(place);
    const auto part = static_cast<float>(place - static_cast<double>(low));
    const float a = off[first + low * stride];
    return a + part * (off[first + (low + 1) * stride] - a);
  }
};

/// A cell with a smaller share of the usual points than this counts as not seen.
inline constexpr double kSurfaceSeenShare = 0.2;
/// From this distance on (mm) a cell takes part of its points from something else than its surface.
inline constexpr float kSurfaceOff_mm = 0.12F;

/// Fills `field` (kSurfaceCells each) from the raster and the fitted planes of `result`. The face is the fitted
/// plane; of the shoulders, and of a jaw without one, the plane of the cells. Along the edges the median over the edge
/// is expected, so a chamfer, a fillet or wear is usual and a chip is not; but never more than a chamfer can be. Over
/// 20 mm the local form is taken away. What the edges look like is in `field.edges`. No heap; about 0.8 ms; the same
/// bits on every machine.
void compare_with_expected(const BlockModel& model, const SurfaceTable& table, std::span<const SurfaceCell> cells,
                           const BlockResult& result, Team& team, SurfaceField& field);

}  // namespace slabd::algo
