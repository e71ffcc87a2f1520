// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "base/pose.h"

/// Stops that differ from station to station, so that the block's place in a scan proves the stop it was taken from
/// (daemon/station/station_views.h). The pattern has 18 shifts and turns. At the full amplitude of 4 mm and 1 degree
/// any two differ by at least 3.9 mm and 1.0 deg. Stations one or two apart, counted cyclically, differ by at least 6.5
/// mm and 1.6 deg.
namespace slabd {

/// Two stops are distinguishable if the block appears this far apart; closer stops are not compared.
inline constexpr double kStopsDiffer_mm = 2.5;
inline constexpr double kStopsDiffer_rad = 0.35 * kPi / 180.0;

struct Dither {
  double mm = 4.0;   ///< largest shift along each axis of the block
  double deg = 1.0;  ///< largest turn about each axis through the block's origin
};

/// Returns `T_block_scanner` moved by the pattern of `station` (from 1).
[[nodiscard]] Pose dithered(const Pose& T_block_scanner, int station, const Dither& dither);

/// Difference of the block's pose between two stops.
struct StopDifference {
  double mm = 0.0;
  double deg = 0.0;
};
[[nodiscard]] StopDifference stop_difference(const Pose& T_block_scanner, const Pose& other);
/// True if the difference is large enough to distinguish the two stops' scans by pose.
[[nodiscard]] bool is_told_apart(const StopDifference& difference);

}  // namespace slabd
