// SPDX-License-Identifier: Apache-2.0
//
// The loops that search for the block and its casings, against plain ones.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "algo/register/block_search.h"
#include "algo/register/casing_ties.h"
#include "base/base.h"

namespace slabd::algo {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

TEST(PlaceCount, counts_what_a_plain_loop_counts_within_and_beyond_the_raster) {
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

/// Some points near the casings, some beyond them, some missing and some infinite. Quarters of a millimetre are exact,
/// so rounding does not affect any test for in or out.
std::vector<float> nasty_points(std::size_t count) {
  Prng prng(4);
  std::vector<float> xyz(3 * count);
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
  return xyz;
}

CasingStrips some_strips() {
  CasingStrips strips;
  strips.half_spacing_mm = 116.5;
  strips.t_seat_scanner = Vec3(0.25, -0.125, 0.5);
  return strips;
}

/// The point in the seat's frame.
Vec3 seat_point(const std::vector<float>& xyz, std::size_t i) {
  return Vec3(static_cast<double>(xyz[3 * i]), static_cast<double>(xyz[3 * i + 1]),
              static_cast<double>(xyz[3 * i + 2])) +
         some_strips().t_seat_scanner;
}

TEST(CasingStrips, places_of_a_sample_are_those_of_a_plain_loop) {
  constexpr std::size_t kPoints = 8'192;
  const std::vector<float> xyz = nasty_points(kPoints);
  std::array<std::vector<float>, 3> column;
  for (std::size_t i = 0; i < kPoints; ++i)
    for (std::size_t axis = 0; axis < 3; ++axis) column[axis].push_back(xyz[3 * i + axis] - (axis == 2 ? 7.0F : 0.0F));
  const IcpSample sample{column[0], column[1], column[2], Vec3(0.0, 0.0, 7.0)};
  for (const bool outer : {false, true}) {
    std::array<std::vector<float>, 3> found;
    for (auto& f : found) f.resize(kPoints + 16);
    const std::size_t count = places_in_box(sample, some_strips(), {outer, 60.0, 20.0}, {found[0], found[1], found[2]});
    std::array<std::vector<float>, 3> expected;
    for (std::size_t i = 0; i < kPoints; ++i) {
      const Vec3 p = seat_point(xyz, i);
      const double off = p.y() - (outer ? 116.5 : -116.5);
      if (!(std::abs(p.z()) <= CasingStrips::kHeight_mm && std::abs(off) <= 20.0 && std::abs(p.x()) <= 60.0)) continue;
      expected[0].push_back(static_cast<float>(p.x()));
      expected[1].push_back(static_cast<float>(off));
      expected[2].push_back(static_cast<float>(i));
    }
    EXPECT_GT(count, 50U);
    for (std::size_t k = 0; k < 3; ++k) {
      found[k].resize(count);
      EXPECT_EQ(found[k], expected[k]) << k;
    }
  }
}

TEST(CasingStrips, points_around_casings_are_those_of_a_plain_loop_in_parts_of_every_shape) {
  constexpr std::size_t kWidth = 211;
  constexpr std::size_t kHeight = 307;
  std::vector<float> xyz = nasty_points(kWidth * kHeight);
  const Cloud cloud{xyz, kWidth * kHeight, kWidth, kHeight};
  constexpr double kReach_mm = 40.0;
  const CloudPart parts[] = {{0, kWidth * kHeight, 1, 0},
                             {5, 1000, 1, 0},
                             {17 * kWidth + 3, 100, 200, kWidth},
                             {0, kWidth, kHeight, kWidth},
                             {40, 7, 300, kWidth},
                             {kWidth * kHeight - 5, 5, 1, 0},
                             {}};
  for (const CloudPart& part : parts) {
    std::array<std::vector<float>, 3> expected;
    for (std::size_t row = 0; row < part.rows; ++row) {
      for (std::size_t i = 0; i < part.columns; ++i) {
        const Vec3 p = seat_point(xyz, part.first + row * part.stride + i);
        if (!(std::abs(p.z()) <= CasingStrips::kHeight_mm && std::abs(std::abs(p.y()) - 116.5) <= kReach_mm &&
              std::abs(p.x()) <= kReach_mm))
          continue;
        for (int axis = 0; axis < 3; ++axis)
          expected[static_cast<std::size_t>(axis)].push_back(static_cast<float>(p[axis]));
      }
    }
    std::array<std::vector<float>, 3> room;
    for (auto& r : room) r.resize(kWidth * kHeight);
    const SeatPoints found = points_around_casings(cloud, part, some_strips(), kReach_mm, {room[0], room[1], room[2]});
    EXPECT_EQ(std::vector<float>(found.x.begin(), found.x.end()), expected[0]);
    EXPECT_EQ(std::vector<float>(found.s.begin(), found.s.end()), expected[1]);
    EXPECT_EQ(std::vector<float>(found.h.begin(), found.h.end()), expected[2]);
  }
}

TEST(CasingStrips, more_points_than_there_is_room_for_are_left_out) {
  constexpr std::size_t kPoints = 1'600;
  std::vector<float> xyz;
  for (std::size_t i = 0; i < kPoints; ++i) xyz.insert(xyz.end(), {0.0F, 116.0F, 0.0F});
  const Cloud cloud{xyz, kPoints, 0, 0};
  std::array<std::vector<float>, 3> room;
  for (auto& r : room) r.assign(200, -1.0F);
  const SeatPoints found =
      points_around_casings(cloud, {0, kPoints, 1, 0}, some_strips(), 10.0, {room[0], room[1], room[2]});
  EXPECT_GT(found.size(), 150U);
  EXPECT_LE(found.size(), 200U);
}

}  // namespace
}  // namespace slabd::algo
