// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace CLI {
class App;
}

namespace slabd::cli {

/// `slabctl recipe reload`, below the command `recipe`.
void add_recipe_reload(CLI::App& recipe, int& exit_status);

}  // namespace slabd::cli
