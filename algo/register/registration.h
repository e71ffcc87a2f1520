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

// Position along the rail of a block whose casings are not usable: capped, plugged, under water or covered.

/// Standard deviation (mm) of the robot's position along the rail, for scans that do not determine it: a slab pushed
/// against its stops, the robot's error, the mould's. Items that depend on the position must tolerate it.
inline constexpr double kRobotAlongRailSigma_mm = 5.0;

/// Middle between the two ends of the bearing plane along the rail, as a tie. The end faces are too steep to return
/// points, but beyond them the slab's top is visible, 30 mm deeper. Chamfers and wear leave each end uncertain by a
/// millimetre, the middle of both by half. If the field of view contains only one end, it is uncertain by two. nullopt
/// if no end is seen, or the two are not a block's length apart. `T_block_scanner` must be right in height, tilt and
/// across the rail. From the sample as drawn: 0.2 ms. No heap.
[[nodiscard]] std::optional<Tie> tie_to_ends(const IcpSample& sample, const BlockModel& model,
                                             const EvaluationSettings& settings, const Pose& T_block_scanner);

/// The robot's position along the rail as a tie.
[[nodiscard]] Tie tie_to_robot(const Pose& T_block_scanner_by_robot);

/// Memory for registration, owned by the inspector.
struct RegistrationWorkspace {
  IcpMemory icp;
  std::span<std::uint32_t> histogram;  ///< limits::kDeviationBins
  std::span<float> casings;            ///< kCasingTiesFloats
};

/// Start and acceptance criteria of a registration.
struct RegistrationTask {
  const BlockModel& model;
  const FaceTable& table;
  const HeightMap& heights;
  const EvaluationSettings& settings;
  Pose T_block_scanner;  ///< start
};

/// Finds the block in `cloud` (scanner frame, denoised): ICP to the model, point to plane, robust, gates shrinking,
/// from the start. If that does not give an acceptable pose, starts from the results of a search of the whole window.
/// Uses casings if the faces leave a direction open. Fills every field of the report. `status` is converged only if the
/// pose has converged, is determined in all six directions, is in the window, and every visible face is really there.
/// Deterministic; no heap.
[[nodiscard]] RegistrationReport register_block(const Cloud& cloud, const RegistrationTask& task,
                                                const RegistrationWorkspace& work, Team& team);

}  // namespace slabd::algo
