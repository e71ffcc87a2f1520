// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace slabd::args {
class Command;
}  // namespace slabd::args

/// The subcommands of `slabctl scanner`, a file each.
namespace slabd::cli {

void add_scanner_send(args::Command& scanner, int& exit_status);
void add_scanner_verify(args::Command& scanner, int& exit_status);
void add_scanner_history(args::Command& scanner, int& exit_status);

}  // namespace slabd::cli
