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

/// Grids of deviations, small enough to be kept with every block for ever. Heights are rounded to a step, predicted
/// from the cell before and the cell below, and what is left is written with as many bits as it needs (Rice codes).
namespace slabd {

/// Cells row by row, the first at the lowest x and y of the block's frame. Empty: nothing was mapped.
struct PackedMap {
  std::uint16_t columns = 0;  ///< along x
  std::uint16_t rows = 0;     ///< along y, or along the seat
  double cell_mm = 0.0;
  double step_mm = 0.0;  ///< heights are multiples of it
  FixedVector<std::uint8_t, limits::kPackedMapBytes> bytes;

  [[nodiscard]] bool empty() const { return bytes.empty(); }
};

/// What a report draws of one block.
struct BlockMaps {
  PackedMap registration;  ///< mean distance of the points to the model (paper Fig. 14)
  PackedMap seat;          ///< cell means to the fitted seat plane (paper Fig. 15)
};

/// Writes the rows of one map, lowest first.
class MapWriter {
 public:
  /// Starts `out` anew.
  MapWriter(PackedMap& out, std::size_t columns, std::size_t rows, double cell_mm, double step_mm);
  /// `heights_mm`: one per column, NaN where nothing was seen. Heights beyond 32767 steps are cut there.
  void add_row(std::span<const double> heights_mm);
  /// All rows were added and found room.
  [[nodiscard]] bool complete();

 private:
  void put(std::uint32_t value, unsigned bits);
  void put_run(std::uint32_t length);
  void put_rest(std::uint32_t rest, unsigned k);

  PackedMap& out_;
  std::size_t rows_ = 0;
  std::uint32_t open_bits_ = 0;
  unsigned open_ = 0;  ///< of them, not written yet
  bool full_ = false;
  std::array<std::int32_t, limits::kMapColumnsMax> below_{};
};

/// Packs `height_mm(column, row)`. A map that is too rough for its room gets a step twice as wide until it fits.
/// Without rows, or with more of them or of columns than kMapColumnsMax, the map stays empty. No heap; 15 ns a cell.
template <typename Height>
void pack_map(std::size_t columns, std::size_t rows, double cell_mm, double step_mm, const Height& height_mm,
              PackedMap& out) {
  out = {};
  if (columns == 0 || rows == 0 || columns > limits::kMapColumnsMax || rows > limits::kMapColumnsMax) return;
  std::array<double, limits::kMapColumnsMax> row;
  // Beyond 2^20 steps all heights are one, and a map that still finds no room has more cells than the daemon makes.
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

/// Heights in mm, row by row, NaN where nothing was seen. Nothing when the bytes are not those of such a map.
[[nodiscard]] std::optional<std::vector<float>> unpack_map(const PackedMap& map);

}  // namespace slabd
