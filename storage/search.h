// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "storage/rows.h"
#include "storage/storage.h"

/// Questions about many slabs. Each call belongs into the caller's transaction and throws SqlFailure.
namespace slabd::storage {

[[nodiscard]] std::vector<SlabSummary> find_slabs(Connection& db, const SlabFilter& filter);
[[nodiscard]] std::vector<ItemValue> find_values(Connection& db, const ItemFilter& filter);

}  // namespace slabd::storage
