// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace slabd::algo {

/// Heights by cell, row by row.
struct HeightRaster {
  std::span<const float> cells;
  int columns = 0;
  int rows = 0;
  float beyond = 0.0F;  ///< height outside
};

/// Points by the cell of the raster they lie over and their height. The columns are a multiple of sixteen long; NaN for
/// a height: no point.
struct PlacedPoints {
  std::span<const std::int32_t> column;
  std::span<const std::int32_t> row;
  std::span<const float> z;
};

/// Points that lie within `gate_mm` of the raster's height when moved by whole cells and `rise_mm`; `to_beat` as soon
/// as there cannot be more than so many. Some 20 ns for each sixteen points.
[[nodiscard]] int count_explained(const HeightRaster& raster, const PlacedPoints& points, int x_cells, int y_cells,
                                  float rise_mm, float gate_mm, int to_beat);

}  // namespace slabd::algo
