// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "base/recipe.h"
#include "config/toml_reader.h"

namespace slabd::daemon {

/// Relations between numbers of a recipe that are each in range: the evaluation region must lie on the bearing plane,
/// the pairs on the slab, the tables of the measuring workspace must be large enough, limits must enclose nominals,
/// and an item's nominal must agree with the geometry it follows from. Reports through `root`, the recipe's top table.
void check_relations(TableReader& root, const Recipe& recipe);

}  // namespace slabd::daemon
