// SPDX-License-Identifier: Apache-2.0
#include "algo/denoise.h"

#include <gtest/gtest.h>

#include <array>
#include <cstring>
#include <limits>
#include <vector>

#include "scene.h"

namespace slabd::algo {
namespace {

struct Denoiser {
  std::vector<std::uint32_t> order;
  std::vector<std::uint8_t> keep;
  std::vector<std::uint32_t> cells = std::vector<std::uint32_t>(limits::kDenoiseCellsMax + 1);
  ScanCounts counts;

  std::size_t run(std::vector<float>& xyz) {
    order.resize(xyz.size() / 3);
    keep.resize(xyz.size() / 3);
    Cloud cloud{xyz, xyz.size() / 3, 0, 0};
    remove_isolated(cloud, {order, keep, cells}, counts);
    return cloud.points;
  }
};

/// Every point against every other.
std::vector<float> brute_force(const std::vector<float>& xyz) {
  std::vector<float> kept;
  const std::size_t n = xyz.size() / 3;
  for (std::size_t i = 0; i < n; ++i) {
    int neighbours = 0;
    for (std::size_t j = 0; j < n && neighbours < kNeighboursMin; ++j) {
      float d2 = 0.0F;
      for (std::size_t k = 0; k < 3; ++k) d2 += (xyz[3 * j + k] - xyz[3 * i + k]) * (xyz[3 * j + k] - xyz[3 * i + k]);
      if (j != i && d2 <= kNeighbourRadius_mm * kNeighbourRadius_mm) ++neighbours;
    }
    if (neighbours >= kNeighboursMin)
      kept.insert(kept.end(), xyz.begin() + static_cast<std::ptrdiff_t>(3 * i),
                  xyz.begin() + static_cast<std::ptrdiff_t>(3 * i + 3));
  }
  return kept;
}

void expect_as_brute_force(std::vector<float> xyz) {
  const std::vector<float> expected = brute_force(xyz);
  Denoiser denoiser;
  const std::size_t kept = denoiser.run(xyz);
  ASSERT_EQ(kept, expected.size() / 3);
  EXPECT_EQ(std::memcmp(xyz.data(), expected.data(), expected.size() * sizeof(float)), 0) << "same points, same order";
  EXPECT_EQ(denoiser.counts.points_kept, kept);
  EXPECT_EQ(denoiser.counts.points_kept + denoiser.counts.isolated_removed, denoiser.counts.points_finite);
}

TEST(Denoise, AgreesWithBruteForceOnARandomBox) {
  Prng prng(1);
  std::vector<float> xyz;
  for (int i = 0; i < 4000; ++i)
    for (int k = 0; k < 3; ++k) xyz.push_back(static_cast<float>(14.0 * prng.uniform()));
  expect_as_brute_force(xyz);
}

TEST(Denoise, AgreesWithBruteForceWithStraysFarOutsideTheField) {
  Prng prng(2);
  std::vector<float> xyz;
  for (int i = 0; i < 3000; ++i) {
    const double far = i % 100 == 0 ? 1e5 : 0.0;
    xyz.push_back(static_cast<float>(30.0 * prng.uniform() + far));
    xyz.push_back(static_cast<float>(30.0 * prng.uniform() - far));
    xyz.push_back(static_cast<float>(prng.uniform()));
  }
  for (int i = 0; i < 5; ++i) xyz.insert(xyz.end(), {-5000.0F + 0.1F * static_cast<float>(i), 0.0F, 0.0F});
  expect_as_brute_force(xyz);
}

TEST(Denoise, AgreesWithBruteForceWhenTheFieldNeedsCoarseCells) {
  Prng prng(3);
  std::vector<float> xyz;
  for (int i = 0; i < 600; ++i) {
    const double x = 50000.0 * prng.uniform();
    const double y = 50000.0 * prng.uniform();
    const int cluster = 1 + static_cast<int>(prng.below(6));
    for (int k = 0; k < cluster; ++k)
      xyz.insert(xyz.end(), {static_cast<float>(x + 0.25 * k), static_cast<float>(y), 0.0F});
  }
  expect_as_brute_force(xyz);
}

TEST(Denoise, AgreesWithBruteForceOnALineAlongOneAxis) {
  std::vector<float> xyz;
  for (int i = 0; i < 3000; ++i)
    xyz.insert(xyz.end(), {7.0F, 0.3F * static_cast<float>(i % 1500), i < 1500 ? 0.0F : 5.0F});
  expect_as_brute_force(xyz);
}

TEST(Denoise, SurvivesAbsurdCoordinatesAndNothingAtAll) {
  const float huge = std::numeric_limits<float>::max();
  const float nan = std::numeric_limits<float>::quiet_NaN();
  std::vector<float> xyz = {
      huge, -huge, huge, -huge, huge, 0.0F, nan, 0.0F, 0.0F, std::numeric_limits<float>::infinity(), 0.0F, 0.0F};
  Denoiser denoiser;
  EXPECT_EQ(denoiser.run(xyz), 0U);
  EXPECT_EQ(denoiser.counts.points_read, 4U);
  EXPECT_EQ(denoiser.counts.points_finite, 2U);
  std::vector<float> empty;
  EXPECT_EQ(denoiser.run(empty), 0U);
}

TEST(Denoise, IsBoundedWhenEverythingShoutsFromOneCell) {
  // 40 000 points above one spot, none within a millimetre of another: every look-up would see all of them.
  std::vector<float> xyz;
  for (int i = 0; i < 40000; ++i) xyz.insert(xyz.end(), {0.0F, 0.0F, 2.0F * static_cast<float>(i)});
  Denoiser denoiser;
  EXPECT_EQ(denoiser.run(xyz), 0U);
}

/// A plane tilted by `tilt_deg`, as long as an end face, scanned from above at `pitch`.
std::vector<float> tilted(double tilt_deg, double pitch, std::uint64_t seed) {
  Prng prng(seed);
  std::vector<float> xyz;
  for (double y = 0.0; y < 240.0; y += pitch) {
    for (double x = 0.0; x < 10.0; x += pitch) {
      const double z = x * std::tan(rad_from_deg(tilt_deg)) + 0.03 * prng.normal();
      if (prng.uniform() > 0.02)
        xyz.insert(xyz.end(), {static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)});
    }
  }
  return xyz;
}

TEST(Denoise, LosesAlmostNoSurfacePointAtAnyPitchAndSlope) {
  for (const double pitch : {0.17, 0.255, 0.42}) {
    for (const double tilt : {0.0, 45.0, 70.0, 80.0}) {
      std::vector<float> xyz = tilted(tilt, pitch, 11);
      const std::size_t before = xyz.size() / 3;
      const std::size_t kept = Denoiser().run(xyz);
      EXPECT_GT(static_cast<double>(kept), 0.99 * static_cast<double>(before)) << pitch << " mm, " << tilt << " deg";
    }
  }
}

TEST(Denoise, RemovesOutliersOfAWholeScanAndKeepsItsSurface) {
  for (const bool organised : {false, true}) {
    scene::Scan scan;
    scan.pitch_mm = 0.3;
    scan.organised = organised;
    const scene::Cloud cloud = scene::take({}, scan);
    std::vector<float> xyz = cloud.xyz;
    const std::size_t kept = Denoiser().run(xyz);
    // Order is kept, so walking both lists together tells who is missing.
    std::array<double, 2> before{};
    std::array<double, 2> after{};
    std::size_t k = 0;
    for (std::size_t i = 0; i < cloud.xyz.size() / 3; ++i) {
      if (std::isnan(cloud.xyz[3 * i])) continue;
      const std::size_t kind = cloud.outlier[i] ? 1 : 0;
      ++before[kind];
      if (k == kept || std::memcmp(&xyz[3 * k], &cloud.xyz[3 * i], 3 * sizeof(float)) != 0) continue;
      ++after[kind];
      ++k;
    }
    ASSERT_EQ(k, kept);
    EXPECT_GT(after[0], 0.9995 * before[0]) << "surface";
    EXPECT_LT(after[1], 0.01 * before[1]) << "outliers";
  }
}

}  // namespace
}  // namespace slabd::algo
