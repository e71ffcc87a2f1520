// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "base/items.h"
#include "base/recipe.h"

/// Lengths at the recipe's reference temperature (ISO 1). Concrete 20 K warmer is 0.2 mm longer a metre.
namespace slabd {

inline constexpr double kKelvinAtZero_c = 273.15;
/// Allowed temperatures of a slab, deg C; values outside count as unknown.
inline constexpr double kSlabTemperatureMin_c = -30.0;
inline constexpr double kSlabTemperatureMax_c = 80.0;

/// Temperature from the PLC's register in 0.1 K. NaN if it is 0 (unknown) or outside the allowed temperatures.
[[nodiscard]] double slab_temperature_c(std::uint16_t temperature_dk);

/// Difference between a slab and itself at the reference temperature. Zero without the recipe's [thermal].
struct Thermal {
  double expansion = 0.0;  ///< relative: length now = (1 + expansion) * length at the reference
  double u = 0.0;          ///< its standard uncertainty
  bool given = false;
};

/// Known temperature: expansion a (T - T0) and u^2 = (a u_T)^2 + ((T - T0) u_a)^2. Unknown (NaN): no expansion, and u^2
/// = (a^2 + u_a^2) times the mean of (T - T0)^2 over the recipe's range, every temperature of which is equally likely.
[[nodiscard]] Thermal thermal_of(const ThermalSettings& settings, double temperature_c);

/// Converts a measured item to the reference temperature: `value` is corrected, `measured` keeps what it was, and `U`
/// and the budget get the part `thermal`. `length_mm`: change of the value per unit of relative expansion, for a
/// distance the distance itself. Does nothing without [thermal] or without a value.
void state_at_reference(const Thermal& thermal, double length_mm, Item& item);

/// Takes back what state_at_reference did: the value as measured, without the part `thermal`.
void undo_reference(Item& item);

}  // namespace slabd
