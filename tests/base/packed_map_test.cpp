// SPDX-License-Identifier: Apache-2.0
#include "base/packed_map.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "base/prng.h"

namespace slabd {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

struct Grid {
  std::size_t columns = 0;
  std::size_t rows = 0;
  std::vector<double> heights;
  [[nodiscard]] PackedMap packed(double step_mm) const {
    PackedMap map;
    pack_map(
        columns, rows, 1.5, step_mm, [&](std::size_t c, std::size_t r) { return heights[r * columns + c]; }, map);
    return map;
  }
};

Grid random_grid(Prng& prng, std::size_t columns, std::size_t rows, double sigma_mm, double share_missing) {
  Grid grid{columns, rows, {}};
  for (std::size_t i = 0; i < columns * rows; ++i)
    grid.heights.push_back(prng.uniform() < share_missing ? kNone : sigma_mm * prng.normal());
  return grid;
}

void expect_unpacks(const Grid& grid, const PackedMap& map) {
  const std::optional<std::vector<float>> heights = unpack_map(map);
  ASSERT_TRUE(heights.has_value());
  ASSERT_EQ(heights->size(), grid.heights.size());
  for (std::size_t i = 0; i < heights->size(); ++i) {
    const double wanted = grid.heights[i];
    const double got = static_cast<double>((*heights)[i]);
    ASSERT_EQ(std::isnan(got), !std::isfinite(wanted)) << "cell " << i;
    if (std::isfinite(wanted)) {
      ASSERT_NEAR(got, wanted, 0.5001 * map.step_mm) << "cell " << i;
    }
  }
}

TEST(PackedMap, gives_back_every_height_to_half_a_step_and_every_missing_cell) {
  Prng prng(7);
  for (const double missing : {0.0, 0.02, 0.5, 0.98, 1.0}) {
    for (const std::size_t columns : {1UL, 2UL, 68UL, 100UL}) {
      const Grid grid = random_grid(prng, columns, 70, 0.05, missing);
      const PackedMap map = grid.packed(0.005);
      EXPECT_EQ(map.step_mm, 0.005);
      expect_unpacks(grid, map);
    }
  }
}

TEST(PackedMap, has_room_for_the_largest_map_the_daemon_makes_however_rough_it_is) {
  Prng prng(8);
  for (const double sigma_mm : {0.01, 1.0, 100.0}) {
    for (const double missing : {0.0, 0.5}) {
      const Grid grid = random_grid(prng, limits::kFaceTableX / limits::kDeviationMapCell_mm,
                                    limits::kFaceTableY / limits::kDeviationMapCell_mm, sigma_mm, missing);
      const PackedMap map = grid.packed(limits::kDeviationMapStep_mm);
      EXPECT_FALSE(map.empty());
      expect_unpacks(grid, map);
    }
  }
  Grid holes = random_grid(prng, 100, 150, 50.0, 0.0);  // the most expensive mask: every other cell
  for (std::size_t i = 0; i < holes.heights.size(); i += 2) holes.heights[i] = kNone;
  expect_unpacks(holes, holes.packed(0.01));
}

TEST(PackedMap, takes_less_than_three_bits_for_each_quiet_cell) {
  Prng prng(9);
  const Grid grid = random_grid(prng, 68, 100, 0.0045, 0.01);
  EXPECT_LT(grid.packed(limits::kSeatMapStep_mm).bytes.size() * 8, 3 * grid.heights.size());
}

TEST(PackedMap, cuts_absurd_heights_and_takes_infinity_for_not_seen) {
  Grid grid{3, 1, {1e12, -std::numeric_limits<double>::infinity(), -1e12}};
  const PackedMap map = grid.packed(0.01);
  const auto heights = unpack_map(map);
  ASSERT_TRUE(heights.has_value());
  EXPECT_FLOAT_EQ((*heights)[0], 327.67F);
  EXPECT_TRUE(std::isnan((*heights)[1]));
  EXPECT_FLOAT_EQ((*heights)[2], -327.67F);
}

TEST(PackedMap, that_no_room_can_hold_stays_empty) {
  Prng prng(10);
  Grid holes = random_grid(prng, 512, 512, 1.0, 0.0);
  for (std::size_t i = 0; i < holes.heights.size(); i += 2) holes.heights[i] = kNone;
  EXPECT_TRUE(holes.packed(0.01).empty());
  EXPECT_TRUE(random_grid(prng, 0, 5, 1.0, 0.0).packed(0.01).empty());
  EXPECT_TRUE(random_grid(prng, 513, 2, 1.0, 0.0).packed(0.01).empty());
  EXPECT_FALSE(unpack_map(PackedMap{}).has_value());
}

TEST(PackedMap, damaged_bytes_never_read_beyond_their_end) {
  Prng prng(11);
  const Grid grid = random_grid(prng, 40, 30, 0.05, 0.2);
  const PackedMap good = grid.packed(0.005);
  std::size_t refused = 0;
  for (int trial = 0; trial < 3000; ++trial) {
    PackedMap map = good;
    map.bytes.clear();
    const std::uint64_t length = prng.below(good.bytes.size() + 1);
    for (std::uint64_t i = 0; i < length; ++i)
      ASSERT_TRUE(map.bytes.push(trial % 2 == 0 ? good.bytes[i] : static_cast<std::uint8_t>(prng.below(256))));
    const auto heights = unpack_map(map);
    if (!heights) ++refused;
    if (heights) {
      EXPECT_EQ(heights->size(), grid.heights.size());
    }
  }
  EXPECT_GT(refused, 2500U);
}

}  // namespace
}  // namespace slabd
