// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "base/fixed.h"
#include "base/limits.h"

/// Grids of deviations, small enough to be stored with every block permanently. Heights are rounded to a step and
/// predicted from the previous cell and the cell below. The residuals are written as Rice codes.
namespace slabd {

/// Cells row by row, the first at the lowest x and y of the block's frame. Empty if nothing was mapped.
struct PackedMap {
  std::uint16_t columns = 0;  ///< along x
  std::uint16_t rows = 0;     ///< along y, or along the seat
  double cell_mm = 0.0;
  double step_mm = 0.0;  ///< heights are multiples of this step
  FixedVector<std::uint8_t, limits::kPackedMapBytes> bytes;

  [[nodiscard]] bool empty() const { return bytes.empty(); }
};

/// Maps of one block for reports.
struct BlockMaps {
  PackedMap registration;  ///< mean distance of the points to the model (paper Fig. 14)
  PackedMap seat;          ///< distance of the cell means to the fitted seat plane (paper Fig. 15)
};

/// Writes the rows of one map, lowest first.
class MapWriter {
 public:
  /// Clears `out` and begins a new map.
  MapWriter(PackedMap& out, std::size_t columns, std::size_t rows, double cell_mm, double step_mm);
  /// Adds a row: one height per column, NaN if nothing was seen. Heights beyond 32767 steps are clamped.
  void add_row(std::span<const double> heights_mm);
  /// True if all rows were added and fitted.
  [[nodiscard]] bool complete();

 private:
  void put(std::uint32_t value, unsigned bits);
  void put_run(std::uint32_t length);
  void put_rest(std::uint32_t rest, unsigned k);

  PackedMap& out_;
  std::size_t rows_ = 0;
  std::uint32_t open_bits_ = 0;
  unsigned open_ = 0;  ///< number of bits not written yet
  bool full_ = false;
  std::array<std::int32_t, limits::kMapColumnsMax> below_{};
};

/// Packs `height_mm(column, row)`. If the map does not fit, the step is doubled until it fits. The map stays empty
/// without rows, or with more rows or columns than kMapColumnsMax. No heap; 15 ns per cell.
template <typename Height>
void pack_map(std::size_t columns, std::size_t rows, double cell_mm, double step_mm, const Height& height_mm,
              PackedMap& out) {
  out = {};
  if (columns == 0 || rows == 0 || columns > limits::kMapColumnsMax || rows > limits::kMapColumnsMax) return;
  std::array<double, limits::kMapColumnsMax> row;
  // Beyond 2^20 steps all heights are equal; a map that still does not fit has more cells than the daemon produces.
  for (int doubled = 0; doubled <= 20; ++doubled) {
    MapWriter writer(out, columns, rows, cell_mm, std::ldexp(step_mm, doubled));
    for (std::size_t r = 0; r < rows; ++r) {
      for (std::size_t c = 0; c < columns; ++c) row[c] = height_mm(c, r);
      writer.add_row(std::span(row).first(columns));
    }
    if (writer.complete()) return;
  }
  out = {};
}

/// Heights in mm, row by row, NaN if nothing was seen. nullopt if the bytes are not a valid map.
[[nodiscard]] std::optional<std::vector<float>> unpack_map(const PackedMap& map);

}  // namespace slabd
