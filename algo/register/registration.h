// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "algo/algo.h"
#include "algo/block_model.h"
#include "algo/register/block_search.h"
#include "algo/register/casing_ties.h"
#include "algo/register/icp.h"
#include "base/team.h"

namespace slabd::algo {

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
