// SPDX-License-Identifier: Apache-2.0
#include "base/fixed.h"

#include <gtest/gtest.h>

namespace slabd {
namespace {

TEST(FixedString, cuts_what_does_not_fit_and_stays_terminated) {
  FixedString<4> text("abcdef");
  EXPECT_EQ(text.view(), "abcd");
  EXPECT_STREQ(text.c_str(), "abcd");
  text.printf("%d-%s", 7, "long tail");
  EXPECT_EQ(text.view(), "7-lo");
  text.clear();
  EXPECT_TRUE(text.empty());
  EXPECT_STREQ(text.c_str(), "");
}

TEST(FixedVector, reports_when_it_is_full) {
  FixedVector<int, 2> v;
  EXPECT_TRUE(v.push(1));
  EXPECT_TRUE(v.push(2));
  EXPECT_FALSE(v.push(3));
  v.erase(0);
  ASSERT_EQ(v.size(), 1U);
  EXPECT_EQ(v[0], 2);
}

TEST(FixedQueue, is_first_in_first_out_over_the_seam) {
  FixedQueue<int, 3> q;
  int next_in = 0;
  int next_out = 0;
  for (int round = 0; round < 10; ++round) {
    while (q.push(next_in)) ++next_in;
    EXPECT_TRUE(q.full());
    EXPECT_EQ(q[2], next_out + 2);
    for (int i = 0; i < 2; ++i) {
      EXPECT_EQ(q.front(), next_out++);
      q.pop();
    }
  }
}

}  // namespace
}  // namespace slabd
