// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "algo/algo.h"
#include "algo/block_model.h"
#include "algo/features/seat_points.h"
#include "algo/register/icp_kernels.h"
#include "base/base.h"
#include "base/team.h"

/// What the casings say about where the block is, for scans whose faces leave a direction open: bearing plane, jaws and
/// shoulders run along the rail and know nothing of it; only the end faces do, and a scanner that looks past them, or
/// from one point down their 10 degree draft, does not see them.
namespace slabd::algo {

/// A measured point of the scan that must lie at a nominal distance along one direction of the block.
struct Tie {
  Vec3 p_scanner = Vec3::Zero();
  Vec3 direction = Vec3::UnitX();  ///< block frame, unit
  double target_mm = 0.0;          ///< direction.(T_block_scanner * p_scanner), if the block is nominal
  double sigma_mm = 0.0;           ///< standard deviation of the point along the direction
};

struct CasingTies {
  Pose T_block_scanner;      ///< shifted along the rail so that the bores lie where they should
  FixedVector<Tie, 4> ties;  ///< along the rail and along the seat for each casing found; empty: none found
};

/// Room of casing_ties, in floats: places of the sample, then points around the casings. A scan that shows a whole
/// block has 250 000 of those around either casing; of a scan with more than there is room for the first ones count.
inline constexpr std::size_t kCasingTiesFloats = 6 * (limits::kIcpPointsMax + 16) + 6 * (std::size_t{1} << 19U);
static_assert(kCasingTiesFloats <= limits::kScanPointsMax, "they lie in the memory of the index");

/// How far along the rail the bores are from where `T_block_scanner` has them, to a millimetre or two; nothing where
/// none is seen. From the sample alone (as drawn): a tenth of a millisecond. What tie_to_casings asks of the pose holds
/// here too. `room`: kCasingTiesFloats.
[[nodiscard]] std::optional<double> casings_off_mm(const IcpSample& sample, const BlockModel& model,
                                                   const EvaluationSettings& settings, const Pose& T_block_scanner,
                                                   std::span<float> room, Team& team);

/// Looks for the two bores along the rail, up to window_mm (100 at most) to either side of `T_block_scanner`, which
/// must be right in height, tilt and across the rail; then fits their edges. A casing counts only with a round edge of
/// the right radius (see measure_casing). The sample says where the bores are, and in an organised cloud also where in
/// the grid: a millisecond; any other cloud is gone through once, half a nanosecond a point.
[[nodiscard]] CasingTies tie_to_casings(const Cloud& cloud, const IcpSample& sample, const BlockModel& model,
                                        const EvaluationSettings& settings, const Pose& T_block_scanner,
                                        std::span<float> room, Team& team);

// The loops that look for points around the casings.

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
