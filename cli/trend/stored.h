// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "cli/trend/series.h"

namespace slabd::cli::trend {

/// Trend of one item in a database. Slab types differ in blocks and limits, and emulated slabs are not real ones: the
/// newest slab selects which are shown. Sets `other_types` if slabs of other types were left out. Stops if the database
/// cannot be read.
[[nodiscard]] Trend read_trend(storage::Reader& reader, storage::ItemFilter filter, bool& other_types);
/// Trends of all items, in the order of their numbers; those without values, too. `filter.item` is not used;
/// `filter.slab_type` must be set.
[[nodiscard]] std::vector<Trend> read_trends(storage::Reader& reader, storage::ItemFilter filter);

}  // namespace slabd::cli::trend
