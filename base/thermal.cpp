// SPDX-License-Identifier: Apache-2.0
#include "base/thermal.h"

#include <algorithm>
#include <cmath>

namespace slabd {
namespace {

double square(double x) {
  return x * x;
}

double cube(double x) {
  return x * x * x;
}

}  // namespace

double slab_temperature_c(std::uint16_t temperature_dk) {
  const double temperature_c = 0.1 * temperature_dk - kKelvinAtZero_c;
  const bool is_slab = temperature_c >= kSlabTemperatureMin_c && temperature_c <= kSlabTemperatureMax_c;
  return is_slab ? temperature_c : kNoValue;
}

Thermal thermal_of(const ThermalSettings& settings, double temperature_c) {
  if (!settings.given) return {};
  const double cte = settings.cte_per_K.value;
  const double u_cte = settings.u_cte_per_K.value;
  const double reference_c = settings.reference_c.value;
  if (has_value(temperature_c)) {
    const double above_K = temperature_c - reference_c;
    return {cte * above_K, std::hypot(cte * settings.u_temperature_K.value, above_K * u_cte), true};
  }
  const double low_K = settings.unknown_low_c.value - reference_c;
  const double high_K = settings.unknown_high_c.value - reference_c;
  const double mean_square_K2 = (cube(high_K) - cube(low_K)) / (3.0 * (high_K - low_K));
  return {0.0, std::sqrt((square(cte) + square(u_cte)) * mean_square_K2), true};
}

void state_at_reference(const Thermal& thermal, double length_mm, Item& item) {
  if (!thermal.given || !has_value(item.value)) return;
  item.measured = item.value;
  item.value -= length_mm * thermal.expansion / (1.0 + thermal.expansion);
  const double u_mm = std::abs(length_mm) * thermal.u;
  const bool has_budget = std::any_of(item.budget.begin(), item.budget.end(), [](double part) { return part != 0.0; });
  if (has_budget) item.budget[static_cast<std::size_t>(BudgetPart::thermal)] = u_mm;
  item.U = std::hypot(item.U, 2.0 * u_mm);
}

void undo_reference(Item& item) {
  if (!has_value(item.measured)) return;
  item.value = item.measured;
  item.measured = kNoValue;
  double& part = item.budget[static_cast<std::size_t>(BudgetPart::thermal)];
  item.U = std::sqrt(std::max(0.0, square(item.U) - square(2.0 * part)));
  part = 0.0;
}

}  // namespace slabd
