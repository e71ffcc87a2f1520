// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/scan_points.h"

#include <gtest/gtest.h>

#include <hwy/targets.h>
#include <bit>
#include <cstring>
#include <limits>
#include <vector>

#include "base/prng.h"

// Sixteen points at a time compared with one by one: the same bits and counts, at any alignment, on every instruction
// set of this computer.
namespace slabd::hal {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();

/// `points` points, of which a share is missing: wholly, in part, infinite or zero.
std::vector<float> cloud(std::size_t points, double share, bool nasty, Prng& prng) {
  std::vector<float> xyz;
  for (std::size_t i = 0; i < points; ++i) {
    std::array<float, 3> p;
    for (float& v : p) v = static_cast<float>(300.0 * prng.normal());
    if (prng.uniform() < share) {
      switch (nasty ? prng.below(7) : 0) {
        case 0: p = {kNan, kNan, kNan}; break;
        case 1: p[prng.below(3)] = kNan; break;
        case 2: p[prng.below(3)] = -kInf; break;
        case 3: p = {kInf, kInf, kInf}; break;
        case 4: p = {kNan, p[1], kInf}; break;
        case 5: p = {0.0F, 0.0F, -0.0F}; break;
        default: p = {std::bit_cast<float>(0x7FA0'0001U), kNan, kNan};  // a signalling NaN
      }
    } else if (nasty && prng.below(20) == 0) {
      p[prng.below(3)] = prng.below(2) == 0 ? std::numeric_limits<float>::max() : 1e-45F;
    }
    xyz.insert(xyz.end(), p.begin(), p.end());
  }
  return xyz;
}

/// NaN equals NaN, whatever its payload.
bool same(const std::vector<float>& a, const std::vector<float>& b) {
  for (std::size_t i = 0; i < a.size(); ++i)
    if (a[i] != b[i] && (a[i] == a[i] || b[i] == b[i])) return false;
  return a.size() == b.size();
}

class SettlePoints : public testing::TestWithParam<std::int64_t> {
 protected:
  void SetUp() override { hwy::SetSupportedTargetsForTest(GetParam()); }
  void TearDown() override { hwy::SetSupportedTargetsForTest(0); }
};

TEST_P(SettlePoints, agree_with_one_by_one_in_place_and_on_the_way) {
  Prng prng(3);
  for (const std::size_t points : {0U, 1U, 15U, 16U, 17U, 100U, 1'000U, 10'007U})
    for (const double share : {0.0, 0.02, 0.5, 1.0})
      for (const bool nasty : {false, true}) {
        const std::vector<float> from = cloud(points, share, nasty, prng);
        std::vector<float> wanted = from;
        const Settled settled = settle_points<float>(wanted);

        std::vector<float> in_place = from;
        EXPECT_EQ(settle_points(in_place.data(), points), settled) << points << " " << share;
        EXPECT_TRUE(same(in_place, wanted)) << points << " " << share;

        std::vector<double> twice(from.begin(), from.end());
        EXPECT_EQ(settle_points(twice.data(), points), settled);

        // All kinds of source and target addresses; no byte before or after the target is written.
        for (std::size_t shift = 0; shift < 17; shift += 4) {
          std::vector<char> bytes(from.size() * sizeof(float) + 64, '\0');
          if (!from.empty()) std::memcpy(bytes.data() + shift + 1, from.data(), from.size() * sizeof(float));
          std::vector<float> room(from.size() + 64, -7.0F);
          auto* to = room.data();
          while (reinterpret_cast<std::uintptr_t>(to) % 64 != 0) ++to;
          to += shift % 8;
          EXPECT_EQ(move_and_settle_points(bytes.data() + shift + 1, points, to), settled);
          EXPECT_TRUE(same({to, to + from.size()}, wanted)) << points << " " << share << " " << shift;
          const auto written = static_cast<std::size_t>(std::count(room.begin(), room.end(), -7.0F));
          EXPECT_EQ(written, room.size() - from.size());
        }
      }
}

TEST_P(SettlePoints, every_nan_gets_the_same_bits_and_other_values_are_unchanged) {
  Prng prng(4);
  for (const std::size_t points : {0U, 1U, 5U, 6U, 100U, 1'003U}) {
    const std::vector<float> from = cloud(points, 0.3, true, prng);
    std::vector<float> to(from.size() + 1, -7.0F);
    copy_with_one_nan(from.data(), from.size(), to.data());
    for (std::size_t i = 0; i < from.size(); ++i)
      EXPECT_EQ(std::bit_cast<std::uint32_t>(to[i]),
                from[i] == from[i] ? std::bit_cast<std::uint32_t>(from[i]) : 0x7FC0'0000U);
    EXPECT_EQ(to.back(), -7.0F);
  }
}

INSTANTIATE_TEST_SUITE_P(Each, SettlePoints, testing::ValuesIn(hwy::SupportedAndGeneratedTargets()),
                         [](const testing::TestParamInfo<std::int64_t>& target) {
                           return std::string(hwy::TargetName(target.param));
                         });

}  // namespace
}  // namespace slabd::hal
