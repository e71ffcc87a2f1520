// SPDX-License-Identifier: Apache-2.0
#pragma once

/// When noise hangs together, it is none. A fin or a crack two grid lines wide holds less than half of what is around
/// its points, so no surface goes through them by the rule of shares, however long and high it is. Outliers stand
/// alone or in clumps at random heights, and what touches in the grid and in height is never long; damage is.
namespace slabd::algo::noise_group {

/// Rows, columns or pitches from the first to the last of a group, ends counted, from which on it is damage. Clumps of
/// five in a row reach it only when four touch that chance has put at the same height.
inline constexpr int kLength = 16;
/// Neighbours hang together if their heights are so near: noise, and a rise at which a rough crack or a wire still is
/// one thing. The gate of a level surface that goes on (0.6 of 0.6 mm).
inline constexpr float kStep_mm = 0.36F;

}  // namespace slabd::algo::noise_group
