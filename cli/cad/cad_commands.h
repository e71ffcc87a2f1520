// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "base/design.h"
#include "cli/cad/model_order.h"

namespace slabd::cli::args {
class Command;
}  // namespace slabd::cli::args

namespace slabd::cli {

/// True if the name ends in .step, .stp, .iges or .igs, in upper or lower case.
[[nodiscard]] bool is_cad_file(const std::string& path);

/// Writes the recipe's model as STEP or IGES and prints its faces and volume. Stops if it cannot. `ap214`: STEP AP214
/// instead of AP242.
void export_cad(const Recipe& recipe, const SlabDesign& design, const ModelChoice& choice, bool ap214,
                const std::string& path);

/// Add `slabctl recipe from-cad`, `recipe drafts` and `recipe from-scan` to the command `recipe`.
void add_recipe_from_cad(args::Command& recipe);
void add_recipe_drafts(args::Command& recipe);
void add_recipe_from_scan(args::Command& recipe);

}  // namespace slabd::cli
