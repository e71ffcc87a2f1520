// SPDX-License-Identifier: Apache-2.0

#include "cli/scanner/scanner.h"
#include "cli/command.h"
#include "cli/terminal/arguments.h"

namespace slabd::cli {

void add_scanner(args::Command& app) {
  args::Command scanner =
      app.add_subcommand("scanner", "The scanner: send a scan as a gateway does, verify its accuracy");
  scanner->require_subcommand(1);
  add_scanner_send(*scanner);
  add_scanner_verify(*scanner);
  add_scanner_history(*scanner);
}

}  // namespace slabd::cli
