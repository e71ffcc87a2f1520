// SPDX-License-Identifier: Apache-2.0
#include "base/prng.h"

#include <gtest/gtest.h>

namespace slabd {
namespace {

TEST(Prng, is_splitmix64_to_the_bit) {
  Prng prng(42);
  EXPECT_EQ(prng.next(), 0xbdd732262feb6e95U);
  EXPECT_EQ(prng.next(), 0x28efe333b266f103U);
  EXPECT_EQ(prng.next(), 0x47526757130f9f52U);
  Prng again(42);
  EXPECT_DOUBLE_EQ(again.uniform(), 0.7415648787718233);
  EXPECT_DOUBLE_EQ(again.uniform(), 0.1599103928769201);
}

TEST(Prng, normal_has_mean_0_and_variance_1) {
  Prng prng(7);
  double sum = 0.0;
  double sum2 = 0.0;
  constexpr int kCount = 200'000;
  for (int i = 0; i < kCount; ++i) {
    const double v = prng.normal();
    sum += v;
    sum2 += v * v;
  }
  EXPECT_NEAR(sum / kCount, 0.0, 0.01);
  EXPECT_NEAR(sum2 / kCount, 1.0, 0.02);
}

}  // namespace
}  // namespace slabd
