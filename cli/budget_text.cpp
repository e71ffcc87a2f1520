// SPDX-License-Identifier: Apache-2.0
#include "cli/budget_text.h"

#include <fmt/core.h>

#include <algorithm>
#include <vector>

#include "cli/figures.h"
#include "cli/render.h"

namespace slabd::cli {
namespace {

std::string known(double value, int decimals, const char* unit) {
  return has_value(value) ? fmt::format("{:.{}f} {}", value, decimals, unit) : std::string("not known");
}

}  // namespace

bool has_budget(const Item& item) {
  return std::any_of(item.budget.begin(), item.budget.end(), [](double part) { return part != 0.0; });
}

std::array<std::string, kBudgetParts> budget_figures(const Item& item) {
  std::array<std::string, kBudgetParts> figures;
  for (std::size_t part = 0; part < kBudgetParts; ++part)
    figures[part] = item.budget[part] == 0.0 ? "-" : fmt::format("{:.5f}", item.budget[part]);
  return figures;
}

std::string budget_table(std::span<const Item> items, bool of_slab) {
  std::vector<std::vector<std::string>> rows = {{"U from, k = 1", "U (k = 2)"}};
  for (std::size_t part = 0; part < kBudgetParts; ++part) rows[0].emplace_back(name(static_cast<BudgetPart>(part)));
  for (const Item& item : items) {
    if (!has_budget(item) || !has_value(item.value)) continue;
    rows.push_back({item_label(item, of_slab), U_figure(item)});
    for (std::string& figure : budget_figures(item)) rows.back().push_back(std::move(figure));
  }
  return rows.size() == 1 ? "" : table(rows);
}

std::string scanner_source(const SlabHeader& slab, const std::optional<ScannerNumbers>& verified) {
  if (slab.scanner_id.empty()) return fmt::format("recipe {} alone, the scanner was not verified", slab.recipe.view());
  if (!verified)
    return fmt::format("the larger of recipe {} and acceptance {}, which is not in the database", slab.recipe.view(),
                       slab.scanner_id.view());
  return fmt::format("the larger of recipe {} and acceptance {} (form +-{} over {}, size {}, noise correlated over {})",
                     slab.recipe.view(), slab.scanner_id.view(), known(verified->form_half_mm, 4, "mm"),
                     known(verified->form_length_mm, 0, "mm"), known(verified->PS_mm, 4, "mm"),
                     known(verified->noise_correlation_mm, 2, "mm"));
}

}  // namespace slabd::cli
