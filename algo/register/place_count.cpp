// SPDX-License-Identifier: Apache-2.0
//
// The search's inner loop, sixteen points at a time: counts the explained points of ten thousand positions.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "algo/register/place_count.cpp"
// clang-format off
#include <hwy/foreach_target.h>
#include "algo/lanes-inl.h"
// clang-format on

#include "algo/register/block_search.h"

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {

int count_explained_kernel(const HeightRaster& raster, const PlacedPoints& points, int x_cells, int y_cells,
                           float rise_mm, float gate_mm, int to_beat) {
  const F16 zero = f16(0.0F);
  const F16 columns = f16(static_cast<float>(raster.columns));
  const F16 rows = f16(static_cast<float>(raster.rows));
  int explained = 0;
  auto left = static_cast<int>(points.z.size());
  for (std::size_t i = 0; i < points.z.size(); i += kLanes) {
    // Integers that are exact as floats.
    const F16 column = to_float(load(&points.column[i]) + i16(x_cells));
    const F16 row = to_float(load(&points.row[i]) + i16(y_cells));
    const M16 inside = (column >= zero) & (column < columns) & (row >= zero) & (row < rows);
    const F16 cell = keep(inside, row * columns + column);
    const F16 height = select(inside, gather(raster.cells.data(), to_int(cell)), f16(raster.beyond));
    const F16 off = load(&points.z[i]) + f16(rise_mm) - height;
    explained += __builtin_popcount(bits(abs(off) < f16(gate_mm)));
    left -= static_cast<int>(kLanes);
    if (explained + left <= to_beat) return to_beat;
  }
  return explained;
}

}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace slabd::algo {
HWY_EXPORT(count_explained_kernel);

int count_explained(const HeightRaster& raster, const PlacedPoints& points, int x_cells, int y_cells, float rise_mm,
                    float gate_mm, int to_beat) {
  return HWY_DYNAMIC_DISPATCH(count_explained_kernel)(raster, points, x_cells, y_cells, rise_mm, gate_mm, to_beat);
}

}  // namespace slabd::algo
#endif
