// SPDX-License-Identifier: Apache-2.0
//
// The passes of algo/features/plane_zone against plain ones: exactly the same points and their sums, with every
// instruction set, with ends of runs everywhere.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "plain_kernels.h"
#include "point_arrays.h"
#include "tests/algo/each_set.h"

namespace slabd::algo {
namespace {

using slabd::testing::kHuge;
using slabd::testing::kNaN;
using slabd::testing::kTiny;
using slabd::testing::on_each_set;
using Points = slabd::testing::PointArrays;

/// Around sixteen, and around the sixteen sixteens after which float sums are added to double ones.
const std::vector<std::size_t> kCounts = {0,  1,   2,   15,  16,  17,  31,  32,  33,  47,  48,
                                          49, 255, 256, 257, 271, 272, 273, 511, 512, 513, 10'000};

/// In quarters of a millimetre: all results are exact, and a third of the points is exactly at within_mm.
constexpr Tilt kQuarters = {0.25F, 0.5F, -0.25F};
constexpr float kWithin_mm = 1.25F;
Points in_quarters(std::size_t count) {
  Points points;
  Prng prng(11);
  const auto quarters = [&](std::uint64_t most) {
    return 0.25F * (static_cast<float>(prng.below(2 * most + 1)) - static_cast<float>(most));
  };
  for (std::size_t i = 0; i < count; ++i) {
    const float x = quarters(40);
    const float s = quarters(40);
    const float on_plane = kQuarters.a0 + kQuarters.a1 * x + kQuarters.a2 * s;
    const float cut = i % 2 == 0 ? kWithin_mm : -kWithin_mm;
    points.add(x, s, on_plane + (prng.below(3) == 0 ? cut : quarters(10)));
  }
  return points;
}

/// Noise about a plane, every fifth point a stray; some are absurd.
constexpr Tilt kSlope = {0.31F, 0.004F, -0.007F};
Points rough(std::size_t count) {
  Points points;
  Prng prng(12);
  for (std::size_t i = 0; i < count; ++i) {
    const auto x = static_cast<float>(100.0 * prng.uniform() - 50.0);
    const auto s = static_cast<float>(150.0 * prng.uniform() - 75.0);
    const double off = prng.uniform() < 0.2 ? 4.0 * prng.uniform() - 2.0 : 0.03 * prng.normal();
    const auto h = static_cast<float>(0.31 + 0.004 * static_cast<double>(x) - 0.007 * static_cast<double>(s) + off);
    switch (prng.below(40)) {
      case 0: points.add(x, s, prng.below(2) == 0 ? kHuge : -kHuge); break;
      case 1: points.add(kHuge, s, h); break;
      case 2: points.add(-0.0F, -0.0F, kSlope.a0); break;
      case 3: points.add(kTiny, -kTiny, kSlope.a0 - kTiny); break;
      case 4: points.add(x, s, kNaN); break;
      case 5: points.add(kNaN, s, h); break;
      case 6: points.add(x, kNaN, h); break;
      default: points.add(x, s, h);
    }
  }
  return points;
}

/// A product and up to sixteen sums are rounded to float before they become double; values too small for floats are
/// lost.
double rounding_of(double size) {
  return 18.0 * 0x1p-24 * size + 1e-38;
}

bool same_bits(const TiltedSums& a, const TiltedSums& b) {
  return std::memcmp(&a, &b, sizeof a) == 0;
}

TEST(TiltedSums, equal_those_of_a_plain_loop_for_exact_numbers) {
  const Points points = in_quarters(kCounts.back());
  for (const std::size_t count : kCounts) {
    for (const std::size_t length_max : {std::size_t{1}, std::size_t{40}, std::size_t{700}, count + 1}) {
      SCOPED_TRACE(std::to_string(count) + " in runs up to " + std::to_string(length_max));
      const std::vector<SeatPoints> runs = points.runs(count, length_max);
      const TiltedSums plain = plain::tilted_sums(runs, kQuarters, kWithin_mm).sums;
      on_each_set([&] {
        const TiltedSums fast = tilted_sums(runs, kQuarters, kWithin_mm);
        EXPECT_EQ(fast.count, plain.count);
        EXPECT_EQ(fast.sums, plain.sums);
      });
    }
  }
}

TEST(TiltedSums, are_those_of_a_plain_loop_to_the_rounding_of_floats) {
  const Points points = rough(kCounts.back());
  for (const std::size_t count : kCounts) {
    for (const std::size_t length_max : {std::size_t{40}, count + 1}) {
      for (const float within_mm : {0.0F, 0.09F, 1.0F}) {
        SCOPED_TRACE(std::to_string(count) + " in runs up to " + std::to_string(length_max));
        const std::vector<SeatPoints> runs = points.runs(count, length_max);
        const plain::ZoneSums plain = plain::tilted_sums(runs, kSlope, within_mm);
        const TiltedSums first = tilted_sums(runs, kSlope, within_mm);
        on_each_set([&] {
          const TiltedSums fast = tilted_sums(runs, kSlope, within_mm);
          EXPECT_TRUE(same_bits(fast, first));
          EXPECT_EQ(fast.count, plain.sums.count);
          for (std::size_t k = 0; k < fast.sums.size(); ++k)
            EXPECT_NEAR(fast.sums[k], plain.sums.sums[k], rounding_of(plain.sizes[k])) << k;
        });
      }
    }
  }
}

TEST(TiltedSums, do_not_drift_over_many_equal_points) {
  constexpr std::size_t kCount = 300'007;
  Points points;
  for (std::size_t i = 0; i < kCount; ++i) points.add(0.1F, -0.3F, 0.7F);
  const SeatPoints run = points.part(0, kCount);
  const plain::ZoneSums plain = plain::tilted_sums({&run, 1}, {}, 1.0F);
  on_each_set([&] {
    const TiltedSums fast = tilted_sums({&run, 1}, {}, 1.0F);
    EXPECT_EQ(fast.count, static_cast<double>(kCount));
    for (std::size_t k = 0; k < fast.sums.size(); ++k)
      EXPECT_NEAR(fast.sums[k], plain.sums.sums[k], rounding_of(plain.sizes[k])) << k;
  });
}

TEST(TiltedSums, count_each_point_once_at_any_position) {
  for (const std::size_t count : {1U, 15U, 16U, 17U, 33U, 47U, 273U}) {
    for (std::size_t at = 0; at < count; ++at) {
      SCOPED_TRACE(std::to_string(at) + " of " + std::to_string(count));
      Points points;
      for (std::size_t i = 0; i < count; ++i) points.add(7.0F, 8.0F, i == at ? 0.5F : 9.0F);
      points.add(7.0F, 8.0F, 0.5F);  // after the end
      const SeatPoints run = points.part(0, count);
      on_each_set([&] {
        const TiltedSums sums = tilted_sums({&run, 1}, {}, 1.0F);
        EXPECT_EQ(sums.count, 1.0);
        EXPECT_EQ(sums.sums, (std::array<double, 9>{7.0, 8.0, 0.5, 49.0, 56.0, 3.5, 64.0, 4.0, 0.25}));
      });
    }
  }
}

TEST(TiltedSums, have_the_same_bits_for_the_same_selection_however_it_was_made) {
  Points points;
  Prng prng(13);
  for (int i = 0; i < 1000; ++i)
    points.add(static_cast<float>(100.0 * prng.uniform()), static_cast<float>(100.0 * prng.uniform()),
               static_cast<float>(i % 3 == 0 ? 50.0 : 0.03 * prng.normal()));
  const std::vector<SeatPoints> runs = points.runs(1000, 300);
  const TiltedSums first = tilted_sums(runs, {}, 1.0F);
  EXPECT_EQ(first.count, 666.0);
  on_each_set([&] { EXPECT_TRUE(same_bits(tilted_sums(runs, {0.01F, 0.001F, -0.002F}, 1.5F), first)); });
}

// ---- points sorted by what planes close by make of them ------------------------------------------------------------

const FlatPlane kLevel = {Vec3::UnitZ(), 0.0};

/// A face about `plane` in runs. The threshold is at twice the noise, so that every plane selects other points.
struct Face {
  Points points;
  std::vector<SeatPoints> runs;
  ListedPoints listed;

  Face(std::size_t count, const FlatPlane& plane) {
    listed.frame = {Vec3(3.0, -40.0, 1.0), Vec3::UnitX(), Vec3(0.0, 0.8, -0.6), Vec3(0.0, 0.6, 0.8)};
    const LocalPlane local(listed.frame, plane);
    Prng prng(count);
    for (std::size_t i = 0; i < count; ++i) {
      const double u = 100.0 * prng.uniform() - 50.0;
      const double v = 60.0 * prng.uniform() - 25.0;
      const double off = prng.uniform() < 0.2 ? 20.0 * prng.uniform() - 10.0 : 0.045 * prng.normal();
      points.add(static_cast<float>(u), static_cast<float>(v),
                 static_cast<float>(local.a0 + local.a1 * u + local.a2 * v + off * local.stretch));
    }
    for (std::size_t i = 16; i < count; i += 29) points.h[i] = i % 2 == 0 ? kHuge : -kHuge;
    runs = points.runs(count, 100);
    listed.runs = runs;
    listed.count = count;
  }
};

TEST(ZonedPoints, hold_the_same_points_as_a_plain_loop_on_every_instruction_set) {
  const FlatPlane plane = {Vec3(0.004, 0.3, 0.9).normalized(), 2.0};
  for (const std::size_t count : kCounts) {
    const Face face(count, plane);
    for (const double move_mm : {0.0, 0.003, -0.004}) {
      SCOPED_TRACE(std::to_string(count) + " points, " + std::to_string(move_mm) + " mm");
      const FlatPlane moved = {(plane.n + Vec3(0.2 * move_mm / 50.0, 0.1 * move_mm / 35.0, 0.0)).normalized(),
                               plane.d + move_mm};
      const PointMoments plain = plain::zoned_within(face.listed, plane, moved, 0.09);
      auto zoned = std::make_unique<ZonedPoints>();
      const auto look = [&] {
        EXPECT_TRUE(zoned->sort(face.listed, plane, 0.09));
        EXPECT_EQ(zoned->size(), count);
        PointMoments moments(face.listed.frame.origin);
        zoned->add_within(moved, 0.09, moments);
        EXPECT_FALSE(count > 0 && zoned->asked_beyond());
        return moments;
      };
      const PointMoments first = look();
      on_each_set([&] {
        const PointMoments fast = look();
        ASSERT_EQ(fast.count(), plain.count());
        if (plain.count() == 0) return;
        EXPECT_EQ(fast.mean(), first.mean());
        EXPECT_EQ(fast.scatter(), first.scatter());
        EXPECT_LT((fast.mean() - plain.mean()).norm(), 1e-5);
        EXPECT_LT((fast.scatter() - plain.scatter()).norm(), 2e-6 * static_cast<double>(count) * 50.0 * 50.0);
      });
    }
  }
}

/// Within the zone a plane may be off by a twelfth of the threshold, over all points. A single far point makes a tilt
/// too large that is acceptable over the others, at any index and in any direction.
TEST(ZonedPoints, notice_a_plane_too_far_off_at_any_one_of_them) {
  const double threshold = 1.2;
  const double slack = 0.1;
  auto zoned = std::make_unique<ZonedPoints>();
  const auto beyond = [&](const SeatPoints& run, const FlatPlane& asked) {
    ListedPoints listed;
    listed.runs = {&run, 1};
    listed.count = run.size();
    EXPECT_TRUE(zoned->sort(listed, kLevel, threshold));
    EXPECT_FALSE(zoned->asked_beyond());
    PointMoments unused(Vec3::Zero());
    zoned->add_within(asked, threshold, unused);
    return zoned->asked_beyond();
  };
  const std::vector<Vec3> directions = {100.0 * Vec3::UnitX(), -100.0 * Vec3::UnitX(), 100.0 * Vec3::UnitY(),
                                        -100.0 * Vec3::UnitY()};
  for (const std::size_t count : {1U, 15U, 16U, 17U, 31U, 33U}) {
    for (std::size_t at = 0; at < count; ++at) {
      for (const Vec3& far : directions) {
        SCOPED_TRACE(std::to_string(at) + " of " + std::to_string(count));
        Points points;
        for (std::size_t i = 0; i < count; ++i) points.add(i % 2 == 0 ? 1.0F : -1.0F, 0.5F, 0.0F);
        points.x[at] = static_cast<float>(far.x());
        points.s[at] = static_cast<float>(far.y());
        points.h[at] = 50.0F;  // a stray, but another plane goes through it
        // Along one direction it is level except for the far point.
        const auto tilted = [&](double rise) {
          return FlatPlane{(Vec3::UnitZ() - rise / 1e4 * far).normalized(), 0.0};
        };
        on_each_set([&] {
          EXPECT_FALSE(beyond(points.part(0, count), tilted(0.98 * slack)));
          EXPECT_TRUE(beyond(points.part(0, count), tilted(1.02 * slack)));
        });
      }
    }
  }
  const Points some = in_quarters(40);
  EXPECT_TRUE(beyond(some.part(0, 40), {Vec3(0.0, 0.0, std::nan("")), 0.0})) << "not a plane";
}

TEST(ZonedPoints, keep_as_many_points_as_there_is_room_for) {
  // All points are at the threshold: half a unit of rounding decides.
  constexpr double kThreshold = 1.0;
  const auto face = [](std::size_t count) {
    Points points;
    Prng prng(count);
    for (std::size_t i = 0; i < count; ++i)
      points.add(static_cast<float>(prng.below(50)), static_cast<float>(prng.below(50)),
                 i % 2 == 0 ? 1.0F : std::nextafter(-1.0F, i % 3 == 0 ? 0.0F : -2.0F));
    return points;
  };
  auto zoned = std::make_unique<ZonedPoints>();
  const std::size_t surely = ZonedPoints::kEdgeMax - 16;
  for (const std::size_t count : {surely - 1, surely, ZonedPoints::kEdgeMax, ZonedPoints::kEdgeMax + 1}) {
    for (const std::size_t length_max : {std::size_t{50}, count + 1}) {
      SCOPED_TRACE(std::to_string(count) + " in runs up to " + std::to_string(length_max));
      const Points points = face(count);
      const std::vector<SeatPoints> runs = points.runs(count, length_max);
      ListedPoints listed;
      listed.runs = runs;
      listed.count = count;
      const PointMoments plain = plain::zoned_within(listed, kLevel, kLevel, kThreshold);
      on_each_set([&] {
        const bool fits = zoned->sort(listed, kLevel, kThreshold);
        if (count <= surely) {
          EXPECT_TRUE(fits);
        }
        if (count > ZonedPoints::kEdgeMax) {
          EXPECT_FALSE(fits);
        }
        if (!fits) return;
        PointMoments moments(Vec3::Zero());
        zoned->add_within(kLevel, kThreshold, moments);
        EXPECT_EQ(moments.count(), plain.count());
        EXPECT_EQ(moments.mean().x(), plain.mean().x());
        EXPECT_EQ(moments.mean().y(), plain.mean().y());
      });
    }
  }
}

}  // namespace
}  // namespace slabd::algo
