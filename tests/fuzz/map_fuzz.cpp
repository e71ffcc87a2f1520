// SPDX-License-Identifier: Apache-2.0
//
// Input: a packed map as stored in a database: columns, rows (two bytes each), then the bits.
#include "base/packed_map.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace slabd;  // NOLINT(google-build-using-namespace)
  if (size < 4) return 0;
  PackedMap map;
  map.columns = static_cast<std::uint16_t>(data[0] | data[1] << 8);
  map.rows = static_cast<std::uint16_t>(data[2] | data[3] << 8);
  map.cell_mm = 4.0;
  map.step_mm = 0.01;
  for (std::size_t i = 4; i < size; ++i)
    if (!map.bytes.push(data[i])) break;
  const auto heights = unpack_map(map);
  if (heights)
    fuzz::must(heights->size() == static_cast<std::size_t>(map.columns) * map.rows, "a map has all its cells");
  return 0;
}
