// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "storage/storage.h"

namespace slabd::args {
class Command;
}  // namespace slabd::args

namespace slabd::cli {

/// `slabctl recipe diff`, below the command `recipe`.
void add_recipe_diff(args::Command& recipe);

/// The stations of a stored slab with their block items judged anew by `recipe`: its limits, its guard band, and its U
/// where no budget was computed, or the stored one if that is larger: the scan may have widened it. Values, budgets and
/// seats stay as they were measured. `measured_with` is the recipe that the slab was measured with, or null;
/// `unknown_U` grows by the items whose verdict rests on what only the scan knows of their U.
[[nodiscard]] std::vector<StationRecord> rejudged(const storage::SlabRecord& record, const Recipe& recipe,
                                                  const Recipe* measured_with, int& unknown_U);

}  // namespace slabd::cli
