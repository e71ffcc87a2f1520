// SPDX-License-Identifier: Apache-2.0
#include "algo/features/casing_fits.h"

#include <gtest/gtest.h>

#include <vector>

namespace slabd::algo {
namespace {

std::vector<Vec2> ring(int count, const Vec2& centre, double radius, double wave) {
  std::vector<Vec2> points;
  for (int i = 0; i < count; ++i) {
    const double t = 2.0 * kPi * i / count;
    const double r = radius + wave * std::cos(3.0 * t);
    points.push_back(centre + Vec2(r * std::cos(t), r * std::sin(t)));
  }
  return points;
}

TEST(Circle, is_exact_for_a_three_lobed_ring) {
  const Circle c = fit_circle(ring(24, Vec2(100.0, 200.0), 19.0, 0.05), Vec2(101.0, 199.0));
  ASSERT_TRUE(c.ok);
  EXPECT_NEAR(c.centre.x(), 100.0, 1e-9);
  EXPECT_NEAR(c.centre.y(), 200.0, 1e-9);
  EXPECT_NEAR(c.radius, 19.0, 1e-9);
  EXPECT_NEAR(c.rms, 0.035355339059, 1e-10);
}

TEST(Circle, through_three_points_is_their_circumcircle) {
  const std::vector<Vec2> points = {{1.0, 0.0}, {0.0, 1.0}, {-1.0, 0.0}};
  const Circle c = fit_circle(points, Vec2(0.2, 0.3));
  ASSERT_TRUE(c.ok);
  EXPECT_NEAR(c.centre.norm(), 0.0, 1e-12);
  EXPECT_NEAR(c.radius, 1.0, 1e-12);
}

TEST(Circle, refuses_two_points_and_a_line) {
  const std::vector<Vec2> two = {{1.0, 0.0}, {0.0, 1.0}};
  EXPECT_FALSE(fit_circle(two, Vec2(0.0, 0.0)).ok);
  const std::vector<Vec2> line = {{0.0, 5.0}, {1.0, 5.0}, {2.0, 5.0}, {3.0, 5.0}};
  EXPECT_FALSE(fit_circle(line, Vec2(0.0, 1e7)).ok);
}

TEST(Circle, robust_fit_ignores_a_missing_patch) {
  std::vector<Vec2> points = ring(48, Vec2(3.0, -2.0), 15.0, 0.0);
  for (std::size_t i = 5; i < 14; ++i) points[i] += 1.5 * (points[i] - Vec2(3.0, -2.0)).normalized();
  const Circle c = fit_circle_robust(points, Vec2(0.0, 0.0), {.scale_min = 0.02});
  ASSERT_TRUE(c.ok);
  EXPECT_NEAR((c.centre - Vec2(3.0, -2.0)).norm(), 0.0, 1e-3);
  EXPECT_NEAR(c.radius, 15.0, 1e-3);
  EXPECT_GT((fit_circle(points, Vec2(0.0, 0.0)).centre - Vec2(3.0, -2.0)).norm(), 0.1) << "the plain one does not";
}

}  // namespace
}  // namespace slabd::algo
