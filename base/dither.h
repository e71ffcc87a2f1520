// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "base/pose.h"

/// Stops that differ from station to station, so that the place in which a scan shows its block proves from which stop
/// it was taken (daemon/station/station_views.h). A pattern of 18 places and turns; with the whole amplitude of 4 mm
/// and 1 degree any two of them differ by at least 3.9 mm and 1.0 deg, and those of stations that are next to each
/// other or next but one, from the last to the first again, by at least 6.5 mm and 1.6 deg.
namespace slabd {

/// Two stops from which the same block appears this far apart are told apart; those that differ less are not compared.
inline constexpr double kStopsDifferMm = 2.5;
inline constexpr double kStopsDifferRad = 0.35 * kPi / 180.0;

struct Dither {
  double mm = 4.0;   ///< largest shift along each axis of the block
  double deg = 1.0;  ///< largest turn about each axis through the block's origin
};

/// `T_block_scanner` as station `station` (from 1) has it.
[[nodiscard]] Pose dithered(const Pose& T_block_scanner, int station, const Dither& dither);

/// How much two stops differ in where they see their blocks.
struct StopDifference {
  double mm = 0.0;
  double deg = 0.0;
};
[[nodiscard]] StopDifference stop_difference(const Pose& T_block_scanner, const Pose& other);
/// Enough for the pose to tell their scans apart.
[[nodiscard]] bool is_told_apart(const StopDifference& difference);

}  // namespace slabd
