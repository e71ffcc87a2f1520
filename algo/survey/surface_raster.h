// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "algo/block_model.h"
#include "base/limits.h"

/// The block's surface on a raster of (x, y), block frame: distance of the scan from the nearest face of the model in
/// each cell. The survey fills it in its pass over the scan; the search for pores and damage reads it.
namespace slabd::algo {

/// Sums over the points of one cell. Integers, so that the order of the points and the number of threads do not
/// matter.
struct alignas(16) SurfaceCell {
  std::int32_t sum = 0;       ///< of the signed distances to the nearest face, in kSurfaceUnit_mm
  std::uint32_t squares = 0;  ///< of their squares
  std::uint32_t count = 0;
  std::uint32_t unused = 0;
};

/// Size of the raster: 220 x 490 mm, which is the block and 5 mm around it.
inline constexpr std::size_t kSurfaceColumns = 176;
inline constexpr std::size_t kSurfaceRows = 392;
inline constexpr std::size_t kSurfaceCells = kSurfaceColumns * kSurfaceRows;
static_assert(kSurfaceCells <= limits::kSurfaceCells);
/// Edge of a cell. A crack of 0.8 mm covers most of one; a pore of 2 mm covers two.
inline constexpr double kSurfaceCell_mm = 1.25;
inline constexpr double kSurfaceHalfX_mm = 0.5 * kSurfaceCell_mm * static_cast<double>(kSurfaceColumns);
inline constexpr double kSurfaceHalfY_mm = 0.5 * kSurfaceCell_mm * static_cast<double>(kSurfaceRows);
inline constexpr double kSurfaceUnit_mm = 1.0 / 128.0;
/// Distances are limited to this: a broken corner is 15 mm deep, and the square of this in units, times two hundred
/// points of a cell, still fits into its sum.
inline constexpr double kSurfaceReach_mm = 31.0;

/// Centre of a cell.
[[nodiscard]] constexpr double surface_x_mm(std::size_t column) {
  return (static_cast<double>(column) + 0.5) * kSurfaceCell_mm - kSurfaceHalfX_mm;
}
[[nodiscard]] constexpr double surface_y_mm(std::size_t row) {
  return (static_cast<double>(row) + 0.5) * kSurfaceCell_mm - kSurfaceHalfY_mm;
}

/// Target of a pass over the scan; no sums if `cells` is empty.
struct SurfaceSums {
  std::span<SurfaceCell> cells;
  std::size_t lanes = 16;  ///< points taken of each sixteen: 4, 8 or 16
  std::size_t width = 0;   ///< of an organised scan; 0 = unorganised
  std::size_t first = 0;   ///< number of the pass's first point in the scan
};

/// The recipe's part: the face visible in each cell, and the distances to the face's edges.
namespace surface_cell {
inline constexpr std::uint16_t kFaceBits = 0xfU;  ///< Face; kNoFace: the cell is not searched
inline constexpr std::uint16_t kNoFace = 0xfU;
/// Distance to the block's end, and to its side, along the face in steps of a cell; kFar if larger.
inline constexpr unsigned kEndShift = 4;
inline constexpr unsigned kSideShift = 8;
inline constexpr std::uint16_t kFar = 0xfU;
inline constexpr std::uint16_t kFoot = 1U << 12U;       ///< a jaw's foot is near
inline constexpr std::uint16_t kUpperEdge = 1U << 13U;  ///< a jaw's upper edge is near
}  // namespace surface_cell

/// Inner edges may be rounded up to here, measured on the face.
inline constexpr double kSurfaceEdge_mm = 7.5;
/// Number of steps for the distance to an outer edge: chamfers of 8 mm nominally wear to up to 12 mm.
inline constexpr std::size_t kSurfaceEdgeSteps = 10;

class SurfaceTable {
 public:
  /// `cells`: kSurfaceCells, owned by the caller. No heap; about 10 ms.
  void build(const BlockModel& model, std::span<std::uint16_t> cells);
  [[nodiscard]] std::span<const std::uint16_t> cells() const { return cells_; }
  /// Rows and columns that contain faces: begin and end.
  [[nodiscard]] std::array<std::size_t, 2> rows() const { return rows_; }
  [[nodiscard]] std::array<std::size_t, 2> columns() const { return columns_; }
  /// Length over the block's faces across the rail, from the first row to the middle of this one, mm.
  [[nodiscard]] double across_mm(std::size_t row) const { return across_mm_[row]; }
  /// End of the block in a row, and end of its shoulders: |x| and |y| of the edges, mm.
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
