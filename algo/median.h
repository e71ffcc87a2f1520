// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>

namespace slabd::algo {

/// The value that stands at `rank` (from 0) once `values` are sorted: what std::nth_element finds, several times as
/// fast for thousands of values. None may be NaN; they are re-ordered. No heap, O(n).
///
/// Two values of a small sample bracket the one looked for; one pass counts what lies below and inside of the bracket,
/// a second one moves what lies inside to the front, and only that little is searched. The passes have no branch to
/// mispredict.
[[nodiscard]] inline double value_at_rank(std::span<double> values, std::size_t rank) {
  constexpr std::size_t kSample = 128;
  constexpr std::size_t kEitherSide = 16;  ///< three standard deviations of a sample's rank
  const std::size_t n = values.size();
  const auto at = [&](std::span<double> of, std::size_t r) {
    const auto wanted = of.begin() + static_cast<std::ptrdiff_t>(r);
    std::nth_element(of.begin(), wanted, of.end());
    return *wanted;
  };
  if (n < 8 * kSample) return at(values, rank);

  std::array<double, kSample> sample;
  for (std::size_t i = 0; i < kSample; ++i) sample[i] = values[i * n / kSample];
  std::sort(sample.begin(), sample.end());
  const std::size_t middle = rank * kSample / n;
  const double low = sample[middle < kEitherSide ? 0 : middle - kEitherSide];
  const double high = sample[std::min(middle + kEitherSide, kSample - 1)];
  std::size_t below = 0;
  std::size_t up_to_high = 0;
  for (const double v : values) {
    below += v < low ? 1U : 0U;
    up_to_high += v <= high ? 1U : 0U;
  }
  if (rank < below || rank >= up_to_high) return at(values, rank);
  std::size_t inside = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const double v = values[i];
    values[i] = values[inside];
    values[inside] = v;
    inside += (v >= low ? 1U : 0U) & (v <= high ? 1U : 0U);
  }
  return at(values.first(inside), rank - below);
}

/// The upper median: the value with as many below it as not. 0 of none.
[[nodiscard]] inline double median_of(std::span<double> values) {
  return values.empty() ? 0.0 : value_at_rank(values, values.size() / 2);
}

}  // namespace slabd::algo
