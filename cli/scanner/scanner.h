// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace slabd::args {
class Command;
}  // namespace slabd::args

/// The subcommands of `slabctl scanner`, a file each.
namespace slabd::cli {

void add_scanner_send(args::Command& scanner);
void add_scanner_verify(args::Command& scanner);
void add_scanner_history(args::Command& scanner);

}  // namespace slabd::cli
