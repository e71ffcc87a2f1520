// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "cad/block_finder.h"

namespace slabd::cad {

/// Orders the blocks as stations and adds the numbers of the recipe's table [slab], which follow from their places and
/// from the slab's body.
void find_slab_values(const FaceList& model, std::vector<FoundBlock>& blocks, Findings& findings);

}  // namespace slabd::cad
