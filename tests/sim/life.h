// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "base/recipe.h"
#include "tests/sim/faults.h"

/// One life of a line: slabd with its real station, loop, storage, register map and decoders on simulated ports and a
/// simulated clock, some hundred seconds long, in which everything goes wrong that a seed can think of.
namespace slabd::sim {

struct LifeResult {
  std::uint64_t hash = 0;  ///< of everything that happened
  std::string violation;   ///< empty: every promise was kept
  std::vector<std::string> last_lines;
  Totals totals;
};

/// The recipes a life may use: a short slab first, then the whole one.
[[nodiscard]] std::vector<Recipe> life_recipes();

/// Lives `seed` in the working folder, which must be this process's own. `loud`: every line of the trace goes to
/// stdout.
[[nodiscard]] LifeResult live(std::uint64_t seed, const std::vector<Recipe>& recipes, bool loud);

/// Changes into a new folder in memory; its name. Once for each process.
std::string enter_own_folder();

}  // namespace slabd::sim
