// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>

#include "cli/command.h"
#include "cli/scanner/scanner.h"

namespace slabd::cli {

void add_scanner(CLI::App& app, int& exit_status) {
  CLI::App* scanner = app.add_subcommand("scanner", "The scanner: send a scan as a gateway does, verify its accuracy");
  scanner->require_subcommand(1);
  add_scanner_send(*scanner, exit_status);
  add_scanner_verify(*scanner, exit_status);
  add_scanner_history(*scanner, exit_status);
}

}  // namespace slabd::cli
