// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "cad/block_finder.h"

namespace slabd::cad {

/// Adds a remark for every face of the model that the numbers found do not explain: with them the block has no such
/// plane, cylinder or hole. A second seat, a stepped jaw or bore, a lug, a base plate or another body is named in this
/// way, whichever of the faces was taken. Fillets and small free-form faces are left out.
void remark_unexplained(const FaceList& model, const std::vector<FoundBlock>& blocks, double reference_mm,
                        Findings& findings);

}  // namespace slabd::cad
