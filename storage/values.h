// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "storage/storage.h"

/// Values of items over many slabs, for charts and capability.
namespace slabd::storage {

class Connection;

/// The values of each of these items, by slab and station; `filter.item` is not used. One pass over the newest slabs:
/// several items together cost little more than one.
[[nodiscard]] std::vector<std::vector<ItemValue>> read_values(Connection& db, const ItemFilter& filter,
                                                              std::span<const ItemId> items);

}  // namespace slabd::storage
