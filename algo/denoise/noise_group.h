// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

/// When noise hangs together, it is none. A fin or a crack two grid lines wide holds less than half of what is around
/// its points, so no surface goes through them by the rule of shares, however long and high it is. Outliers stand
/// alone or in clumps at random heights, and what touches in the grid and in height is never long; damage is. What
/// leans or is torn, a wire or a broken edge, rises more from point to point; where it may, chance makes groups longer.
namespace slabd::algo::noise_group {

struct Rule {
  /// Rows, columns or pitches from the first to the last of a group, ends counted, from which on it is damage.
  int length;
  /// Neighbours hang together if their heights are so near.
  float step_mm;
};
/// In the order in which they are asked, each of what those before it left: an outlier beside a fin is not a part of
/// it.
inline constexpr std::array<Rule, 2> kRules = {{
    // Noise, and a rise at which a rough crack still is one thing: the gate of a level surface that goes on (0.6 of
    // 0.6 mm). Clumps of five in a row are as long only when four touch that chance has put at the same height.
    {16, 0.36F},
    // So high no edge is torn from line to line; and what stood steeper would be 100 mm high before it is as long.
    {32, 3.0F},
}};

}  // namespace slabd::algo::noise_group
