// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <vector>

#include "algo/algo.h"
#include "algo/features/plane_fit.h"
#include "surfaces.h"

namespace slabd::algo {
namespace {

using slabd::testing::peak_to_valley;
using slabd::testing::rms;
using slabd::testing::surface;

/// z = a x + b y + c of a plane.
Vec3 abc(const PlaneFit& f) {
  return {-f.normal.x() / f.normal.z(), -f.normal.y() / f.normal.z(), f.offset_mm / f.normal.z()};
}

/// The paper's comparison (Table 1): 2000 points of z = x + 2y + 1 with noise along the normal, then 500 outliers.
std::vector<Vec3> table_one(double sigma) {
  Prng prng(2024);
  std::vector<Vec3> points;
  for (int i = 0; i < 2000; ++i) {
    const double x = 2.0 * prng.uniform() - 1.0;
    const double y = 2.0 * prng.uniform() - 1.0;
    double sum = 0.0;
    for (int k = 0; k < 12; ++k) sum += prng.uniform();
    const double e = sigma * (sum - 6.0);
    points.push_back(Vec3(x, y, x + 2.0 * y + 1.0) + e * Vec3(1.0, 2.0, -1.0) / std::sqrt(6.0));
  }
  for (int i = 0; i < 500; ++i) {
    const double x = 2.0 * prng.uniform() - 1.0;
    const double y = 2.0 * prng.uniform() - 1.0;
    points.push_back(Vec3(x, y, 6.0 * prng.uniform() - 2.0));
  }
  return points;
}

TEST(Hypotheses, follow_equation_eight) {
  EXPECT_EQ(hypotheses_needed(0.05, 0.99, 3), 3);
  EXPECT_EQ(hypotheses_needed(0.2, 0.99, 3), 7);
  EXPECT_EQ(hypotheses_needed(0.5, 0.99, 3), 35);
  EXPECT_EQ(hypotheses_needed(0.2, 0.999, 3), 10);
  EXPECT_EQ(hypotheses_needed(0.5, 1.0 - 1e-6, 3), 104);
  EXPECT_EQ(hypotheses_needed(0.6, 0.9999, 3), 140);
}

TEST(Hypotheses, are_at_least_one_and_bounded) {
  EXPECT_EQ(hypotheses_needed(0.0, 0.99, 3), 1);
  EXPECT_EQ(hypotheses_needed(0.5, 0.0, 3), 1);
  EXPECT_EQ(hypotheses_needed(1.0, 0.99, 3), static_cast<int>(limits::kPlaneHypothesesMax));
  EXPECT_EQ(hypotheses_needed(0.999, 0.999999, 3), static_cast<int>(limits::kPlaneHypothesesMax));
}

TEST(PlaneLsq, is_exact_for_an_alternating_grid) {
  std::vector<Vec3> points;
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j)
      points.push_back(Vec3(10.0 * i - 15.0, 10.0 * j - 15.0, (i + j) % 2 == 0 ? 0.02 : -0.02));
  const PlaneFit f = fit_plane_lsq(points, Vec3::UnitZ());
  ASSERT_TRUE(f.ok);
  EXPECT_NEAR(f.normal.z(), 1.0, 1e-15);
  EXPECT_NEAR(peak_to_valley(points, f), 0.04, 1e-14);
  EXPECT_NEAR(rms(f), 0.02, 1e-13);
  EXPECT_NEAR(f.std_mm, 0.022188007849, 1e-12);
}

TEST(PlaneLsq, matches_the_normal_and_residuals_of_a_published_case) {
  const std::vector<Vec3> points = {{1000.0014, 1000.0030, 1001.0031},
                                    {1999.9994, 2000.0043, 998.0100},
                                    {999.9965, 1999.9965, 1099.9985},
                                    {1499.9884, 1499.9889, 999.9898}};
  const PlaneFit f = fit_plane_lsq(points, Vec3::UnitZ());
  ASSERT_TRUE(f.ok);
  EXPECT_NEAR(f.normal.x(), 0.100818, 1e-6);
  EXPECT_NEAR(f.normal.y(), -0.097854, 1e-6);
  EXPECT_NEAR(f.normal.z(), 0.990081, 1e-6);
  EXPECT_NEAR(f.std_mm, 0.3908, 1e-4);
  EXPECT_NEAR(std::abs(f.normal.dot(Vec3(2000.0007, 999.9968, 1002.0012)) - f.offset_mm), 101.647, 1e-3);
}

TEST(PlaneLsq, is_the_same_for_a_reproducible_surface_here_and_four_metres_away) {
  for (const Vec3& shift : {Vec3(0.0, 0.0, 0.0), Vec3(3700.0, 2500.0, 1200.0)}) {
    const std::vector<Vec3> points = surface(1, 21, 31, 0.02, 0.05, shift);
    const PlaneFit f = fit_plane_lsq(points, Vec3::UnitZ());
    ASSERT_TRUE(f.ok);
    EXPECT_NEAR(peak_to_valley(points, f), 0.096610940138, 2e-11);
    EXPECT_NEAR(rms(f), 0.019458695702, 2e-11);
    EXPECT_NEAR(f.normal.x(), -7.049195612e-6, 1e-12);
    EXPECT_NEAR(f.normal.y(), -0.02499026627, 1e-11);
    EXPECT_NEAR(f.normal.z(), 0.9996876945, 1e-10);
  }
}

TEST(PlaneLsq, matches_the_reference_for_large_surfaces) {
  const auto check = [](const std::vector<Vec3>& points, double expected) {
    const PlaneFit f = fit_plane_lsq(points, Vec3::UnitZ());
    ASSERT_TRUE(f.ok);
    EXPECT_NEAR(peak_to_valley(points, f), expected, 1e-10);
  };
  check(surface(7, 5, 5, 0.1, 0.0), 0.219104815431);
  check(surface(9, 67, 102, 0.05, 0.0), 0.140231265383);
  check(surface(11, 67, 102, 0.01, 0.05), 0.077695479498);
  check(surface(13, 250, 400, 0.03, 0.02), 0.105336643878);
}

TEST(PlaneLsq, refuses_points_that_do_not_span_a_plane) {
  EXPECT_FALSE(fit_plane_lsq({}, Vec3::UnitZ()).ok);
  const std::vector<Vec3> two = {{0, 0, 0}, {1, 0, 0}};
  EXPECT_FALSE(fit_plane_lsq(two, Vec3::UnitZ()).ok);
  std::vector<Vec3> line;
  for (int i = 0; i < 100; ++i) line.push_back(Vec3(i, 2.0 * i, 3.0 * i));
  EXPECT_FALSE(fit_plane_lsq(line, Vec3::UnitZ()).ok);
  const std::vector<Vec3> same(50, Vec3(1.0, 2.0, 3.0));
  EXPECT_FALSE(fit_plane_lsq(same, Vec3::UnitZ()).ok);
}

TEST(PlaneRansac, finds_the_noise_free_plane_of_table_one_exactly) {
  const PlaneFit f = fit_plane(table_one(0.0), Vec3::UnitZ(), {.threshold_mm = 0.0, .seed = 5});
  ASSERT_TRUE(f.ok);
  EXPECT_NEAR(abc(f).x(), 1.0, 1e-9);
  EXPECT_NEAR(abc(f).y(), 2.0, 1e-9);
  EXPECT_NEAR(abc(f).z(), 1.0, 1e-9);
  EXPECT_GE(f.inliers, 2000U);
}

TEST(PlaneLsq, has_the_reference_digits_for_the_inliers_of_table_one) {
  std::vector<Vec3> points = table_one(0.01);
  points.resize(2000);
  const PlaneFit f = fit_plane_lsq(points, Vec3::UnitZ());
  EXPECT_NEAR(abc(f).x(), 0.9995290355, 1e-10);
  EXPECT_NEAR(abc(f).y(), 1.9998334468, 1e-10);
  EXPECT_NEAR(abc(f).z(), 1.0002200430, 1e-10);
  EXPECT_NEAR(rms(f), 0.009989513, 1e-9);
}

TEST(PlaneRansac, reaches_the_fixed_point_of_table_one_from_every_seed) {
  const std::vector<Vec3> points = table_one(0.01);
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    const PlaneFit f = fit_plane(points, Vec3::UnitZ(), {.threshold_mm = 0.03, .seed = seed});
    ASSERT_TRUE(f.ok) << seed;
    EXPECT_EQ(f.inliers, 2000U);
    EXPECT_NEAR(abc(f).x(), 0.9994872364, 1e-10);
    EXPECT_NEAR(abc(f).y(), 1.9997927646, 1e-10);
    EXPECT_NEAR(abc(f).z(), 1.0001436124, 1e-10);
  }
}

