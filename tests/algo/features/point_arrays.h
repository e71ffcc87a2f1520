// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <span>
#include <vector>

#include "algo/features/seat_points.h"
#include "base/base.h"

namespace slabd::testing {

inline constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
inline constexpr float kInf = std::numeric_limits<float>::infinity();
inline constexpr float kHuge = std::numeric_limits<float>::max();
inline constexpr float kTiny = std::numeric_limits<float>::denorm_min();

/// Points of a seat's frame, and parts of them as kernel input: each part is followed by the next points.
struct PointArrays {
  std::vector<float> x, s, h;

  void add(float at_x, float at_s, float at_h) {
    x.push_back(at_x);
    s.push_back(at_s);
    h.push_back(at_h);
  }
  [[nodiscard]] algo::SeatPoints part(std::size_t first, std::size_t count) const {
    return {std::span(x).subspan(first, count), std::span(s).subspan(first, count), std::span(h).subspan(first, count)};
  }
  /// The first `count` in runs of odd lengths, some of them empty.
  [[nodiscard]] std::vector<algo::SeatPoints> runs(std::size_t count, std::size_t length_max) const {
    std::vector<algo::SeatPoints> all;
    Prng prng(count + length_max);
    for (std::size_t at = 0; at < count;) {
      const std::size_t length = std::min<std::size_t>(count - at, prng.below(length_max + 1));
      all.push_back(part(at, length));
      at += length;
    }
    return all;
  }
};

}  // namespace slabd::testing
