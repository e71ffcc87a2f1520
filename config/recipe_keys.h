// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "base/recipe.h"

/// A recipe as the list of the keys in its file.
namespace slabd::config {

struct NamedNominal {
  std::string name;  ///< "block.jaw_angle_deg"
  Nominal nominal;
  bool is_angle = false;
};
[[nodiscard]] std::vector<NamedNominal> geometry_of(const Recipe& recipe);
/// Nominals of [uncertainty] and [thermal], without a table that the recipe does not have.
[[nodiscard]] std::vector<NamedNominal> uncertainty_of(const Recipe& recipe);
/// Value in the unit of the file: degrees for angles.
[[nodiscard]] double shown(const NamedNominal& n);

/// Effect of a changed value of a key.
enum class KeyEffect : std::uint8_t {
  none,      ///< only text: confirmations, the recipe's name
  verdict,   ///< verdicts on measured values: stored values are enough to re-evaluate
  slab,      ///< the slab's items computed from measured seats: stored seats are enough
  measured,  ///< measurement of a block, or its U: re-evaluation requires the scans
};
[[nodiscard]] std::string_view name(KeyEffect effect);

struct RecipeKey {
  std::string key;    ///< "block.jaw_angle_deg", "items.seat_slope.upper", "guard"
  std::string value;  ///< full precision; "-" if there is none
  KeyEffect effect = KeyEffect::none;
};
/// All keys of a recipe, always the same keys in the same order. Angles in degrees.
[[nodiscard]] std::vector<RecipeKey> keys_of(const Recipe& recipe);

}  // namespace slabd::config
