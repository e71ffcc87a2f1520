// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "algo/algo.h"
#include "algo/block_model.h"
#include "algo/register/block_search.h"
#include "algo/register/casing_ties.h"
#include "algo/register/icp.h"
#include "algo/register/icp_kernels.h"
#include "base/team.h"

namespace slabd::algo {

// Where along the rail is a block whose casings say nothing: capped, plugged, under water or covered?

/// Where the robot says that the block is, if the scan does not (standard deviation, mm): a slab pushed against its
/// stops, the robot's own error, and a mould's. An item that depends on the place along the rail must bear this much.
inline constexpr double kRobotAlongRailSigma_mm = 5.0;

/// The middle between the two places along the rail where the bearing plane ends, as a tie. The end faces themselves
/// are too steep to return points, but beyond them lies the slab's top, 30 mm deeper. Chamfers and wear leave each end
/// uncertain by a millimetre, the middle of both by half; of a single end, where the field of view has only one, by
/// two. Nothing where no end is seen, or where the two are not a block's length apart. `T_block_scanner` must be right
/// in height, tilt and across the rail. From the sample as drawn: 0.2 ms. No heap.
[[nodiscard]] std::optional<Tie> tie_to_ends(const IcpSample& sample, const BlockModel& model,
                                             const EvaluationSettings& settings, const Pose& T_block_scanner);

/// The robot's word as a tie.
[[nodiscard]] Tie tie_to_robot(const Pose& T_block_scanner_by_robot);

/// Memory for registration, owned by the inspector.
struct RegistrationWorkspace {
  IcpMemory icp;
  std::span<std::uint32_t> histogram;  ///< limits::kDeviationBins
  std::span<float> casings;            ///< kCasingTiesFloats
};

/// Where a registration starts and what makes it acceptable.
struct RegistrationTask {
  const BlockModel& model;
  const FaceTable& table;
  const HeightMap& heights;
  const EvaluationSettings& settings;
  Pose T_block_scanner;  ///< start
};

/// Finds the block in `cloud` (scanner frame, denoised): ICP to the model, point to plane, robust, gates shrinking,
/// from the start; where that does not end at a pose beyond doubt, from the places that a search of the whole window
/// offers. Casings where the faces leave a direction open. Fills every field of the report;
/// `status` is converged only if the pose stands still, is determined in all six directions, lies in the window, and
/// every face that is looked at is really there. Deterministic; no heap.
[[nodiscard]] RegistrationReport register_block(const Cloud& cloud, const RegistrationTask& task,
                                                const RegistrationWorkspace& work, Team& team);

}  // namespace slabd::algo
