// SPDX-License-Identifier: Apache-2.0
//
// Statements of the plane fit about itself: its covariance, and the refusal of a wrong plane if the outliers have a
// structure of their own.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "algo/algo.h"

namespace slabd::algo {
namespace {

constexpr double kNoise_mm = 0.03;
constexpr double kHalfX_mm = 51.0;
constexpr double kHalfY_mm = 75.0;

/// A seat-sized set of 6000 points with height `height(x, y, u)`, x, y in [-1, 1] and u uniform, plus noise.
template <typename Height>
std::vector<Vec3> shaped(std::uint64_t seed, const Height& height) {
  Prng prng(seed);
  std::vector<Vec3> points;
  for (int i = 0; i < 6000; ++i) {
    const double x = 2.0 * prng.uniform() - 1.0;
    const double y = 2.0 * prng.uniform() - 1.0;
    const double z = height(x, y, prng.uniform());
    const double noise = kNoise_mm * prng.normal();
    if (has_value(z)) points.push_back(Vec3(kHalfX_mm * x, kHalfY_mm * y, z + noise));
  }
  return points;
}

enum class End { right, refused, either };

/// The truth is z = 0; right means within half the noise everywhere on the face.
template <typename Height>
void expect_end(End expected, const std::string& what, const Height& height) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    SCOPED_TRACE(what + ", seed " + std::to_string(seed));
    const PlaneFit f = fit_plane(shaped(seed, height), Vec3::UnitZ(), {.seed = seed});
    if (expected != End::either) {
      EXPECT_EQ(f.ok, expected == End::right);
    }
    if (!f.ok) continue;
    EXPECT_LT(std::abs(f.offset_mm) + std::abs(f.normal.x()) * kHalfX_mm + std::abs(f.normal.y()) * kHalfY_mm,
              0.5 * kNoise_mm);
  }
}

TEST(PlaneStructure, larger_of_two_parallel_planes_wins_and_equal_ones_are_refused) {
  for (const double distance : {0.3, 1.0, 5.0, 25.0}) {
    for (const double share : {0.5, 0.51, 0.55, 0.6, 0.7, 0.9}) {
      const End end = share < 0.52 ? End::refused : share < 0.6 ? End::either : End::right;
      expect_end(end, "share " + std::to_string(share) + " distance " + std::to_string(distance),
                 [&](double, double, double u) { return u < share ? 0.0 : distance; });
    }
  }
}

TEST(PlaneStructure, no_plane_in_the_middle_is_taken_with_a_second_plane_five_noise_widths_away) {
  for (const double share : {0.5, 0.55, 0.6})
    expect_end(End::either, "share " + std::to_string(share),
               [&](double, double, double u) { return u < share ? 0.0 : 5.0 * kNoise_mm; });
}

TEST(PlaneStructure, larger_side_of_a_step_wins_and_equal_ones_are_refused) {
  for (const double height : {0.3, 1.0, -5.0}) {
    for (const double share : {0.5, 0.51, 0.55, 0.6, 0.7, 0.9}) {
      const End end = share < 0.52 ? End::refused : share < 0.6 ? End::either : End::right;
      expect_end(end, "share " + std::to_string(share) + " height " + std::to_string(height),
                 [&](double x, double, double) { return x < 2.0 * share - 1.0 ? 0.0 : height; });
    }
  }
}

TEST(PlaneStructure, a_bump_on_a_twentieth_of_the_face_does_not_move_the_plane) {
  for (const double height : {0.2, 0.3, 0.5, 1.0, 5.0})
    expect_end(End::right, "height " + std::to_string(height), [&](double x, double y, double) {
      return std::abs(x - 0.5) < 0.2236 && std::abs(y - 0.5) < 0.2236 ? height : 0.0;
    });
}

TEST(PlaneStructure, half_the_plane_is_enough) {
  expect_end(End::right, "half", [](double x, double, double) { return x < 0.0 ? 0.0 : kNoValue; });
  expect_end(End::right, "half, and a fifth of the rest anywhere",
             [](double x, double, double u) { return u < 0.2 ? 30.0 * (u - 0.1) : (x < 0.0 ? 0.0 : kNoValue); });
}

TEST(PlaneStructure, a_roof_has_the_mean_of_its_sides_or_no_plane) {
  const auto roof = [](double rise) { return [rise](double x, double, double) { return rise * (0.5 - std::abs(x)); }; };
  for (const double rise : {0.05, 0.1, 0.2}) expect_end(End::right, "gentle " + std::to_string(rise), roof(rise));
  expect_end(End::either, "in between", roof(0.3));
  for (const double rise : {0.5, 1.0, 2.0}) expect_end(End::refused, "steep " + std::to_string(rise), roof(rise));
}

TEST(PlaneStructure, form_is_not_mistaken_for_a_second_surface) {
  for (const double rise : {0.05, 0.1, 0.3}) {
    expect_end(End::right, "bow", [&](double x, double, double) { return rise * (x * x - 1.0 / 3.0); });
    expect_end(End::right, "wave", [&](double x, double, double) { return 0.5 * rise * std::cos(2.0 * kPi * x); });
  }
}

TEST(PlaneStructure, a_given_threshold_that_takes_in_two_surfaces_is_refused) {
  const std::vector<Vec3> step = shaped(1, [](double x, double, double) { return x < 0.2 ? 0.0 : 0.5; });
  EXPECT_FALSE(fit_plane(step, Vec3::UnitZ(), {.threshold_mm = 0.6}).ok);
  EXPECT_TRUE(fit_plane(step, Vec3::UnitZ(), {.threshold_mm = 0.09}).ok);
}

