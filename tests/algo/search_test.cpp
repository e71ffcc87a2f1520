// SPDX-License-Identifier: Apache-2.0
//
// The loops that look for the block and its casings, against plain ones.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "algo/casing_strip.h"
#include "algo/place_count.h"
#include "base/base.h"

namespace slabd::algo {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

TEST(PlaceCount, CountsWhatAPlainLoopCountsWithinAndBeyondTheRaster) {
  constexpr int kColumns = 13;
  constexpr int kRows = 7;
  Prng prng(3);
  std::vector<float> cells(kColumns * kRows);
  for (float& c : cells) c = static_cast<float>(prng.below(9));
  std::vector<std::int32_t> column(64), row(64);
  std::vector<float> z(64);
  for (std::size_t i = 0; i < 64; ++i) {
    column[i] = static_cast<std::int32_t>(prng.below(21)) - 4;
    row[i] = static_cast<std::int32_t>(prng.below(15)) - 4;
    z[i] = i % 11 == 0 ? kNaN : static_cast<float>(prng.below(9));
  }
  z[5] = std::numeric_limits<float>::infinity();
  column[6] = 10000;
  const HeightRaster raster{cells, kColumns, kRows, 4.0F};
  for (int x = -5; x <= 5; ++x) {
    for (int y = -5; y <= 5; ++y) {
      int plain = 0;
      for (std::size_t i = 0; i < 64; ++i) {
        const int c = column[i] + x;
        const int r = row[i] + y;
        const bool inside = c >= 0 && c < kColumns && r >= 0 && r < kRows;
        const float height = inside ? cells[static_cast<std::size_t>(r * kColumns + c)] : 4.0F;
        plain += std::abs(z[i] + 0.5F - height) < 1.0F ? 1 : 0;
      }
      EXPECT_EQ(count_explained(raster, {column, row, z}, x, y, 0.5F, 1.0F, -1), plain);
      EXPECT_EQ(count_explained(raster, {column, row, z}, x, y, 0.5F, 1.0F, plain), plain);
      EXPECT_EQ(count_explained(raster, {column, row, z}, x, y, 0.5F, 1.0F, 60), 60) << "out of reach";
    }
  }
}

TEST(CasingStrips, HoldWhatAPlainLoopFindsAndNoMissingPoint) {
  CasingStrips strips;
  strips.half_spacing_mm = 116.5;
  strips.t_seat_scanner = Vec3(0.25, -0.125, 0.5);
  Prng prng(4);
  // Not a multiple of sixteen. Quarters of a millimetre are exact, so no point stands between two cells by rounding.
  std::vector<float> xyz(3 * 50'007);
  const auto quarter = [&](std::uint64_t range) {
    return 0.25F * (static_cast<float>(prng.below(8 * range)) - 4.0F * static_cast<float>(range));
  };
  for (std::size_t i = 0; i < xyz.size(); i += 3) {
    xyz[i] = quarter(150);
    xyz[i + 1] = quarter(170);
    xyz[i + 2] = quarter(5);
    if (i % 51 == 0) xyz[i] = xyz[i + 1] = xyz[i + 2] = kNaN;
    if (i % 57 == 0) xyz[i] = std::numeric_limits<float>::infinity();
  }
  std::vector<std::uint32_t> index(xyz.size() / 3), expected_index;
  std::vector<std::uint32_t> cells(2 * CasingStrips::kCells, 7U), expected(2 * CasingStrips::kCells, 0U);
  const std::size_t counted = count_strips({xyz, xyz.size() / 3, 0, 0}, strips, index, cells);
  index.resize(counted);
  for (std::size_t i = 0; i < xyz.size() / 3; ++i) {
    const double x = static_cast<double>(xyz[3 * i]) + 0.25;
    const double s = static_cast<double>(xyz[3 * i + 1]) - 0.125;
    const double h = static_cast<double>(xyz[3 * i + 2]) + 0.5;
    const double off = s < 0.0 ? s + 116.5 : s - 116.5;
    if (!(std::abs(h) <= CasingStrips::kHeight_mm && std::abs(off) < CasingStrips::kHalfRows &&
          std::abs(x) < CasingStrips::kHalfColumns))
      continue;
    const auto row = static_cast<std::size_t>(std::floor(off) + CasingStrips::kHalfRows);
    const auto column = static_cast<std::size_t>(std::floor(x) + CasingStrips::kHalfColumns);
    ++expected[(s < 0.0 ? 0 : CasingStrips::kCells) + row * CasingStrips::kColumns + column];
    expected_index.push_back(static_cast<std::uint32_t>(i));
  }
  EXPECT_EQ(index, expected_index);
  EXPECT_EQ(cells, expected);
  EXPECT_GT(counted, 1000U);
}

}  // namespace
}  // namespace slabd::algo
