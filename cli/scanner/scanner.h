// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "daemon/daemon.h"

namespace CLI {
class App;
}

/// The subcommands of `slabctl scanner`, a file each.
namespace slabd::cli {

void add_scanner_send(CLI::App& scanner, int& exit_status);
void add_scanner_verify(CLI::App& scanner, int& exit_status);
void add_scanner_history(CLI::App& scanner, int& exit_status);

/// Where verifications are kept: a folder beside the database.
[[nodiscard]] std::string scanner_records(const daemon::Config& config);

}  // namespace slabd::cli
