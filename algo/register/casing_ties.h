// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "algo/algo.h"
#include "algo/block_model.h"
#include "algo/register/icp_sample.h"
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

}  // namespace slabd::algo