TEST(PlaneStructure, noise_alone_raises_no_doubt) {
  // In a small set a few points may fit a plane so well by chance that the others look like strays. Then it is refused:
  // about one set in seventy.
  constexpr std::uint64_t kHandful = 60;
  int handfuls_refused = 0;
  for (std::uint64_t seed = 1; seed <= 300; ++seed) {
    Prng prng(seed);
    std::vector<Vec3> points;
    const std::uint64_t count = 20 + prng.below(seed % 2 == 0 ? 600 : kHandful - 20);
    for (std::uint64_t i = 0; i < count; ++i)
      points.push_back(Vec3(100.0 * prng.uniform(), 150.0 * prng.uniform(), kNoise_mm * prng.normal()));
    const bool ok = fit_plane(points, Vec3::UnitZ(), {.seed = seed}).ok;
    if (count < kHandful)
      handfuls_refused += ok ? 0 : 1;
    else
      EXPECT_TRUE(ok) << "seed " << seed << ", " << count << " points";
  }
  EXPECT_LE(handfuls_refused, 7) << "of 150";
}

TEST(PlaneFixedPoint, points_exactly_at_the_threshold_do_not_keep_it_from_standing_still) {
  // Mirrored points at the threshold are inliers or not by their last bit, which does not change the plane.
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    Prng prng(seed);
    const Quat turn = Quat(prng.normal(), prng.normal(), prng.normal(), prng.normal()).normalized();
    std::vector<Vec3> points;
    for (int i = -8; i <= 8; ++i) {
      for (int j = -8; j <= 8; ++j) {
        const double noise = kNoise_mm * prng.normal();
        for (const double z : {noise, -noise}) points.push_back(turn * Vec3(10.0 * i, 7.0 * j, z));
        if ((i + j) % 16 == 0)
          for (const double z : {0.1, -0.1}) points.push_back(turn * Vec3(10.0 * i, 7.0 * j, z));
      }
    }
    const Vec3 truth = turn * Vec3::UnitZ();
    const PlaneFit f = fit_plane(points, truth, {.threshold_mm = 0.1, .seed = seed});
    EXPECT_LT(f.iterations, 20) << "seed " << seed;
    EXPECT_TRUE(f.ok) << "seed " << seed;
    EXPECT_LT(angle_between_rad(f.normal, truth), 1e-3) << "seed " << seed;
  }
}

/// Mean squared error of offset and tilt in units of the stated covariance, over many seeds: 1 if it is true.
struct Normalised {
  double offset = 0.0;
  double tilt = 0.0;
};
template <typename Fit>
Normalised normalised_errors(double outlier_share, const Fit& fit) {
  constexpr int kSeeds = 2000;
  const Quat turn(Eigen::AngleAxisd(0.7, Vec3(1.0, 2.0, 3.0).normalized()));
  const Vec3 x = turn * Vec3::UnitX();
  const Vec3 y = turn * Vec3::UnitY();
  const Vec3 z = turn * Vec3::UnitZ();
  const Vec3 origin(370.0, 250.0, 120.0);
  Normalised sum;
  for (int seed = 1; seed <= kSeeds; ++seed) {
    Prng prng(static_cast<std::uint64_t>(seed));
    std::vector<Vec3> points;
    for (int i = 0; i < 500; ++i) {
      Vec3 p(kHalfX_mm * (2.0 * prng.uniform() - 1.0), kHalfY_mm * (2.0 * prng.uniform() - 1.0), 0.0);
      p.z() = prng.uniform() < outlier_share ? 60.0 * prng.uniform() - 30.0 : kNoise_mm * prng.normal();
      points.push_back(origin + turn * p);
    }
    const PlaneFit f = fit(points, z);
    EXPECT_TRUE(f.ok) << seed;
    // The centroid is on the fitted plane: its height above the true one is the error there.
    const double height = z.dot(f.centroid - origin);
    sum.offset += height * height / (f.sigma_offset_mm * f.sigma_offset_mm);
    Eigen::Matrix2d C;
    C << x.dot(f.cov_normal * x), x.dot(f.cov_normal * y), y.dot(f.cov_normal * x), y.dot(f.cov_normal * y);
    const Eigen::Vector2d e(x.dot(f.normal), y.dot(f.normal));
    sum.tilt += 0.5 * e.dot(C.inverse() * e);
    EXPECT_NEAR(z.dot(f.cov_normal * z) / C.trace(), 0.0, 1e-6) << "a unit vector errs sideways only";
  }
  return {sum.offset / kSeeds, sum.tilt / kSeeds};
}

TEST(PlaneCovariance, is_true_for_least_squares) {
  const Normalised e =
      normalised_errors(0.0, [](const std::vector<Vec3>& points, const Vec3& up) { return fit_plane_lsq(points, up); });
  EXPECT_NEAR(e.offset, 1.0, 0.1);
  EXPECT_NEAR(e.tilt, 1.0, 0.1);
}

TEST(PlaneCovariance, is_true_for_the_robust_fit_with_and_without_outliers) {
  for (const double share : {0.0, 0.2}) {
    const Normalised e = normalised_errors(share, [](const std::vector<Vec3>& points, const Vec3& up) {
      return fit_plane(points, up, {.confidence = 0.999});
    });
    EXPECT_NEAR(e.offset, 1.0, 0.1) << share;
    EXPECT_NEAR(e.tilt, 1.0, 0.1) << share;
  }
}

}  // namespace
}  // namespace slabd::algo
