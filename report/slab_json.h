// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "storage/storage.h"

namespace slabd::report {

/// A stored slab as slabd.slab/1 (docs/schemas/slab.json). `only_block` 0: all blocks.
[[nodiscard]] std::string slab_json(const storage::SlabRecord& record, int only_block = 0);

}  // namespace slabd::report
