// SPDX-License-Identifier: Apache-2.0
#include "algo/moments.h"

#include <gtest/gtest.h>

#include <vector>

namespace slabd::algo {
namespace {

TEST(Moments, keep_the_variance_of_four_huge_numbers) {
  ScalarMoments m(1e9);
  for (const double v : {4.0, 7.0, 13.0, 16.0}) m.add(1e9 + v);
  m.close_block();
  EXPECT_DOUBLE_EQ(m.variance(1), 30.0);
}

TEST(Moments, keep_the_standard_deviation_of_nearly_equal_numbers) {
  ScalarMoments m(10000000.2);
  m.add(10000000.2);
  for (int i = 0; i < 500; ++i) {
    m.add(10000000.1);
    m.add(10000000.3);
  }
  m.close_block();
  EXPECT_NEAR(m.mean(), 10000000.2, 1e-8);
  EXPECT_NEAR(std::sqrt(m.variance(1)), 0.1, 1e-8);
}

TEST(Moments, agree_with_two_passes_in_long_double_far_from_the_origin) {
  Prng prng(3);
  std::vector<Vec3> points;
  for (int i = 0; i < 20000; ++i)
    points.push_back(
        Vec3(3700.0 + 500.0 * prng.uniform(), 2500.0 + 350.0 * prng.uniform(), 1200.0 + 0.03 * prng.normal()));
  PointMoments moments(points[0]);
  for (const Vec3& p : points) moments.add(p);
  moments.close_block();
  long double mean[3] = {};
  for (const Vec3& p : points)
    for (int k = 0; k < 3; ++k) mean[k] += static_cast<long double>(p[k]) / 20000.0L;
  long double scatter[3][3] = {};
  for (const Vec3& p : points)
    for (int a = 0; a < 3; ++a)
      for (int b = 0; b < 3; ++b)
        scatter[a][b] += (static_cast<long double>(p[a]) - mean[a]) * (static_cast<long double>(p[b]) - mean[b]);
  const Mat3 got = moments.scatter();
  for (int a = 0; a < 3; ++a) {
    EXPECT_NEAR(moments.mean()[a], static_cast<double>(mean[a]), 1e-9);
    for (int b = 0; b < 3; ++b) {
      const double scale = std::sqrt(static_cast<double>(scatter[a][a] * scatter[b][b]));
      EXPECT_NEAR(got(a, b), static_cast<double>(scatter[a][b]), 1e-10 * scale) << a << b;
    }
  }
}

TEST(Moments, have_no_variance_for_too_few_numbers) {
  ScalarMoments m(0.0);
  m.add(1.0);
  m.close_block();
  EXPECT_TRUE(std::isnan(m.variance(1)));
}

}  // namespace
}  // namespace slabd::algo
