// SPDX-License-Identifier: Apache-2.0
//
// A small kernel that uses every operation of algo/lanes-inl.h, compiled for each instruction set. All must agree with
// a plain loop to the bit. It is also an example of how to write and call a kernel.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "lanes_test.cpp"
// clang-format off
#include <hwy/foreach_target.h>
#include "algo/lanes-inl.h"
// clang-format on

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {

/// Writes out[0..15] per operation.
void operations(const float* xyz, const std::int32_t* table, float* out, double* sums) {
  const Points16 p = load_points(xyz);
  const F16 k = lane_numbers();
  store(p.x, out);
  store(p.y, out + 16);
  store(p.z, out + 32);
  store(p.x * p.y + p.z, out + 48);
  store(select(p.x < p.y, p.x, p.y) - p.z / (k + f16(1.0F)), out + 64);
  store(keep((p.x > f16(0.0F)) & and_not(p.y > f16(1.0F), p.z == p.z), abs(p.y)), out + 80);
  store(sqrt(abs(p.x)) + floor(p.y), out + 96);
  store(to_float(gather(table, to_int(k))), out + 112);
  store(min(p.x, p.y) + max(p.x, p.y), out + 128);
  const Points16 few = load_points(xyz, 5);
  out[144] = static_cast<float>(bits(few.x == few.x));
  out[145] = static_cast<float>(bits((p.x >= p.y) | (p.x <= p.z)));
  store_interleaved(p.x, p.y, p.z, k, out + 146);
  store_interleaved(p.z, p.x, out + 210);
  sums[0] = sum_of_lanes(p.x);
  sums[1] = sum_of_lanes(to_double(p.y) * to_double(p.z) + d16(0.1));
}

}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "algo/algo.h"
#include "base/base.h"

namespace slabd::algo {
HWY_EXPORT(operations);

namespace {

constexpr InstructionSet kSets[] = {InstructionSet::plain, InstructionSet::sse4, InstructionSet::avx2,
                                    InstructionSet::avx512, InstructionSet::best};

struct Restore {
  ~Restore() { (void)limit_instruction_set(InstructionSet::best); }
};

double in_lane_order(std::array<double, 16> v) {
  for (std::size_t half = 8; half > 0; half /= 2)
    for (std::size_t i = 0; i < half; ++i) v[i] += v[i + half];
  return v[0];
}

TEST(Lanes, give_the_bits_of_a_plain_loop_on_every_instruction_set) {
  const Restore restore;
  Prng prng(5);
  std::array<float, 48> xyz{};
  for (float& v : xyz) v = static_cast<float>(prng.below(2000)) * 0.37F - 300.0F;
  std::array<std::int32_t, 16> table{};
  for (std::size_t i = 0; i < 16; ++i) table[i] = static_cast<std::int32_t>(7 * i - 20);

  std::vector<float> expected(242);
  std::array<double, 2> sums{};
  std::array<double, 16> xs{};
  std::array<double, 16> products{};
  std::uint32_t mask = 0;
  for (std::size_t i = 0; i < 16; ++i) {
    const float x = xyz[3 * i], y = xyz[3 * i + 1], z = xyz[3 * i + 2];
    expected[i] = x;
    expected[16 + i] = y;
    expected[32 + i] = z;
    expected[48 + i] = x * y + z;
    expected[64 + i] = (x < y ? x : y) - z / (static_cast<float>(i) + 1.0F);
    expected[80 + i] = x > 0.0F && !(y > 1.0F) ? std::abs(y) : 0.0F;
    expected[96 + i] = std::sqrt(std::abs(x)) + std::floor(y);
    expected[112 + i] = static_cast<float>(table[i]);
    expected[128 + i] = std::fmin(x, y) + std::fmax(x, y);
    const std::array<float, 4> four = {x, y, z, static_cast<float>(i)};
    std::copy(four.begin(), four.end(), expected.begin() + static_cast<std::ptrdiff_t>(146 + 4 * i));
    expected[210 + 2 * i] = z;
    expected[211 + 2 * i] = x;
    if (x >= y || x <= z) mask |= 1U << i;
    xs[i] = static_cast<double>(x);
    products[i] = static_cast<double>(y) * static_cast<double>(z) + 0.1;
  }
  expected[144] = 31.0F;
  expected[145] = static_cast<float>(mask);
  sums = {in_lane_order(xs), in_lane_order(products)};

  int seen = 0;
  for (const InstructionSet set : kSets) {
    if (!limit_instruction_set(set)) continue;
    ++seen;
    std::vector<float> out(242);
    std::array<double, 2> got{};
    HWY_DYNAMIC_DISPATCH(operations)(xyz.data(), table.data(), out.data(), got.data());
    EXPECT_EQ(out, expected) << instruction_set();
    EXPECT_EQ(got, sums) << instruction_set();
  }
  EXPECT_GE(seen, 2);
}

TEST(Lanes, the_set_in_use_is_the_one_asked_for) {
  const Restore restore;
  ASSERT_TRUE(limit_instruction_set(InstructionSet::best));
  const std::string best(instruction_set());
  if (limit_instruction_set(InstructionSet::sse4)) {
    EXPECT_EQ(instruction_set(), "SSE4");
  }
  if (limit_instruction_set(InstructionSet::avx2)) {
    EXPECT_EQ(instruction_set(), "AVX2");
  }
  ASSERT_TRUE(limit_instruction_set(InstructionSet::best));
  EXPECT_EQ(instruction_set(), best);
}

}  // namespace
}  // namespace slabd::algo

#endif
