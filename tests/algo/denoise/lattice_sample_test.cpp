// SPDX-License-Identifier: Apache-2.0
//
// Points in the sample of the lattice search. The sample is not accessible, but a lattice is found only if their number
// is in a certain range. So a scan with exactly the minimum or maximum number, by a plain count, tests every single
// point: one missed makes too few, one taken twice or wrongly makes too many.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "algo/denoise/lattice.h"
#include "tests/algo/each_set.h"
#include "tests/algo/scene.h"

namespace slabd::algo {
namespace {

using slabd::testing::on_each_set;

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();

/// A smaller sample shows no steps (algo/denoise/lattice.cpp); the capacity is kLatticeSampleMax.
constexpr std::size_t kSampleMin = 2'048;
/// Points that a thread processes as one task.
constexpr std::size_t kPiece = 1U << 17U;

/// About one point in this number is taken: the power of two that uses half of the capacity.
std::size_t share_of(std::size_t points) {
  std::size_t share = 1;
  while (points / share > kLatticeSampleMax / 2) share *= 2;
  return share;
}

/// True if the bits of the coordinates select the point, even if they are not numbers.
bool is_chosen(const float* p, std::size_t share) {
  const std::uint32_t all =
      std::bit_cast<std::uint32_t>(p[0]) ^ std::bit_cast<std::uint32_t>(p[1]) ^ std::bit_cast<std::uint32_t>(p[2]);
  const auto mask = static_cast<std::uint32_t>(share - 1);
  return (all & mask) == (0x2AAAAAAAU & mask);
}

std::size_t sampled(const std::vector<float>& xyz) {
  const std::size_t share = share_of(xyz.size() / 3);
  std::size_t count = 0;
  for (std::size_t i = 0; i < xyz.size(); i += 3) {
    const bool finite = std::isfinite(xyz[i]) && std::isfinite(xyz[i + 1]) && std::isfinite(xyz[i + 2]);
    count += finite && is_chosen(&xyz[i], share) ? 1U : 0U;
  }
  return count;
}

bool find(std::vector<float>& xyz, Lattice& lattice, int threads = 1) {
  std::vector<float> memory(kLatticeFloats);
  Team team(threads);
  return find_lattice({xyz, xyz.size() / 3, 0, 0}, memory, team, lattice);
}

/// Draws points on a lattice of 128 columns and 96 rows half a millimetre apart.
struct Drawing {
  std::size_t share;
  Prng prng{41};

