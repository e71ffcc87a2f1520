// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "algo/survey/surface_raster.h"
#include "algo/survey/surface_reference.h"
#include "base/team.h"

namespace slabd::algo {

/// Takes away from `field.off`, which holds the distances to the faces, what is usual along the edges, and fills
/// `field.face_off` along them; cells that the chamfers of outer edges reach get their zone. Cells of a strip that is
/// seldom seen are no longer looked at. No heap; 0.9 ms.
void take_edges_away(const SurfaceTable& whole, Team& team, SurfaceField& field);

}  // namespace slabd::algo
