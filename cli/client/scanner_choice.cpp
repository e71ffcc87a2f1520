// SPDX-License-Identifier: Apache-2.0
#include "cli/client/scanner_choice.h"

#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/say.h"

namespace slabd::cli {

void ScannerChoice::add_to(args::Command& command, const std::string& option) {
  option_ = option;
  command.add_option(option, id, "Id of the scanner, on a line with two ([[scanner]] id)");
}

std::size_t ScannerChoice::arm(const config::Config& config) const {
  std::string ids;
  for (std::size_t arm = 0; arm < config.arms.list.size(); ++arm) {
    const std::string scanner = scanner_of_arm(config, arm);
    if (scanner == id || (id.empty() && !config.arms.several())) return arm;
    ids += (ids.empty() ? "" : ", ") + scanner;
  }
  stop(kUsage, id.empty() ? say("{} is missing: this line has the scanners {}", option_, ids)
                          : say("{} {}: this line has no such scanner, only {}", option_, id, ids));
}

std::string ScannerChoice::scanner(const config::Config& config) const {
  return scanner_of_arm(config, arm(config));
}

std::string scanner_of_arm(const config::Config& config, std::size_t arm) {
  return std::string(config.arms.list[arm].scanner.view());
}

}  // namespace slabd::cli
