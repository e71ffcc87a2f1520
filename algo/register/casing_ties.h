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

/// Position of the block from its casings, for scans whose faces leave a direction open. Bearing plane, jaws and
/// shoulders are parallel to the rail and do not determine the position along it; only the end faces do. A scanner that
/// looks past them, or from one point down their 10 degree draft, does not see them.
namespace slabd::algo {

/// A measured point of the scan and its nominal distance along one direction of the block.
struct Tie {
  Vec3 p_scanner = Vec3::Zero();
  Vec3 direction = Vec3::UnitX();  ///< block frame, unit
  double target_mm = 0.0;          ///< direction.(T_block_scanner * p_scanner) for a nominal block
  double sigma_mm = 0.0;           ///< standard deviation of the point along the direction
};

struct CasingTies {
  Pose T_block_scanner;      ///< shifted along the rail so that the bores are at their nominal position
  FixedVector<Tie, 4> ties;  ///< along the rail and along the seat for each casing found; empty if none was found
};

/// Memory of casing_ties, in floats: positions of the sample, then points around the casings. A scan of a whole block
/// has 250 000 of those around each casing; if there are more than fit, the first ones are used.
inline constexpr std::size_t kCasingTiesFloats = 6 * (limits::kIcpPointsMax + 16) + 6 * (std::size_t{1} << 19U);
static_assert(kCasingTiesFloats <= limits::kScanPointsMax, "they are stored in the memory of the index");

/// Offset of the bores along the rail from their position under `T_block_scanner`, to a millimetre or two; nullopt if
/// no bore was found. From the sample alone (as drawn): a tenth of a millisecond. The pose must fulfil the requirements
/// of tie_to_casings. `room`: kCasingTiesFloats.
[[nodiscard]] std::optional<double> casings_off_mm(const IcpSample& sample, const BlockModel& model,
                                                   const EvaluationSettings& settings, const Pose& T_block_scanner,
                                                   std::span<float> room, Team& team);

/// Searches the two bores along the rail, up to window_mm (100 at most) to either side of `T_block_scanner`, which must
/// be right in height, tilt and across the rail; then fits their edges. A casing needs a round edge of the right radius
/// (see measure_casing). The sample gives the position of the bores, in an organised cloud also their grid range: a
/// millisecond. Any other cloud is read once, half a nanosecond a point.
[[nodiscard]] CasingTies tie_to_casings(const Cloud& cloud, const IcpSample& sample, const BlockModel& model,
                                        const EvaluationSettings& settings, const Pose& T_block_scanner,
                                        std::span<float> room, Team& team);

// The loops that select points around the casings.

/// Transform from the scanner's frame to the seat's, with the casings on the line x = 0 at s = -+half_spacing.
struct CasingStrips {
  /// Points this far from the bearing plane belong to it, because rims are sunk by less than a millimetre.
  static constexpr double kHeight_mm = 3.0;

  Mat3 R_seat_scanner = Mat3::Identity();  ///< rows: along the rail, along the seat, above the bearing plane
  Vec3 t_seat_scanner = Vec3::Zero();
  double half_spacing_mm = 0.0;
};

/// Box near the bearing plane: a rectangle about one casing's nominal position.
struct StripBox {
  bool outer = false;
  double half_x_mm = 0.0;
  double half_s_mm = 0.0;
};

/// Points of a sample in a box: positions relative to the casing's nominal one, and indices in the sample. Capacity:
/// the size of the sample and sixteen more.
struct StripPlaces {
  std::span<float> x;
  std::span<float> s;
  std::span<float> number;  ///< exact: a sample has fewer than 2^24 points
};
/// Returns their number. Positions are accurate to 1e-4 mm. 2 ns for each sixteen points of the sample.
[[nodiscard]] std::size_t places_in_box(const IcpSample& sample, const CasingStrips& strips, const StripBox& box,
                                        const StripPlaces& to);

/// A rectangle of an organised cloud, or with `rows` = 1 a range of any cloud.
struct CloudPart {
  std::size_t first = 0;
  std::size_t columns = 0;
  std::size_t rows = 0;
  std::size_t stride = 0;  ///< from row to row
};
/// Memory for the points found; sixteen more than their maximum number.
struct RunRoom {
  std::span<float> x, s, h;
};
/// The points of a part of the cloud within `reach_mm` of either casing's nominal position along both axes of the seat,
/// in the seat's frame, with float accuracy; at most the capacity of `to`. Half a nanosecond a point.
[[nodiscard]] SeatPoints points_around_casings(const Cloud& cloud, const CloudPart& part, const CasingStrips& strips,
                                               double reach_mm, const RunRoom& to);

}  // namespace slabd::algo
