// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

#include "base/base.h"

/// Points sorted into square cells over the scanner's XY; the cell size is given in point pitches. Finds neighbours
/// without a tree, for organised and unorganised clouds.
namespace slabd::algo {

class PointGrid {
 public:
  /// Memory: `order` >= points; `cell_start` limits::kDenoiseCellsMax + 1.
  PointGrid(std::span<std::uint32_t> order, std::span<std::uint32_t> cell_start)
      : order_(order), cell_start_(cell_start) {}

  /// Sorts points (x y z, ...), finite or missing (x is NaN; at least one is not). The grid depends on the set of
  /// points, not on their order; within a cell the order is kept. O(points), six passes.
  void build(const float* xyz, std::size_t points, float cell_pitches);

  /// Sorts the same points again, with the pitch multiplied by `times`.
  void widen(const float* xyz, std::size_t points, float times, float cell_pitches);

  /// Typical distance of neighbouring points in XY: a square of that side contains one point in the middle of the scan.
  [[nodiscard]] float pitch_mm() const { return pitch_mm_; }
  [[nodiscard]] float cell_mm() const { return 1.0F / per_mm_; }
  [[nodiscard]] int columns() const { return columns_; }
  [[nodiscard]] int rows() const { return rows_; }
  [[nodiscard]] std::size_t cells() const {
    return static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_);
  }
  [[nodiscard]] std::size_t cell(int column, int row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) + static_cast<std::size_t>(column);
  }
  [[nodiscard]] int column(float x) const { return clamped((x - x0_) * per_mm_, columns_); }
  [[nodiscard]] int row(float y) const { return clamped((y - y0_) * per_mm_, rows_); }
  /// Indices of the points of a cell. The owner of the grid may reorder them.
  [[nodiscard]] std::span<std::uint32_t> in_cell(std::size_t cell) {
    return order_.subspan(cell_start_[cell], cell_start_[cell + 1] - cell_start_[cell]);
  }
  [[nodiscard]] std::span<const std::uint32_t> in_cell(std::size_t cell) const {
    return order_.subspan(cell_start_[cell], cell_start_[cell + 1] - cell_start_[cell]);
  }

 private:
  [[nodiscard]] static int clamped(float cell, int count) {
    // Compared as float first: a stray coordinate of 1e30 does not fit into an int.
    if (!(cell > 0.0F)) return 0;
    if (cell >= static_cast<float>(count)) return count - 1;
    return static_cast<int>(cell);
  }
  [[nodiscard]] std::size_t cell_of(const float* p) const { return cell(column(p[0]), row(p[1])); }
  void find_extent(const float* xyz, std::size_t points);
  void lay_out(float cell_mm);
  void count_points(const float* xyz, std::size_t points);
  void find_pitch(const float* xyz, std::size_t points);
  void sort_points(const float* xyz, std::size_t points);

  std::span<std::uint32_t> order_;
  std::span<std::uint32_t> cell_start_;
  float x0_ = 0.0F, y0_ = 0.0F, x1_ = 0.0F, y1_ = 0.0F;
  float per_mm_ = 1.0F;
  float pitch_mm_ = 1.0F;
  int columns_ = 1;
  int rows_ = 1;
};

}  // namespace slabd::algo
