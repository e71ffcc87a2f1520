// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "algo/algo.h"
#include "algo/features/seat_points.h"
#include "algo/register/icp_kernels.h"
#include "base/base.h"

/// The loops that look for points around the casings.
namespace slabd::algo {

/// From the scanner's frame to the seat's, in which the casings lie on the line x = 0 at s = -+half_spacing.
struct CasingStrips {
  /// Points this far from the bearing plane belong to it: rims are sunk by less than a millimetre.
  static constexpr double kHeight_mm = 3.0;

  Mat3 R_seat_scanner = Mat3::Identity();  ///< rows: along the rail, along the seat, above the bearing plane
  Vec3 t_seat_scanner = Vec3::Zero();
  double half_spacing_mm = 0.0;
};

/// What lies near the bearing plane and in a rectangle about one casing's nominal place.
struct StripBox {
  bool outer = false;
  double half_x_mm = 0.0;
  double half_s_mm = 0.0;
};

/// Points of a sample in a box: places from the casing's nominal one, and which of the sample they are. Room for as
/// many as the sample has and sixteen more.
struct StripPlaces {
  std::span<float> x;
  std::span<float> s;
  std::span<float> number;  ///< exact: a sample has fewer than 2^24 points
};
/// Returns how many. Places to 1e-4 mm. 2 ns for each sixteen points of the sample.
[[nodiscard]] std::size_t places_in_box(const IcpSample& sample, const CasingStrips& strips, const StripBox& box,
                                        const StripPlaces& to);

/// A rectangle of an organised cloud, or with `rows` 1 a stretch of any cloud.
struct CloudPart {
  std::size_t first = 0;
  std::size_t columns = 0;
  std::size_t rows = 0;
  std::size_t stride = 0;  ///< from row to row
};
/// Room for the points found; sixteen more than they may be.
struct RunRoom {
  std::span<float> x, s, h;
};
/// The points of a part of the cloud within `reach_mm` of either casing's nominal place along both axes of the seat,
/// in the seat's frame, as exact as floats; no more than there is room for. Half a nanosecond a point.
[[nodiscard]] SeatPoints points_around_casings(const Cloud& cloud, const CloudPart& part, const CasingStrips& strips,
                                               double reach_mm, const RunRoom& to);

}  // namespace slabd::algo
