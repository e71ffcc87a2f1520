// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "storage/storage.h"

/// Searches of the reader for slabs.
namespace slabd::storage {

class Connection;

/// SQL in parentheses: number of stations whose valid attempt has a result other than `not_measured`. `slab_key` is an
/// expression of the surrounding statement.
[[nodiscard]] std::string count_measured(std::string_view slab_key);

/// Slabs that match, newest first.
[[nodiscard]] std::vector<SlabSummary> find_slabs(Connection& db, const SlabFilter& filter);

[[nodiscard]] Inspections find_inspections(Connection& db, const InspectionFilter& filter);

}  // namespace slabd::storage
