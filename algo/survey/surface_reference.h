// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

#include "algo/block_model.h"
#include "algo/survey/surface_raster.h"
#include "base/base.h"
#include "base/team.h"

/// Surface of the scan in each cell of the surface raster, compared with the expected one.
namespace slabd::algo {

/// Zone of a cell, which determines its limits.
enum class SurfaceZone : std::uint8_t {
  none,         ///< not judged: outside the block or the field of view, around a casing, or rarely seen
  face,         ///< seat or jaw
  shoulder,     ///< undulates more than the formed faces
  foot,         ///< near a jaw's foot, which is rounded
  upper_edge,   ///< near a jaw's upper edge, which is rounded or chipped
  outer_edge,   ///< near the block's end or side, which are chamfered and worn
  corner,       ///< where the two meet
  behind_edge,  ///< slightly further in, covered only by the longest chamfers
};

/// Values per cell. A cell with too few points has no `off`.
struct SurfaceField {
  std::span<float> off;  ///< mean distance less the fitted face, the edges' usual profile and the local form, mm
  /// Like `off`, but including the local form. Along an outer edge it is relative to a smooth line through the edge on
  /// both sides, so that short deviations show, not to the edge's median; NaN if that line is unknown.
  std::span<float> face_off;
  std::span<float> cover;  ///< share of the cell that is off, if the rest of it is at the expected height
  std::span<float> whole;  ///< points on the surface over the usual number of points
  std::span<SurfaceZone> zone;
  double edge_wear = 1.0;              ///< variation of the block's chamfers, relative to the usual one
  std::array<double, kFaces> usual{};  ///< points in a usual cell of each face; 0: not seen
  FixedVector<EdgeFeature, kEdgesMax> edges;

  [[nodiscard]] bool seen(std::size_t cell) const { return !std::isnan(off[cell]); }
  /// `off` at a position between the centres of two cells in a line of the raster; NaN if one was not seen.
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
/// From this distance on (mm) some of a cell's points are not on its surface.
inline constexpr float kSurfaceOff_mm = 0.12F;

/// Fills `field` (kSurfaceCells each) from the raster and the fitted planes of `result`. The face is the fitted plane;
/// for the shoulders, and a jaw without a plane, that of the cells. Along the edges the median over the edge is
/// expected, so a chamfer, a fillet or wear is usual and a chip is not; but it is limited to the size of a chamfer. The
/// local form over 20 mm is subtracted. `field.edges` has the shapes of the edges. No heap; about 0.8 ms; the same bits
/// on every machine.
void compare_with_expected(const BlockModel& model, const SurfaceTable& table, std::span<const SurfaceCell> cells,
                           const BlockResult& result, Team& team, SurfaceField& field);

/// Subtracts the usual profile along the edges from `field.off`, the distances to the faces, and fills `field.face_off`
/// there. Sets the zones of cells within the chamfers of outer edges. Cells of a rarely seen
/// strip are excluded. No heap; 0.9 ms.
void exclude_edges(const SurfaceTable& whole, Team& team, SurfaceField& field);

/// Heights above a nominal face as a plane in (x, y).
struct FacePlane {
  double a0 = 0.0;
  double ax = 0.0;
  double ay = 0.0;
  [[nodiscard]] double at(double x, double y) const { return a0 + ax * x + ay * y; }
};

/// Measures fillets and chamfers of the block. `planes`: the fitted faces; `field.off` has the distances to them,
/// including the edges. An edge is left out if too little of it was seen, or if it is outside the range of the raster:
/// radius 1..12 mm, leg 2..9 mm. No heap; 0.2 ms; the same bits on every machine.
void fit_edges(const BlockModel& model, const SurfaceTable& table, const std::array<FacePlane, kFaces>& planes,
               const SurfaceField& field, Team& team, FixedVector<EdgeFeature, kEdgesMax>& edges);

// Access to the entries of a SurfaceTable.

namespace surface_cell {

[[nodiscard]] inline Face face_of(std::uint16_t entry) {
  return static_cast<Face>(entry & kFaceBits);
}
[[nodiscard]] inline std::size_t end_of(std::uint16_t entry) {
  return entry >> kEndShift & kFar;
}
[[nodiscard]] inline std::size_t side_of(std::uint16_t entry) {
  return entry >> kSideShift & kFar;
}
/// Calls `use(i)` for the cells of the block, row by row; only its lower or upper half if `half` is 0 or 1.
template <typename Use>
void for_cells_of(const SurfaceTable& table, const Use& use, int half = -1) {
  const auto [first, end] = table.rows();
  const auto [left, right] = table.columns();
  const std::size_t middle = (first + end) / 2;
  for (std::size_t row = half == 1 ? middle : first; row < (half == 0 ? middle : end); ++row)
    for (std::size_t i = row * kSurfaceColumns + left; i < row * kSurfaceColumns + right; ++i) use(i);
}
/// False for end and side faces, which are seen at a grazing angle, if at all.
[[nodiscard]] inline bool is_judged(std::uint16_t entry) {
  const Face face = face_of(entry);
  return (entry & kFaceBits) != kNoFace && (face == Face::seat || face == Face::jaw_inner || face == Face::jaw_outer ||
                                            face == Face::shoulder_inner || face == Face::shoulder_outer);
}
[[nodiscard]] inline bool is_near_edge(std::uint16_t entry) {
  return (entry & (kFoot | kUpperEdge)) != 0 || end_of(entry) != kFar || side_of(entry) != kFar;
}

}  // namespace surface_cell

}  // namespace slabd::algo
