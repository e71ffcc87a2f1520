// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "storage/rows.h"
#include "storage/storage.h"

/// Questions about many slabs. Each call belongs into the caller's transaction and throws SqlFailure.
namespace slabd::storage {

/// SQL, in parentheses: of how many stations the valid attempt came to a result, which `not_measured` is not.
/// `slab_key` is an expression of the statement around it.
[[nodiscard]] std::string count_measured(std::string_view slab_key);

[[nodiscard]] std::vector<SlabSummary> find_slabs(Connection& db, const SlabFilter& filter);
[[nodiscard]] std::vector<ItemValue> find_values(Connection& db, const ItemFilter& filter);

}  // namespace slabd::storage
