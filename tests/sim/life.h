// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "base/recipe.h"
#include "tests/sim/faults.h"

/// One life of a line, some hundred seconds long, with all kinds of faults drawn from a seed. slabd has its real
/// station, loop, storage, register map and decoders, on simulated ports and a simulated clock.
namespace slabd::sim {

struct LifeResult {
  std::uint64_t hash = 0;  ///< of all events
  std::string violation;   ///< empty: all promises were kept
  std::vector<std::string> last_lines;
  Totals totals;
};

/// The recipes of a life: a short slab first, then the full one.
[[nodiscard]] std::vector<Recipe> life_recipes();

/// Runs the life `seed` in the working folder, which must belong to this process only. `loud`: every line of the trace
/// is written to stdout. `robots`: 1 or 2, each with a scanner.
[[nodiscard]] LifeResult live(std::uint64_t seed, const std::vector<Recipe>& recipes, bool loud, int robots = 1);

/// Changes into a new folder in memory and returns its name. Once for each process.
std::string enter_own_folder();

}  // namespace slabd::sim
