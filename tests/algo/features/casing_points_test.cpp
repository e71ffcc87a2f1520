// SPDX-License-Identifier: Apache-2.0
//
// The passes of algo/features/casing_points against plain ones, with every instruction set: the points in the ring, to
// the last bit of their heights, and the innermost point of each sector.
#include "algo/features/casing_points.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "plain_kernels.h"
#include "point_arrays.h"
#include "tests/algo/each_set.h"

namespace slabd::algo {
namespace {

using slabd::testing::kHuge;
using slabd::testing::kInf;
using slabd::testing::kNaN;
using slabd::testing::kTiny;
using slabd::testing::on_each_set;
using Points = slabd::testing::PointArrays;

constexpr std::size_t kSectors = limits::kRimSectors;

const std::vector<std::size_t> kCounts = {0, 1, 2, 15, 16, 17, 31, 32, 33, 47, 48, 49, 255, 256, 257, 10'000};

/// A casing's frame equal to the seat's, except for the origin.
const CasingAxes kStraight = {0.0F, 116.5F, {1.0F, 0.0F, 0.0F}, {0.0F, 1.0F, 0.0F}, {0.0F, 0.0F, 1.0F}, 0.0F};
/// A frame tilted like a fitted seat.
const CasingAxes kTilted = {
    0.2F, -116.5F, {0.999992F, 0.00003F, -0.004F}, {0.0F, 0.99997F, 0.007F}, {0.004F, -0.007F, 0.99996F}, -0.13F};
const CasingRing kRing = {0.3F, -0.2F, 12.5F, 17.5F, -1.0F, 0.5F};

/// Points around a casing, without those whose sector depends on float rounding. Some are absurd.
Points around(const CasingAxes& axes, const CasingRing& ring, std::size_t count) {
  Points points;
  Prng prng(31);
  while (points.x.size() < count) {
    const auto x = static_cast<float>(static_cast<double>(axes.x_mm) + 40.0 * prng.uniform() - 20.0);
    const auto s = static_cast<float>(static_cast<double>(axes.s_mm) + 40.0 * prng.uniform() - 20.0);
    const auto h = static_cast<float>(prng.uniform() < 0.2 ? 4.0 * prng.normal() : -0.25 + 0.03 * prng.normal());
    const double turn = plain::turn_in_sectors(plain::in_ring(axes, ring, x, s, h));
    if (std::abs(turn - std::round(turn)) < 1e-4) continue;
    switch (prng.below(40)) {
      case 0: points.add(kNaN, s, h); break;
      case 1: points.add(x, kNaN, h); break;
      case 2: points.add(x, s, kNaN); break;
      case 3: points.add(prng.below(2) == 0 ? kHuge : -kInf, s, h); break;
      case 4: points.add(x, prng.below(2) == 0 ? -kHuge : kInf, h); break;
      case 5: points.add(x, s, prng.below(2) == 0 ? kInf : -kHuge); break;
      case 6: points.add(x, s, prng.below(2) == 0 ? -0.0F : kTiny); break;
      default: points.add(x, s, h);
    }
  }
  return points;
}

bool same_bits(std::span<const float> a, std::span<const float> b) {
  return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size_bytes()) == 0);
}

/// Innermost points, with marker values in empty sectors.
Innermost nothing_seen(const CasingRing& ring) {
  Innermost innermost(ring);
  innermost.x.fill(77.0F);
  innermost.y.fill(78.0F);
  return innermost;
}

void expect_same(const Innermost& fast, const Innermost& plain) {
  for (std::size_t k = 0; k < kSectors; ++k) {
    EXPECT_EQ(fast.radius2[k], plain.radius2[k]) << k;
    EXPECT_EQ(fast.x[k], plain.x[k]) << k;
    EXPECT_EQ(fast.y[k], plain.y[k]) << k;
  }
}

void expect_same_heights(const SeatPoints& points, const CasingAxes& axes, const CasingRing& ring) {
  const std::vector<float> plain = plain::heights_in_ring(points, axes, ring);
  std::vector<float> fast(points.size() + 1, 99.0F);
  const std::size_t count = heights_in_ring(points, axes, ring, std::span(fast).first(points.size()));
  ASSERT_EQ(count, plain.size());
  EXPECT_TRUE(same_bits(std::span(fast).first(count), plain));
  EXPECT_EQ(fast.back(), 99.0F) << "beyond the room";
}

TEST(CasingPoints, in_the_ring_are_those_of_a_plain_loop_to_the_bit) {
  for (const CasingAxes& axes : {kStraight, kTilted}) {
    const Points points = around(axes, kRing, kCounts.back() + 3);
    CasingRing any_height = kRing;
    any_height.low_mm = -kHuge;
    any_height.high_mm = kHuge;
    CasingRing disc = kRing;
    disc.inner_mm = 0.0F;
    CasingRing none = kRing;
    none.outer_mm = none.inner_mm;
    for (const std::size_t count : kCounts) {
      for (const std::size_t first : {std::size_t{0}, std::size_t{3}}) {
        SCOPED_TRACE(std::to_string(count) + " from " + std::to_string(first));
        for (const CasingRing& ring : {kRing, any_height, disc, none})
          on_each_set([&] { expect_same_heights(points.part(first, count), axes, ring); });
      }
    }
  }
}

TEST(CasingPoints, innermost_of_each_sector_are_those_of_a_plain_loop) {
  for (const CasingAxes& axes : {kStraight, kTilted}) {
    const Points points = around(axes, kRing, kCounts.back() + 3);
    for (const std::size_t count : kCounts) {
      for (const std::size_t first : {std::size_t{0}, std::size_t{3}}) {
        SCOPED_TRACE(std::to_string(count) + " from " + std::to_string(first));
        const SeatPoints part = points.part(first, count);
        Innermost plain = nothing_seen(kRing);
        plain::find_innermost(part, axes, kRing, plain);
        on_each_set([&] {
          Innermost fast = nothing_seen(kRing);
          find_innermost(part, axes, kRing, fast);
          expect_same(fast, plain);
          // Two calls give the same as one.
          Innermost halves = nothing_seen(kRing);
          find_innermost(points.part(first, count / 3), axes, kRing, halves);
          find_innermost(points.part(first + count / 3, count - count / 3), axes, kRing, halves);
          expect_same(halves, plain);
        });
      }
    }
  }
}

TEST(CasingPoints, on_the_rings_borders_are_in_or_out_as_stated) {
  // 5, 12, 13 and 7, 24, 25: radii that are exact, 13 in and 25 out; exact heights, both in.
  const CasingRing ring = {0.0F, 0.0F, 13.0F, 25.0F, -0.25F, 0.5F};
  const float in = 13.0F;
  struct Case {
    float x, y, height;
    bool in;
  };
  const std::vector<Case> cases = {
      {5.0F, 12.0F, 0.0F, true},
      {-12.0F, 5.0F, 0.0F, true},
      {in, -0.0F, -0.0F, true},
      {-0.0F, -in, 0.0F, true},
      {std::nextafter(in, 0.0F), 0.0F, 0.0F, false},
      {7.0F, -24.0F, 0.0F, false},
      {-25.0F, 0.0F, 0.0F, false},
      {std::nextafter(25.0F, 0.0F), 0.0F, 0.0F, true},
      {15.0F, 1.0F, -0.25F, true},
      {15.0F, 1.0F, 0.5F, true},
      {15.0F, 1.0F, std::nextafter(-0.25F, -1.0F), false},
      {15.0F, 1.0F, std::nextafter(0.5F, 1.0F), false},
      {0.0F, 0.0F, 0.0F, false},
      {kTiny, -kTiny, kTiny, false},
      {kNaN, 15.0F, 0.0F, false},
      {15.0F, kNaN, 0.0F, false},
      {15.0F, 0.0F, kNaN, false},
      {kInf, kInf, 0.0F, false},
      {kHuge, -kHuge, 0.0F, false},
  };
  CasingAxes axes = kStraight;
  axes.s_mm = 0.0F;
  for (std::size_t c = 0; c < cases.size(); ++c) {
    for (const std::size_t count : {1U, 15U, 16U, 17U, 33U}) {
      for (std::size_t at = 0; at < count; ++at) {
        SCOPED_TRACE("case " + std::to_string(c) + ", " + std::to_string(at) + " of " + std::to_string(count));
        Points points;
        for (std::size_t i = 0; i < count; ++i) points.add(1.0F, 1.0F, 0.0F);
        points.x[at] = cases[c].x;
        points.s[at] = cases[c].y;
        points.h[at] = cases[c].height;
        points.add(15.0F, 1.0F, 0.0F);  // after the end
        on_each_set([&] {
          std::array<float, 33> heights;
          ASSERT_EQ(heights_in_ring(points.part(0, count), axes, ring, heights), cases[c].in ? 1U : 0U);
          if (cases[c].in) {
            EXPECT_EQ(heights[0], cases[c].height);
          }
          Innermost innermost(ring);
          find_innermost(points.part(0, count), axes, ring, innermost);
          std::size_t seen = 0;
          for (std::size_t k = 0; k < kSectors; ++k) seen += innermost.seen(k, ring) ? 1U : 0U;
          EXPECT_EQ(seen, cases[c].in ? 1U : 0U);
        });
      }
    }
  }
}

TEST(CasingPoints, belong_to_one_of_the_two_sectors_whose_border_they_are_on) {
  CasingAxes axes = kStraight;
  axes.s_mm = 0.0F;
  const CasingRing ring = {0.0F, 0.0F, 12.5F, 17.5F, -1.0F, 1.0F};
  for (std::size_t k = 0; k < kSectors; ++k) {
    for (const double beside : {-1e-5, 0.0, 1e-5}) {
      SCOPED_TRACE(std::to_string(k) + (beside < 0.0 ? " before" : beside > 0.0 ? " behind" : " on it"));
      const double turn = 2.0 * kPi * static_cast<double>(k) / static_cast<double>(kSectors) + beside;
      Points points;
      points.add(static_cast<float>(15.0 * std::cos(turn)), static_cast<float>(15.0 * std::sin(turn)), 0.0F);
      // Axes and diagonals are exact, with zeros of both signs.
      if (beside == 0.0 && k % 12 == 0) (k % 24 == 0 ? points.s[0] : points.x[0]) = k < 24 ? 0.0F : -0.0F;
      if (beside == 0.0 && k % 12 == 6) points.s[0] = std::copysign(points.x[0], points.s[0]);
      const std::size_t before = (k + kSectors - 1) % kSectors;
      on_each_set([&] {
        Innermost innermost(ring);
        find_innermost(points.part(0, 1), axes, ring, innermost);
        for (std::size_t sector = 0; sector < kSectors; ++sector) {
          const bool there = innermost.seen(sector, ring);
          const bool either = beside == 0.0 && (sector == k || sector == before);
          const std::size_t expected = beside < 0.0 ? before : k;
          EXPECT_TRUE(either || there == (sector == expected)) << sector;
        }
        if (beside == 0.0) {
          EXPECT_NE(innermost.seen(before, ring), innermost.seen(k, ring));
        }
      });
    }
  }
}

TEST(CasingPoints, keep_the_first_of_two_points_at_equal_distance) {
  CasingAxes axes = kStraight;
  axes.s_mm = 0.0F;
  const CasingRing ring = {0.0F, 0.0F, 12.5F, 17.5F, -1.0F, 1.0F};
  // 33, 56, 65 and 39, 52, 65: in one sector, 6.4 degrees apart.
  const std::array<std::array<float, 2>, 2> pair = {{{14.0F, 8.25F}, {13.0F, 9.75F}}};
  constexpr std::size_t kCount = 37;
  for (std::size_t i = 0; i < kCount; ++i) {
    for (std::size_t j = 0; j < kCount; ++j) {
      if (i == j) continue;
      SCOPED_TRACE(std::to_string(i) + ' ' + std::to_string(j));
      Points points;
      for (std::size_t k = 0; k < kCount; ++k) points.add(14.5F, 9.25F, 0.0F);  // further out in that sector
      points.x[i] = pair[0][0], points.s[i] = pair[0][1];
      points.x[j] = pair[1][0], points.s[j] = pair[1][1];
      const std::array<float, 2>& expected = pair[i < j ? 0 : 1];
      on_each_set([&] {
        Innermost innermost(ring);
        find_innermost(points.part(0, kCount), axes, ring, innermost);
        std::size_t seen = 0;
        for (std::size_t k = 0; k < kSectors; ++k) {
          if (!innermost.seen(k, ring)) continue;
          ++seen;
          EXPECT_EQ(innermost.radius2[k], 16.25F * 16.25F);
          EXPECT_EQ(innermost.x[k], expected[0]);
          EXPECT_EQ(innermost.y[k], expected[1]);
        }
        EXPECT_EQ(seen, 1U);
      });
    }
  }
}

}  // namespace
}  // namespace slabd::algo
