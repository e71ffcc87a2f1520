// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "storage/storage.h"

namespace slabd::cli::args {
class Command;
}  // namespace slabd::cli::args

namespace slabd::cli {

/// Adds `slabctl recipe diff` to the command `recipe`.
void add_recipe_diff(args::Command& recipe);

/// Judges the block items of a stored slab again with `recipe`: its limits, its guard band, and, without a budget, its
/// U or the stored one if that is larger, because the scan may have increased it. Values, budgets and seats remain as
/// measured. `measured_with` is the recipe of the measurement, or null. `unknown_U` increases by the number of items
/// whose verdict depends on a U that only the scan contains.
[[nodiscard]] std::vector<StationRecord> rejudged(const storage::SlabRecord& record, const Recipe& recipe,
                                                  const Recipe* measured_with, int& unknown_U);

}  // namespace slabd::cli
