// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "base/recipe.h"

/// A recipe as a list of keys, as they stand in its file.
namespace slabd::daemon {

struct NamedNominal {
  std::string name;  ///< "block.jaw_angle_deg"
  Nominal nominal;
  bool is_angle = false;
};
[[nodiscard]] std::vector<NamedNominal> geometry_of(const Recipe& recipe);
/// Empty when the recipe has no [uncertainty].
[[nodiscard]] std::vector<NamedNominal> uncertainty_of(const Recipe& recipe);
/// In the unit of the file: degrees for angles.
[[nodiscard]] double shown(const NamedNominal& n);

/// What another value of a key changes.
enum class KeyEffect : std::uint8_t {
  none,      ///< words: who confirmed what, the recipe's name
  verdict,   ///< how measured values are judged: stored values are enough to tell
  slab,      ///< how the slab's items follow from measured seats: stored seats are enough
  measured,  ///< what is measured on a block, or its U: only the scans can tell
};
[[nodiscard]] std::string_view name(KeyEffect effect);

struct RecipeKey {
  std::string key;    ///< "block.jaw_angle_deg", "items.seat_slope.upper", "guard"
  std::string value;  ///< every digit; "-" where there is none
  KeyEffect effect = KeyEffect::none;
};
/// Everything a recipe says, always the same keys in the same order. Angles in degrees.
[[nodiscard]] std::vector<RecipeKey> keys_of(const Recipe& recipe);

}  // namespace slabd::daemon
