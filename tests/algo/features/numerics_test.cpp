// SPDX-License-Identifier: Apache-2.0
//
// Numerical accuracy with four metres from the origin, five million points, float storage and a fixed-memory search.
#include <gtest/gtest.h>

#include <array>
#include <vector>

#include "algo/algo.h"
#include "algo/features/flatness.h"
#include "algo/features/plane_fit.h"
#include "surfaces.h"

namespace slabd::algo {
namespace {

using slabd::testing::peak_to_valley;
using slabd::testing::surface;

const Vec3 kFar(3700.0, 2500.0, 1200.0);

double angle_deg(const PlaneFit& a, const PlaneFit& b) {
  return deg_from_rad(angle_between_rad(a.normal, b.normal));
}

TEST(FarFromTheOrigin, doubles_change_no_result_by_more_than_a_nanometre) {
  const std::vector<Vec3> near = surface(9, 67, 102, 0.05, 0.0);
  const std::vector<Vec3> far = surface(9, 67, 102, 0.05, 0.0, kFar);
  const auto compare = [&](const PlaneFit& a, const PlaneFit& b) {
    ASSERT_TRUE(a.ok && b.ok);
    EXPECT_EQ(a.inliers, b.inliers);
    EXPECT_NEAR(a.std_mm, b.std_mm, 1e-9);
    EXPECT_NEAR(b.normal.dot(kFar) + a.offset_mm, b.offset_mm, 1e-9);
    EXPECT_LT(angle_deg(a, b), 1e-9);
    EXPECT_NEAR(a.sigma_offset_mm, b.sigma_offset_mm, 1e-9);
    EXPECT_NEAR(peak_to_valley(near, a), peak_to_valley(far, b), 1e-9);
  };
  compare(fit_plane_lsq(near, Vec3::UnitZ()), fit_plane_lsq(far, Vec3::UnitZ()));
  compare(fit_plane(near, Vec3::UnitZ(), {}), fit_plane(far, Vec3::UnitZ(), {}));
  EXPECT_NEAR(minimum_zone_mm(near), minimum_zone_mm(far), 1e-9);
}

TEST(FarFromTheOrigin, floats_cost_no_more_than_their_quantisation) {
  const std::vector<Vec3> exact = surface(9, 67, 102, 0.05, 0.0, kFar);
  std::vector<float> xyz;
  std::vector<std::uint32_t> index;
  std::vector<Vec3> stored;
  for (const Vec3& p : exact) {
    index.push_back(static_cast<std::uint32_t>(index.size()));
    for (int k = 0; k < 3; ++k) xyz.push_back(static_cast<float>(p[k]));
    stored.push_back(Vec3(static_cast<double>(xyz[xyz.size() - 3]), static_cast<double>(xyz[xyz.size() - 2]),
                          static_cast<double>(xyz[xyz.size() - 1])));
  }
  const CloudPoints cloud{xyz.data(), index, FastTransform(Pose::identity())};
  const PlaneFit a = fit_plane_lsq(exact, Vec3::UnitZ());
  const PlaneFit b = fit_plane_lsq_over(cloud, Vec3::UnitZ());
  ASSERT_TRUE(a.ok && b.ok);
  EXPECT_NEAR(a.std_mm, b.std_mm, 1e-6);
  EXPECT_LT(angle_deg(a, b), 1e-5);
  EXPECT_NEAR(peak_to_valley(exact, a), peak_to_valley(stored, b), 2.5e-4);
  EXPECT_NEAR(minimum_zone_mm(exact), minimum_zone_mm(stored), 2.5e-4);
}

TEST(ManyPoints, five_million_agree_with_two_passes_in_long_double) {
  constexpr std::size_t kCount = 5'000'000;
  std::vector<float> xyz(3 * kCount);
  std::vector<std::uint32_t> index(kCount);
  Prng prng(11);
  for (std::size_t i = 0; i < kCount; ++i) {
    const double y = 350.0 * prng.uniform();
    const double noise = 0.058 * (prng.uniform() + prng.uniform() + prng.uniform() - 1.5);
    xyz[3 * i] = static_cast<float>(3700.0 + 500.0 * prng.uniform());
    xyz[3 * i + 1] = static_cast<float>(2500.0 + y);
    xyz[3 * i + 2] = static_cast<float>(1200.0 + 0.025 * y + noise);
    index[i] = static_cast<std::uint32_t>(i);
  }
  const CloudPoints cloud{xyz.data(), index, FastTransform(Pose::identity())};
  const PlaneFit f = fit_plane_lsq_over(cloud, Vec3::UnitZ());
  ASSERT_TRUE(f.ok);
  std::array<long double, 3> mean{};
  for (std::size_t i = 0; i < kCount; ++i)
    for (std::size_t k = 0; k < 3; ++k) mean[k] += static_cast<long double>(xyz[3 * i + k]) / kCount;
  // Residuals about the fitted plane, by definition; at the optimum they are uncorrelated with the position in the
  // plane.
  const Vec3 ex = (Vec3::UnitX() - f.normal.x() * f.normal).normalized();
  const Vec3 ey = f.normal.cross(ex);
  long double squares = 0.0L;
  long double moment_x = 0.0L;
  long double moment_y = 0.0L;
  for (std::size_t i = 0; i < kCount; ++i) {
    long double r = 0.0L;
    long double x = 0.0L;
    long double y = 0.0L;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto axis = static_cast<Eigen::Index>(k);
      const long double from_mean = xyz[3 * i + k] - mean[k];
      r += static_cast<long double>(f.normal[axis]) * from_mean;
      x += static_cast<long double>(ex[axis]) * from_mean;
      y += static_cast<long double>(ey[axis]) * from_mean;
    }
    squares += r * r;
    moment_x += r * x;
    moment_y += r * y;
  }
  EXPECT_NEAR(f.std_mm / static_cast<double>(std::sqrt(squares / (kCount - 3))), 1.0, 1e-8);
  // A tilt of 1e-12 rad would give n * var(x) * 1e-12.
  EXPECT_LT(std::abs(static_cast<double>(moment_x)), 5e6 * 20833.0 * 1e-12);
  EXPECT_LT(std::abs(static_cast<double>(moment_y)), 5e6 * 10208.0 * 1e-12);
  for (int k = 0; k < 3; ++k) EXPECT_NEAR(f.centroid[k], static_cast<double>(mean[static_cast<std::size_t>(k)]), 1e-9);
}

/// Tries every normal at which two parallel planes can touch a set: three points on one side, or two on both.
double zone_by_brute_force(const std::vector<Vec3>& points) {
  double best = std::numeric_limits<double>::infinity();
  const std::size_t n = points.size();
  for (std::size_t a = 0; a < n; ++a)
    for (std::size_t b = a + 1; b < n; ++b)
      for (std::size_t c = 0; c < n; ++c)
        for (std::size_t d = c + 1; d < n; ++d) {
          const Vec3 normal = Vec3(points[b] - points[a]).cross(Vec3(points[d] - points[c]));
          if (normal.norm() < 1e-9) continue;
          double low = std::numeric_limits<double>::infinity();
          double high = -low;
          for (const Vec3& p : points) {
            low = std::min(low, normal.dot(p) / normal.norm());
            high = std::max(high, normal.dot(p) / normal.norm());
          }
          best = std::min(best, high - low);
        }
  return best;
}

TEST(MinimumZoneByBruteForce, agrees_on_flat_and_on_round_sets) {
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    Prng prng(seed);
    const double thickness = seed % 2 == 0 ? 0.05 : 40.0;
    std::vector<Vec3> points;
    for (int i = 0; i < 12; ++i)
      points.push_back(Vec3(100.0 * prng.uniform(), 150.0 * prng.uniform(), thickness * prng.uniform()));
    EXPECT_NEAR(minimum_zone_mm(points), zone_by_brute_force(points), 1e-10) << "seed " << seed;
  }
}

}  // namespace
}  // namespace slabd::algo
