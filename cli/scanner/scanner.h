// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace CLI {
class App;
}

/// The subcommands of `slabctl scanner`, a file each.
namespace slabd::cli {

void add_scanner_send(CLI::App& scanner, int& exit_status);
void add_scanner_verify(CLI::App& scanner, int& exit_status);
void add_scanner_history(CLI::App& scanner, int& exit_status);

}  // namespace slabd::cli
