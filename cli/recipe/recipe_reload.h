// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace slabd::args {
class Command;
}  // namespace slabd::args

namespace slabd::cli {

/// `slabctl recipe reload`, below the command `recipe`.
void add_recipe_reload(args::Command& recipe);

}  // namespace slabd::cli