/// A seat-sized plane with outliers up to 60 mm off, half of them on one side.
std::vector<Vec3> with_outliers(std::uint64_t seed, double share) {
  Prng prng(seed);
  std::vector<Vec3> points;
  const Vec3 n = Vec3(0.0, -0.025, 1.0).normalized();
  for (int i = 0; i < 8000; ++i) {
    Vec3 p(100.0 * (prng.uniform() - 0.5), 150.0 * (prng.uniform() - 0.5), 0.0);
    p.z() = 0.025 * p.y();
    p += 0.03 * prng.normal() * n;
    if (prng.uniform() < share) p += (prng.uniform() < 0.75 ? 1.0 : -1.0) * (0.3 + 60.0 * prng.uniform()) * n;
    points.push_back(p);
  }
  return points;
}

void expect_robust(double share) {
  const Vec3 truth = Vec3(0.0, -0.025, 1.0).normalized();
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    const PlaneFit f = fit_plane(with_outliers(seed, share), Vec3::UnitZ(), {.seed = seed});
    ASSERT_TRUE(f.ok) << "seed " << seed;
    // Six times the statistical floor sqrt(12) sigma / (100 mm sqrt(n)).
    const double floor_rad = std::sqrt(12.0) * 0.03 / (100.0 * std::sqrt(8000.0 * (1.0 - share)));
    EXPECT_LT(angle_between_rad(f.normal, truth), 6.0 * floor_rad) << "seed " << seed;
    EXPECT_NEAR(f.offset_mm, 0.0, 0.003) << "seed " << seed;
    EXPECT_NEAR(f.std_mm, 0.03, 0.003) << "seed " << seed;
  }
}

