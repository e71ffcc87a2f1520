// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace CLI {
class App;
}

namespace slabd::cli {

/// `slabctl pin` and `slabctl unpin`, as the commands of cli/command.h.
void add_pin(CLI::App& app, int& exit_status);

}  // namespace slabd::cli
