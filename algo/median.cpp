// SPDX-License-Identifier: Apache-2.0
//
// A median needs no sorting. Counting the values up to some number is a loop without branches, sixteen values at a
// time. Each count halves the range of the wanted value, until a few values are left, which are examined one by one.
// The range is halved by bit patterns, which have the same order as the numbers: so at most 64 counts are needed for
// any values, and no value is moved. A small sample gives the initial range and saves most of the counts.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "algo/median.cpp"
// clang-format off
#include <hwy/foreach_target.h>
#include "algo/lanes-inl.h"
// clang-format on

#include "algo/median.h"

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {

std::size_t count_at_most_lanes(const double* values, std::size_t size, double limit) {
  const D16 most = d16(limit);
  const D16 one = d16(1.0);
  D16 sum = d16(0.0);
  std::size_t i = 0;
  for (; i + kLanes <= size; i += kLanes) sum = sum + keep(load(values + i) <= most, one);
  auto count = static_cast<std::size_t>(sum_of_lanes(sum));
  for (; i < size; ++i) count += values[i] <= limit ? 1U : 0U;
  return count;
}

/// Copies the values that are at most `most` but not at most `low`; at most `room` of them.
std::size_t values_between_lanes(const double* values, std::size_t size, double low, double most, double* out,
                                 std::size_t room) {
  const D16 lo = d16(low);
  const D16 hi = d16(most);
  std::size_t count = 0;
  std::size_t i = 0;
  for (; i + kLanes <= size; i += kLanes) {
    const D16 v = load(values + i);
    for (std::uint32_t in = bits(v <= hi) & ~bits(v <= lo); in != 0 && count < room; in &= in - 1)
      out[count++] = values[i + static_cast<std::size_t>(__builtin_ctz(in))];
  }
  for (; i < size; ++i)
    if (values[i] <= most && !(values[i] <= low) && count < room) out[count++] = values[i];
  return count;
}

}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

#include <algorithm>
#include <array>
#include <bit>
#include <limits>

namespace slabd::algo {
HWY_EXPORT(count_at_most_lanes);
HWY_EXPORT(values_between_lanes);
namespace {

/// With at most this many values left, another count does not pay.
constexpr std::size_t kFew = 64;
constexpr std::size_t kSample = 32;
/// Three standard deviations of a rank in the sample.
constexpr std::size_t kEitherSide = 8;

/// Maps numbers to integers of the same order, and back, for all values except NaN.
std::uint64_t order_of(double value) {
  const auto bits = std::bit_cast<std::uint64_t>(value);
  constexpr std::uint64_t kSign = std::uint64_t{1} << 63U;
  return (bits & kSign) != 0 ? ~bits : bits | kSign;
}
double value_of(std::uint64_t order) {
  constexpr std::uint64_t kSign = std::uint64_t{1} << 63U;
  return std::bit_cast<double>((order & kSign) != 0 ? order & ~kSign : ~order);
}

double sorted_at(std::span<double> values, std::size_t rank) {
  const auto wanted = values.begin() + static_cast<std::ptrdiff_t>(rank);
  std::nth_element(values.begin(), wanted, values.end());
  return *wanted;
}

}  // namespace

std::size_t count_at_most(std::span<const double> values, double limit) {
  return HWY_DYNAMIC_DISPATCH(count_at_most_lanes)(values.data(), values.size(), limit);
}

double value_at_rank(std::span<const double> values, std::size_t rank) {
  std::array<double, kFew> few;
  const std::size_t n = values.size();
  if (n <= kFew) {
    std::copy(values.begin(), values.end(), few.begin());
    return sorted_at(std::span(few).first(n), rank);
  }

  // At most `rank` values are at or before `low` in order, more than `rank` at or before `high`.
  std::uint64_t low = order_of(-std::numeric_limits<double>::infinity()) - 1;
  std::uint64_t high = order_of(std::numeric_limits<double>::infinity());
  std::size_t up_to_low = 0;
  std::size_t up_to_high = n;
  const auto look_at = [&](std::uint64_t probe) {
    const std::size_t count = count_at_most(values, value_of(probe));
    if (count > rank) {
      high = probe;
      up_to_high = count;
    } else {
      low = probe;
      up_to_low = count;
    }
  };

  std::array<double, kSample> sample;
  for (std::size_t i = 0; i < kSample; ++i) sample[i] = values[i * n / kSample];
  std::sort(sample.begin(), sample.end());
  const std::size_t middle = rank * kSample / n;
  for (const std::size_t at : {middle < kEitherSide ? 0 : middle - kEitherSide, middle, middle + kEitherSide}) {
    const std::uint64_t probe = order_of(sample[std::min(at, kSample - 1)]);
    if (low < probe && probe < high) look_at(probe);
  }
  while (up_to_high - up_to_low > kFew && high - low > 1) look_at(low + (high - low) / 2);
  if (high - low <= 1) return value_of(high);
  // If `low` precedes the first number it converts to NaN, and no value compares at most NaN.
  const std::size_t found = HWY_DYNAMIC_DISPATCH(values_between_lanes)(values.data(), n, value_of(low), value_of(high),
                                                                       few.data(), few.size());
  return sorted_at(std::span(few).first(found), rank - up_to_low);
}

}  // namespace slabd::algo

#endif