TEST(PlaneRansac, is_not_moved_by_one_outlier_in_five) {
  expect_robust(0.2);
}
TEST(PlaneRansac, is_not_moved_by_every_second_point_being_an_outlier) {
  expect_robust(0.49);
}

TEST(PlaneRansac, is_as_good_as_knowing_the_inliers) {
  // 1000 seeds: root mean square tilt within 1.1 of the least-squares fit of the clean points alone.
  double ours = 0.0;
  double oracle = 0.0;
  const Vec3 truth = Vec3(0.0, -0.025, 1.0).normalized();
  for (std::uint64_t seed = 1; seed <= 1000; ++seed) {
    Prng prng(seed);
    std::vector<Vec3> clean;
    std::vector<Vec3> all;
    for (int i = 0; i < 1000; ++i) {
      Vec3 p(100.0 * (prng.uniform() - 0.5), 150.0 * (prng.uniform() - 0.5), 0.0);
      p.z() = 0.025 * p.y();
      p += 0.03 * prng.normal() * truth;
      const bool outlier = prng.uniform() < 0.2;
      if (outlier) p += (1.0 + 20.0 * prng.uniform()) * truth;
      if (!outlier) clean.push_back(p);
      all.push_back(p);
    }
    const double a = angle_between_rad(fit_plane(all, truth, {.seed = seed}).normal, truth);
    const double b = angle_between_rad(fit_plane_lsq(clean, truth).normal, truth);
    ours += a * a;
    oracle += b * b;
  }
  EXPECT_LT(std::sqrt(ours / oracle), 1.1);
}

TEST(PlaneRansac, gives_the_same_bits_twice) {
  const std::vector<Vec3> points = with_outliers(3, 0.3);
  const PlaneFit a = fit_plane(points, Vec3::UnitZ(), {.seed = 9});
  const PlaneFit b = fit_plane(points, Vec3::UnitZ(), {.seed = 9});
  EXPECT_EQ(std::memcmp(a.normal.data(), b.normal.data(), sizeof(double) * 3), 0);
  EXPECT_EQ(a.offset_mm, b.offset_mm);
  EXPECT_EQ(a.inliers, b.inliers);
}

TEST(PlaneRansac, reports_failure_when_too_few_points_agree) {
  const std::vector<Vec3> points = with_outliers(4, 0.3);
  const PlaneFit f = fit_plane(points, Vec3::UnitZ(), {.inlier_share_min = 0.8, .seed = 1});
  EXPECT_FALSE(f.ok);
  EXPECT_NEAR(f.inlier_fraction, 0.7, 0.03) << "the figures reached are still filled in";
}

TEST(PlaneRansac, reports_failure_when_the_refits_run_out) {
  const PlaneFit f = fit_plane(with_outliers(4, 0.3), Vec3::UnitZ(), {.refits_max = 1});
  EXPECT_FALSE(f.ok);
  EXPECT_EQ(f.iterations, 1);
}

TEST(PlaneRansac, refuses_too_few_points_a_line_and_no_finite_point) {
  EXPECT_FALSE(fit_plane({}, Vec3::UnitZ(), {}).ok);
  const std::vector<Vec3> two = {{0, 0, 0}, {1, 0, 0}};
  EXPECT_FALSE(fit_plane(two, Vec3::UnitZ(), {}).ok);
  std::vector<Vec3> line;
  for (int i = 0; i < 100; ++i) line.push_back(Vec3(i, 2.0 * i, 0.0));
  EXPECT_FALSE(fit_plane(line, Vec3::UnitZ(), {}).ok);
  const std::vector<Vec3> nothing(100, Vec3::Constant(kNoValue));
  EXPECT_FALSE(fit_plane(nothing, Vec3::UnitZ(), {}).ok);
}

