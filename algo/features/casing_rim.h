// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>

/// The height of a casing's rim at the axis of its bore, from points of its ring that may be dark, tilted or partly
/// under a crust.
namespace slabd::algo {

/// A point of the ring: place from the bore's axis and height above the fitted seat, mm.
struct RimPoint {
  float x = 0.0F;
  float y = 0.0F;
  float height = 0.0F;
};

struct RimHeight {
  bool ok = false;            ///< the points are one plane, from most of the way round
  double height_mm = 0.0;     ///< of that plane at the axis
  double tilt = 0.0;          ///< its slope against the seat
  double std_mm = 0.0;        ///< of the points on it
  double sigma_mm = 0.0;      ///< standard uncertainty of the height: noise, form of the rim, what hides of it
  std::size_t points = 0;     ///< on it
  double share_on = 0.0;      ///< of the sectors seen, those that lie on it
  double share_below = 0.0;   ///< ... and below it: pieces missing
  double share_points = 0.0;  ///< of the points of those sectors, those that do
  double share_seen = 0.0;    ///< sectors of all that were seen
  double crust_mm = 0.0;  ///< the highest that three of four neighbouring sectors stand over the seat and this plane
};

/// Each of kRimHeightSectors sectors has one say, however many points it returned. The plane goes through those that
/// lie lowest together: what is on a rim makes it higher, and only a piece that is missing makes it lower.
inline constexpr std::size_t kRimHeightSectors = 32;

/// No heap, 0.2 ms for 6000 points.
[[nodiscard]] RimHeight rim_height(std::span<const RimPoint> points);

}  // namespace slabd::algo
