// SPDX-License-Identifier: Apache-2.0
#include "base/noise_print.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "base/prng.h"

namespace slabd {
namespace {

/// Print with `places` random signs from the first place of the coarse grid on, and as many in the fine grid if
/// `dense`.
std::unique_ptr<NoisePrint> random_print(std::uint64_t seed, std::size_t places, bool dense = false) {
  Prng prng(seed);
  auto print = std::make_unique<NoisePrint>();
  for (std::size_t i = 0; i < places; ++i) print->coarse.set(i, prng.below(2) == 0);
  for (std::size_t i = 0; dense && i < places; ++i) print->fine.set(i, prng.below(2) == 0);
  print->places = static_cast<std::uint32_t>(places);
  return print;
}

TEST(NoisePrint, equal_signs_correlate_by_one_and_opposite_ones_by_minus_one) {
  const auto print = random_print(1, 5'000);
  EXPECT_EQ(noise_correlation(*print, *print), 1.0);
  auto opposite = std::make_unique<NoisePrint>(*print);
  for (std::size_t i = 0; i < opposite->coarse.high.size(); ++i)
    opposite->coarse.high[i] = ~opposite->coarse.high[i] & opposite->coarse.known[i];
  EXPECT_EQ(noise_correlation(*print, *opposite), -1.0);
  EXPECT_NEAR(noise_correlation(*print, *random_print(2, 5'000)), 0.0, 5.0 / std::sqrt(5'000.0));
}

TEST(NoisePrint, too_few_common_places_give_no_decision) {
  const auto enough = random_print(1, limits::kNoisePlacesMin);
  const auto too_few = random_print(1, limits::kNoisePlacesMin - 1);
  EXPECT_EQ(noise_correlation(*enough, *enough), 1.0);
  EXPECT_TRUE(std::isnan(noise_correlation(*enough, *too_few)));
}

TEST(NoisePrint, the_fine_grid_decides_where_both_have_one) {
  const auto dense = random_print(1, 5'000, true);
  auto other = std::make_unique<NoisePrint>(*dense);
  other->fine = random_print(2, 5'000, true)->fine;
  EXPECT_LT(noise_correlation(*dense, *other), 0.1);
  other->fine = {};
  EXPECT_EQ(noise_correlation(*dense, *other), 1.0) << "of a scan that is not dense the coarse one";
}

TEST(NoisePrint, its_bytes_bring_it_back_and_others_do_not) {
  const auto print = random_print(3, 6'000, true);
  const NoisePrintBytes bytes = to_bytes(*print);
  auto back = std::make_unique<NoisePrint>();
  ASSERT_TRUE(from_bytes(bytes, *back));
  EXPECT_EQ(back->fine.known, print->fine.known);
  EXPECT_EQ(back->fine.high, print->fine.high);
  EXPECT_EQ(back->coarse.known, print->coarse.known);
  EXPECT_EQ(back->coarse.high, print->coarse.high);
  EXPECT_EQ(back->places, 6'000U);

  EXPECT_FALSE(from_bytes(std::span(bytes).first(bytes.size() - 1), *back));
  EXPECT_FALSE(from_bytes({}, *back));
  EXPECT_EQ(back->places, 6'000U);
}

}  // namespace
}  // namespace slabd
