// SPDX-License-Identifier: Apache-2.0
#include "report/budget_text.h"

#include <fmt/core.h>

#include <algorithm>

#include "report/say.h"

namespace slabd::report {
namespace {

std::string known(double value, int decimals, report::Language language) {
  return has_value(value) ? fmt::format("{:.{}f} mm", value, decimals) : say(language, "not known");
}

}  // namespace

bool has_budget(const Item& item) {
  return std::any_of(item.budget.begin(), item.budget.end(), [](double part) { return part != 0.0; });
}

std::vector<std::string> budget_figures(const Item& item, bool tied) {
  static_assert(static_cast<std::size_t>(BudgetPart::tie) + 1 == kBudgetParts, "the tie is the last part");
  std::vector<std::string> figures;
  for (std::size_t part = 0; part < kBudgetParts - (tied ? 0 : 1); ++part)
    figures.push_back(item.budget[part] == 0.0 ? "-" : fmt::format("{:.5f}", item.budget[part]));
  return figures;
}

std::string scanner_source(const SlabHeader& slab, std::size_t arm, const std::optional<ScannerNumbers>& verified,
                           report::Language language) {
  const CalibrationId& id = arm == 0 ? slab.scanner_id : slab.more_arms[arm - 1].scanner_id;
  if (id.empty()) return say(language, "recipe {} alone, the scanner was not verified", slab.recipe.view());
  if (!verified)
    return say(language, "the larger of recipe {} and acceptance {}, which is not in the database", slab.recipe.view(),
               id.view());
  return say(language,
             "the larger of recipe {} and acceptance {} (form +-{} over {}, size {}, noise correlated over {})",
             slab.recipe.view(), id.view(), known(verified->form_half_mm, 4, language),
             known(verified->form_length_mm, 0, language), known(verified->PS_mm, 4, language),
             known(verified->noise_correlation_mm, 2, language));
}

}  // namespace slabd::report
