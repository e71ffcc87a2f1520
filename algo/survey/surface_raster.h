// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "algo/block_model.h"
#include "base/limits.h"

/// The block's surface on a raster of (x, y), block frame: how far the scan lies off the nearest face of the model in
/// each cell. The survey fills it in its pass over the scan; the search for pores and damage reads it.
namespace slabd::algo {

/// Sums over the points of one cell. Whole numbers, so that neither the order of the points nor the number of threads
/// changes them.
struct alignas(16) SurfaceCell {
  std::int32_t sum = 0;       ///< of the signed distances to the nearest face, in kSurfaceUnit_mm
  std::uint32_t squares = 0;  ///< of their squares
  std::uint32_t count = 0;
  std::uint32_t unused = 0;
};

/// The raster: 220 x 490 mm, which is the block and 5 mm around it.
inline constexpr std::size_t kSurfaceColumns = 176;
inline constexpr std::size_t kSurfaceRows = 392;
inline constexpr std::size_t kSurfaceCells = kSurfaceColumns * kSurfaceRows;
static_assert(kSurfaceCells <= limits::kSurfaceCells);
/// Edge of a cell. A crack of 0.8 mm covers most of one; a pore of 2 mm covers two.
inline constexpr double kSurfaceCell_mm = 1.25;
inline constexpr double kSurfaceHalfX_mm = 0.5 * kSurfaceCell_mm * static_cast<double>(kSurfaceColumns);
inline constexpr double kSurfaceHalfY_mm = 0.5 * kSurfaceCell_mm * static_cast<double>(kSurfaceRows);
inline constexpr double kSurfaceUnit_mm = 1.0 / 128.0;
/// Distances are cut off here: a broken corner is 15 mm deep, and the square of this in units, times two hundred points
/// of a cell, still fits its sum.
inline constexpr double kSurfaceReach_mm = 31.0;

/// Centre of a cell.
[[nodiscard]] constexpr double surface_x_mm(std::size_t column) {
  return (static_cast<double>(column) + 0.5) * kSurfaceCell_mm - kSurfaceHalfX_mm;
}
[[nodiscard]] constexpr double surface_y_mm(std::size_t row) {
  return (static_cast<double>(row) + 0.5) * kSurfaceCell_mm - kSurfaceHalfY_mm;
}

/// Where a pass over the scan adds its points. No cells: nowhere.
struct SurfaceSums {
  std::span<SurfaceCell> cells;
  std::size_t lanes = 16;  ///< points taken of each sixteen: 4, 8 or 16
  std::size_t width = 0;   ///< of an organised scan; 0 = unorganised
  std::size_t first = 0;   ///< number of the pass's first point in the scan
};

/// The recipe's part: the face that is seen in each cell, and how far the face's edges are.
namespace surface_cell {
inline constexpr std::uint16_t kFaceBits = 0xfU;  ///< Face; kNoFace: nothing is looked for here
inline constexpr std::uint16_t kNoFace = 0xfU;
/// Distance to the block's end, and to its side, along the face in steps of a cell; kFar: further.
inline constexpr unsigned kEndShift = 4;
inline constexpr unsigned kSideShift = 8;
inline constexpr std::uint16_t kFar = 0xfU;
inline constexpr std::uint16_t kFoot = 1U << 12U;       ///< a jaw's foot is near
inline constexpr std::uint16_t kUpperEdge = 1U << 13U;  ///< a jaw's upper edge is
}  // namespace surface_cell

/// Inner edges are rounded up to here, measured on the face.
inline constexpr double kSurfaceEdge_mm = 7.5;
/// Steps in which the distance to an outer edge is told: chamfers of 8 mm nominally wear to up to 12 mm.
inline constexpr std::size_t kSurfaceEdgeSteps = 10;

class SurfaceTable {
 public:
  /// `cells`: kSurfaceCells, owned by the caller. No heap; about 10 ms.
  void build(const BlockModel& model, std::span<std::uint16_t> cells);
  [[nodiscard]] std::span<const std::uint16_t> cells() const { return cells_; }
  /// Rows and columns within which there are faces: begin and end.
  [[nodiscard]] std::array<std::size_t, 2> rows() const { return rows_; }
  [[nodiscard]] std::array<std::size_t, 2> columns() const { return columns_; }
  /// Length over the block's faces across the rail, from the first row to the middle of this one, mm.
  [[nodiscard]] double across_mm(std::size_t row) const { return across_mm_[row]; }
  /// Where the block ends in a row, and where its shoulders end: |x| and |y| of the edges, mm.
  [[nodiscard]] double end_mm(std::size_t row) const { return end_mm_[row]; }
  [[nodiscard]] double side_mm(bool outer) const { return side_mm_[outer ? 1 : 0]; }

 private:
  std::span<std::uint16_t> cells_;
  std::array<double, kSurfaceRows> across_mm_{};
  std::array<double, kSurfaceRows> end_mm_{};
  std::array<double, 2> side_mm_{};
  std::array<std::size_t, 2> rows_{};
  std::array<std::size_t, 2> columns_{};
};

}  // namespace slabd::algo
