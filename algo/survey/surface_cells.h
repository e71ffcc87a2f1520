// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

#include "algo/survey/surface_raster.h"

/// The entries of a SurfaceTable, read.
namespace slabd::algo::surface_cell {

[[nodiscard]] inline Face face_of(std::uint16_t entry) {
  return static_cast<Face>(entry & kFaceBits);
}
[[nodiscard]] inline std::size_t end_of(std::uint16_t entry) {
  return entry >> kEndShift & kFar;
}
[[nodiscard]] inline std::size_t side_of(std::uint16_t entry) {
  return entry >> kSideShift & kFar;
}
/// `use(i)` for the cells of the block, row by row; of its lower or upper half where `half` is 0 or 1.
template <typename Use>
void for_cells_of(const SurfaceTable& table, const Use& use, int half = -1) {
  const auto [first, end] = table.rows();
  const auto [left, right] = table.columns();
  const std::size_t middle = (first + end) / 2;
  for (std::size_t row = half == 1 ? middle : first; row < (half == 0 ? middle : end); ++row)
    for (std::size_t i = row * kSurfaceColumns + left; i < row * kSurfaceColumns + right; ++i) use(i);
}
/// End and side faces are seen at a grazing angle, if at all.
[[nodiscard]] inline bool is_judged(std::uint16_t entry) {
  const Face face = face_of(entry);
  return (entry & kFaceBits) != kNoFace && (face == Face::seat || face == Face::jaw_inner || face == Face::jaw_outer ||
                                            face == Face::shoulder_inner || face == Face::shoulder_outer);
}
[[nodiscard]] inline bool is_near_edge(std::uint16_t entry) {
  return (entry & (kFoot | kUpperEdge)) != 0 || end_of(entry) != kFar || side_of(entry) != kFar;
}

}  // namespace slabd::algo::surface_cell
