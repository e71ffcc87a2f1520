// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bit>
#include <cstdint>

/// Does a surface go through a point of a grid? Asked in the window of 7 x 7 points around it, one bit each: bit
/// 7 * row + column, the point itself in the middle (bit 24). Near points weigh more; the weights are whole numbers, so
/// the answer is exact.
namespace slabd::algo {

namespace window {

inline constexpr int kReach = 3;  ///< rows and columns each way
inline constexpr int kSide = 2 * kReach + 1;

/// The points within the square root of `distance2` of the middle, without the middle.
constexpr std::uint64_t disc(int distance2) {
  std::uint64_t bits = 0;
  for (int r = -kReach; r <= kReach; ++r)
    for (int c = -kReach; c <= kReach; ++c)
      if (r * r + c * c > 0 && r * r + c * c <= distance2)
        bits |= std::uint64_t{1} << static_cast<unsigned>(kSide * (r + kReach) + c + kReach);
  return bits;
}
inline constexpr std::uint64_t kNear = disc(2);
inline constexpr std::uint64_t kMiddle = disc(5);
inline constexpr std::uint64_t kFar = disc(10);
inline constexpr std::uint64_t kAround = ((std::uint64_t{1} << 49U) - 1U) & ~(std::uint64_t{1} << 24U);

/// 11 for the 8 nearest points, 6 for the 12 next ones, 1 for 16 more: in all 176. Close to (1 - d^2 / 3.5^2)^2.
[[gnu::always_inline]] inline int weight(std::uint64_t bits) {
  return 5 * (std::popcount(bits & kNear) + std::popcount(bits & kMiddle)) + std::popcount(bits & kFar);
}

/// Weight that must lie on a surface with the point: more than four nearest points have, so that a clump of five is
/// noise.
inline constexpr int kWeightMin = 48;
/// Share of the weight present that must lie on it, in per cent, and the share that needs no other reason. Of a full
/// surface's weight an edge has 60, a corner 36, and a point one step beyond an edge 40. Where a surface reigns, among
/// clutter but far from edges, a smaller share will do.
inline constexpr int kShareReigning = 46;
inline constexpr int kShareMin = 48;
inline constexpr int kShareSure = 55;
/// Below the sure share the point must lie beside the rest, as on an edge, not amidst it: the rest's centre of gravity
/// this far away, in points.
inline constexpr double kBeside = 0.945;

/// The weighted points of `rest` lie on one side of the middle.
[[gnu::always_inline]] inline bool beside(std::uint64_t rest) {
  int x = 0;
  int y = 0;
  for (std::uint64_t left = rest & kFar; left != 0; left &= left - 1) {
    const int bit = std::countr_zero(left);
    const int c = bit % kSide - kReach;
    const int r = bit / kSide - kReach;
    const int d2 = r * r + c * c;
    const int w = d2 <= 2 ? 11 : (d2 <= 5 ? 6 : 1);
    x += w * c;
    y += w * r;
  }
  const double away2 = static_cast<double>(x) * x + static_cast<double>(y) * y;
  const double limit = kBeside * weight(rest);
  return away2 >= limit * limit;
}

/// `on`: the points on a surface that goes through the middle; `present`: all that were seen; `reigning`: the surface
/// is the only one known around.
[[gnu::always_inline]] inline bool holds_middle(std::uint64_t on, std::uint64_t present, bool reigning) {
  const int held = weight(on);
  const int all = weight(present);
  if (reigning) return held >= kWeightMin && 100 * held >= kShareReigning * all;
  if (held < kWeightMin || 100 * held < kShareMin * all) return false;
  return 100 * held >= kShareSure * all || beside(present & ~on);
}

}  // namespace window
}  // namespace slabd::algo
