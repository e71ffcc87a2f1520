// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace CLI {
class App;
}

namespace slabd::cli {

/// `slabctl export`, as the commands of cli/command.h.
void add_export(CLI::App& app, int& exit_status);

}  // namespace slabd::cli
