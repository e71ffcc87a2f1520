// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <string>

#include "base/base.h"
#include "base/jobs.h"
#include "report/words.h"

/// Text of an item's uncertainty budget.
namespace slabd::report {

[[nodiscard]] bool has_budget(const Item& item);

/// Budget parts as text, k = 1, in the item's unit; "-" for a part that the item does not have.
[[nodiscard]] std::array<std::string, kBudgetParts> budget_figures(const Item& item);

/// Source of the scanner part: "the larger of recipe p5600 and acceptance sc-3f2a... (form ...)", or the recipe alone.
/// `verified` is nullopt if the acceptance record is not in the database.
[[nodiscard]] std::string scanner_source(const SlabHeader& slab, const std::optional<ScannerNumbers>& verified,
                                         report::Language language);

}  // namespace slabd::report
