// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <string>

#include "base/base.h"
#include "base/jobs.h"

/// Where an item's U comes from, for people.
namespace slabd::cli {

[[nodiscard]] bool has_budget(const Item& item);

/// The parts as they are printed, k = 1, in the item's unit; "-" for a part that an item does not have.
[[nodiscard]] std::array<std::string, kBudgetParts> budget_figures(const Item& item);

/// What the scanner's part rests on: "the larger of recipe p5600 and acceptance sc-3f2a... (form ...)", or the recipe
/// alone. `verified` none: the record is not in the database.
[[nodiscard]] std::string scanner_source(const SlabHeader& slab, const std::optional<ScannerNumbers>& verified);

}  // namespace slabd::cli
