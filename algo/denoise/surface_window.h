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
/// Share of the weight present that must lie on it, in per cent. Of a full surface's weight an edge has 60, a corner
/// 36, a point one step beyond an edge 40, the second row 87. Where a surface reigns, among clutter but far from edges,
/// a smaller share will do.
inline constexpr int kShareReigning = 46;
inline constexpr int kShareMin = 55;
/// A point with so large a share stands amidst the surface: more than any edge has. The surface goes on from it to the
/// points next to it, so that edges and corners stay among clutter, and small objects keep their rims; what lies one
/// step beyond an edge has only edge points beside it.
inline constexpr int kShareAmidst = 65;

/// `on`: the points on a surface that goes through the middle; `present`: all that were seen; `share`: in per cent.
[[gnu::always_inline]] inline bool holds_middle(std::uint64_t on, std::uint64_t present, int share) {
  const int held = weight(on);
  return held >= kWeightMin && 100 * held >= share * weight(present);
}

}  // namespace window
}  // namespace slabd::algo
