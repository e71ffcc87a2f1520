// SPDX-License-Identifier: Apache-2.0
//
// Points in cells, one by one.
#include <algorithm>
#include <cmath>

#include "plain_kernels.h"

namespace slabd::algo::plain {
namespace {

/// Number of the column or row; points outside belong to the border.
std::int32_t step_of(float from_border_mm, float cells_per_mm, std::int32_t count) {
  const float at = from_border_mm * cells_per_mm;
  if (!(at > 0.0F)) return 0;
  if (at >= static_cast<float>(count - 1)) return count - 1;
  return static_cast<std::int32_t>(std::floor(at));
}

}  // namespace

std::int32_t cell_of(const CellLayout& layout, float x, float s) {
  return step_of(s + layout.half_s_mm, layout.cells_per_mm, layout.rows) * layout.columns +
         step_of(x + layout.half_x_mm, layout.cells_per_mm, layout.columns);
}

float height_in_cell(const CellLayout& layout, float x, float s, float h) {
  return layout.by_x * x + layout.by_s * s + layout.by_h * h + layout.offset_mm;
}

void add_to_cells(const SeatPoints& points, const CellLayout& layout, std::span<PlainCell> cells,
                  std::span<CellRange> ranges) {
  for (std::size_t i = 0; i < points.size(); ++i) {
    const float height = height_in_cell(layout, points.x[i], points.s[i], points.h[i]);
    const std::int32_t number = cell_of(layout, points.x[i], points.s[i]);
    PlainCell& cell = cells[static_cast<std::size_t>(number)];
    const std::array<float, 4> terms = {points.x[i], points.s[i], height, height * height};
    for (std::size_t k = 0; k < terms.size(); ++k) {
      cell.sums[k] += static_cast<double>(terms[k]);
      cell.sizes[k] += std::abs(static_cast<double>(terms[k]));
    }
    cell.low = std::min(cell.low, height);
    cell.high = std::max(cell.high, height);
    ++cell.points;

    const auto here = static_cast<std::uint16_t>(number);
    CellRange& range = ranges[i / kCellGroup];
    if (i % kCellGroup == 0) range = {here, here};
    range.first = std::min(range.first, here);
    range.last = std::max(range.last, here);
  }
}

}  // namespace slabd::algo::plain
