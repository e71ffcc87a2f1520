// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "base/base.h"
#include "base/jobs.h"
#include "report/words.h"

/// Text of an item's uncertainty budget.
namespace slabd::report {

[[nodiscard]] bool has_budget(const Item& item);

/// Budget parts as text, k = 1, in the item's unit; "-" for a part that the item does not have. The last one, the tie,
/// only of a slab that two robots scanned (`tied`).
[[nodiscard]] std::vector<std::string> budget_figures(const Item& item, bool tied);

/// Source of the scanner part: "the larger of recipe p5600 and acceptance sc-3f2a... (form ...)", or the recipe alone.
/// `verified` is nullopt if the acceptance record of the arm's scanner is not in the database.
[[nodiscard]] std::string scanner_source(const SlabHeader& slab, std::size_t arm,
                                         const std::optional<ScannerNumbers>& verified, report::Language language);

}  // namespace slabd::report