TEST(PlaneRansac, leaves_out_points_that_are_not_finite) {
  std::vector<Vec3> points = surface(9, 40, 40, 0.05, 0.0);
  const PlaneFit clean = fit_plane_lsq(points, Vec3::UnitZ());
  for (int i = 0; i < 100; ++i) points.insert(points.begin(), Vec3::Constant(kNoValue));
  const PlaneFit f = fit_plane(points, Vec3::UnitZ(), {.threshold_mm = 1.0});
  ASSERT_TRUE(f.ok);
  EXPECT_EQ(f.inliers, 1600U);
  EXPECT_NEAR(f.std_mm, clean.std_mm, 1e-12);
}

TEST(PlaneRansac, points_the_normal_to_the_free_side) {
  const std::vector<Vec3> points = surface(9, 20, 20, 0.05, 0.0);
  EXPECT_GT(fit_plane(points, Vec3::UnitZ(), {}).normal.z(), 0.99);
  EXPECT_LT(fit_plane(points, -Vec3::UnitZ(), {}).normal.z(), -0.99);
}

TEST(PlaneClassicRansac, passes_through_three_of_the_points_and_is_ten_times_worse_than_its_refit) {
  const std::vector<Vec3> points = table_one(0.01);
  double classic = 0.0;
  double improved = 0.0;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    const PlaneSettings settings{.threshold_mm = 0.03, .seed = seed};
    const PlaneFit f = fit_plane_ransac(points, Vec3::UnitZ(), settings);
    ASSERT_TRUE(f.ok);
    EXPECT_GT(f.normal.z(), 0.0);
    EXPECT_GT(f.inlier_fraction, 0.7);
    const auto on_plane = std::count_if(points.begin(), points.end(),
                                        [&](const Vec3& p) { return std::abs(f.normal.dot(p) - f.offset_mm) < 1e-14; });
    EXPECT_GE(on_plane, 3);
    const auto counted = std::count_if(points.begin(), points.end(),
                                       [&](const Vec3& p) { return std::abs(f.normal.dot(p) - f.offset_mm) <= 0.03; });
    EXPECT_EQ(f.inliers, static_cast<std::uint64_t>(counted));
    classic += (abc(f) - Vec3(1.0, 2.0, 1.0)).squaredNorm();
    improved += (abc(fit_plane(points, Vec3::UnitZ(), settings)) - Vec3(1.0, 2.0, 1.0)).squaredNorm();
  }
  EXPECT_GT(std::sqrt(classic / improved), 3.0);
}

TEST(PlaneClassicRansac, finds_its_own_threshold_and_is_repeatable) {
  const std::vector<Vec3> points = table_one(0.01);
  const PlaneFit a = fit_plane_ransac(points, Vec3::UnitZ(), {.seed = 3});
  const PlaneFit b = fit_plane_ransac(points, Vec3::UnitZ(), {.seed = 3});
  ASSERT_TRUE(a.ok);
  EXPECT_NEAR(abc(a).x(), 1.0, 0.1);
  EXPECT_EQ(a.normal, b.normal);
  EXPECT_EQ(a.inliers, b.inliers);
}

TEST(PlaneClassicRansac, refuses_a_line_no_finite_point_and_a_small_share) {
  std::vector<Vec3> line;
  for (int i = 0; i < 100; ++i) line.push_back(Vec3(i, 2.0 * i, 0.0));
  EXPECT_FALSE(fit_plane_ransac(line, Vec3::UnitZ(), {}).ok);
  const std::vector<Vec3> nothing(100, Vec3::Constant(kNoValue));
  EXPECT_FALSE(fit_plane_ransac(nothing, Vec3::UnitZ(), {}).ok);
  EXPECT_FALSE(fit_plane_ransac(table_one(0.01), Vec3::UnitZ(), {.threshold_mm = 0.03, .inlier_share_min = 0.95}).ok);
}

TEST(Angles, are_exact_from_a_thousandth_of_a_degree_to_nearly_a_straight_angle) {
  for (const double deg : {0.001, 0.021, 1.342, 179.999}) {
    const double a = rad_from_deg(deg);
    EXPECT_NEAR(deg_from_rad(angle_between_rad(Vec3::UnitZ(), Vec3(0.0, -std::sin(a), std::cos(a)))), deg, 1e-12);
  }
}

}  // namespace
}  // namespace slabd::algo