  void point(float* p, bool chosen) {
    do {
      p[0] = static_cast<float>(0.5 * (static_cast<double>(prng.below(128)) + 0.02 * prng.uniform()) - 31.4);
      p[1] = static_cast<float>(0.5 * (static_cast<double>(prng.below(96)) + 0.02 * prng.uniform()) - 22.7);
      p[2] = static_cast<float>(600.0 + 20.0 * prng.uniform());
    } while (is_chosen(p, share) != chosen);
  }
  /// Makes a missing point whose bits are selected or not.
  void no_point(float* p) {
    do {
      point(p, share == 1 || prng.below(2) == 0);
      const std::uint64_t kind = prng.below(4);
      const auto payload = static_cast<std::uint32_t>(prng.below(1U << 22U));
      p[kind % 3] = kind == 3 ? -kInf : std::bit_cast<float>(0x7FC0'0000U | payload);
    } while (!is_chosen(p, share));
  }
};

/// `points` points, of which `chosen` are selected, from number `from` on, evenly between all others.
std::vector<float> scan(std::size_t points, std::size_t chosen, std::size_t from = 0) {
  std::vector<float> xyz(3 * points);
  Drawing draw{share_of(points)};
  for (std::size_t i = 0; i < points; ++i) {
    const bool here = i >= from && (i - from) * chosen / (points - from) != (i - from + 1) * chosen / (points - from);
    if (draw.share > 1 || here)
      draw.point(&xyz[3 * i], here);
    else
      draw.no_point(&xyz[3 * i]);
  }
  return xyz;
}

void remove(std::vector<float>& xyz, std::size_t point) {
  std::fill_n(xyz.begin() + static_cast<std::ptrdiff_t>(3 * point), 3, kNaN);
}

TEST(LatticeSample, contains_every_point_of_a_small_scan) {
  Lattice lattice;
  // All finite; then with missing ones between them.
  for (std::size_t points = kSampleMin; points <= kSampleMin + 40; ++points) {
    SCOPED_TRACE(points);
    std::vector<float> xyz = scan(points, kSampleMin);
    ASSERT_EQ(sampled(xyz), kSampleMin);
    on_each_set([&] { EXPECT_TRUE(find(xyz, lattice)); });
    std::vector<std::size_t> at = {0, 1, points / 2, points - 17, points - 16, points - 2, points - 1};
    for (const std::size_t i : at) {
      std::vector<float> fewer = xyz;
      remove(fewer, i);
      EXPECT_EQ(find(fewer, lattice), sampled(fewer) >= kSampleMin) << i;
    }
  }
}

/// One point decides; it is tested at every position of a sixteen, at the beginning, inside and at the end.
TEST(LatticeSample, has_a_chosen_point_at_any_position) {
  for (const std::size_t points : {20'000U, 20'001U, 20'015U}) {
    constexpr std::size_t kFirst = 60;
    const std::vector<float> others = scan(points, kSampleMin - 1, kFirst);
    ASSERT_EQ(sampled(others), kSampleMin - 1);
    std::vector<float> xyz = others;
    Lattice lattice;
    EXPECT_FALSE(find(xyz, lattice)) << "one is missing";

    std::array<float, 3> one;
    Drawing draw{share_of(points), Prng(42)};
    draw.point(one.data(), true);
    std::vector<std::size_t> places;
    for (std::size_t i = 0; i < points; ++i)
      if ((i < 50 || (i > 9'000 && i < 9'040) || i + 50 > points) && !is_chosen(&others[3 * i], draw.share))
        places.push_back(i);
    ASSERT_GE(places.size(), 100U);
    Lattice first;
    for (const std::size_t at : places) {
      SCOPED_TRACE(std::to_string(at) + " of " + std::to_string(points));
      xyz = others;
      std::copy(one.begin(), one.end(), xyz.begin() + static_cast<std::ptrdiff_t>(3 * at));
      if (at == places.front()) {
        ASSERT_TRUE(find(xyz, first));
      }
      on_each_set([&] {
        EXPECT_TRUE(find(xyz, lattice));
        EXPECT_TRUE(lattice == first);
      });
    }
  }
}

TEST(LatticeSample, has_no_point_twice_and_none_that_is_not_chosen) {
  for (const std::size_t points : {40'000U, 40'001U, 40'013U}) {
    SCOPED_TRACE(points);
    std::vector<float> xyz = scan(points, kLatticeSampleMax);
    ASSERT_EQ(sampled(xyz), kLatticeSampleMax);
    // Selected bits that are not a number take no space.
    Drawing draw{share_of(points), Prng(43)};
    for (std::size_t i = 0; i < points; ++i)
      if (!is_chosen(&xyz[3 * i], draw.share) && draw.prng.below(20) == 0) draw.no_point(&xyz[3 * i]);
    ASSERT_EQ(sampled(xyz), kLatticeSampleMax);
    Lattice lattice;
    on_each_set([&] { EXPECT_TRUE(find(xyz, lattice)); });
    for (std::size_t at = 0; at < points; ++at) {
      if (is_chosen(&xyz[3 * at], draw.share) || (at > 40 && at + 40 < points)) continue;
      std::vector<float> more = xyz;
      draw.point(&more[3 * at], true);
      EXPECT_FALSE(find(more, lattice)) << "one too many at " << at;
    }
  }
}

TEST(LatticeSample, is_the_same_in_pieces_and_on_two_threads) {
  constexpr std::size_t kPoints = 2 * kPiece + 17;
  const std::vector<float> others = scan(kPoints, kSampleMin - 1);
  std::array<float, 3> one;
  Drawing draw{share_of(kPoints), Prng(44)};
  draw.point(one.data(), true);
  Lattice first;
  bool found = false;
  for (const std::size_t at : {std::size_t{0}, kPiece - 17, kPiece - 2, kPiece - 1, kPiece, kPiece + 1, kPiece + 16,
                               2 * kPiece - 1, 2 * kPiece, 2 * kPiece + 15, kPoints - 1}) {
    if (is_chosen(&others[3 * at], draw.share)) continue;
    SCOPED_TRACE(at);
    std::vector<float> xyz = others;
    std::copy(one.begin(), one.end(), xyz.begin() + static_cast<std::ptrdiff_t>(3 * at));
    ASSERT_EQ(sampled(xyz), kSampleMin);
    for (const int threads : {1, 2}) {
      Lattice lattice;
      ASSERT_TRUE(find(xyz, lattice, threads)) << threads;
      if (!found) first = lattice;
      found = true;
      EXPECT_TRUE(lattice == first) << threads;
    }
  }
}

/// Real scans in any order: about the wanted number, and one lattice.
TEST(LatticeSample, contains_the_stated_share_of_a_scan_and_leads_to_one_lattice) {
  for (const double focus_mm : {0.0, 600.0}) {
    for (const double pitch_mm : {0.5, 1.1}) {
      SCOPED_TRACE(std::to_string(focus_mm) + ' ' + std::to_string(pitch_mm));
      scene::Scan scene;
      scene.pitch_mm = pitch_mm;
      scene.focus_mm = focus_mm;
      scene.displacement = scene::displaced(2.0, -3.0, 0.0, 2.0, -1.0, 2.0);
      std::vector<float> xyz = scene::take({}, scene).xyz;
      const std::size_t share = share_of(xyz.size() / 3);
      EXPECT_GT(share, 1U);
      const double wanted = static_cast<double>(xyz.size() / 3) / static_cast<double>(share);
      EXPECT_NEAR(static_cast<double>(sampled(xyz)), wanted, 0.05 * wanted);
      Lattice first;
      ASSERT_TRUE(find(xyz, first));
      // Missing points move all others to other positions in their sixteens.
      for (const std::size_t missing : {0U, 1U, 2U, 7U, 16U}) {
        std::vector<float> moved(3 * missing, kNaN);
        moved.insert(moved.end(), xyz.begin(), xyz.end());
        for (std::size_t i = 0; i < missing; ++i) moved.insert(moved.end(), {kNaN, kInf, 1.0F});
        ASSERT_EQ(share_of(moved.size() / 3), share);
        on_each_set([&] {
          for (const int threads : {1, 2}) {
            Lattice lattice;
            EXPECT_TRUE(find(moved, lattice, threads));
            EXPECT_TRUE(lattice == first) << missing << " missing, " << threads << " threads";
          }
        });
      }
    }
  }
}

}  // namespace
}  // namespace slabd::algo
