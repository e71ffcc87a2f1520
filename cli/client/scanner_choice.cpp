// SPDX-License-Identifier: Apache-2.0
#include "cli/client/scanner_choice.h"

#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/say.h"

namespace slabd::cli {

void ScannerChoice::add_to(args::Command& command) {
  command.add_option(option, id, "Id of the scanner, on a line with two ([[scanner]] id)");
}

std::size_t ScannerChoice::arm(const config::Config& config) const {
  std::string ids;
  for (std::size_t arm = 0; arm < config.arms.list.size(); ++arm) {
    const std::string scanner = scanner_of_arm(config, arm);
    if (scanner == id || (id.empty() && !config.arms.several())) return arm;
    ids += (ids.empty() ? "" : ", ") + scanner;
  }
  stop(kUsage, id.empty() ? say("{} is missing: this line has the scanners {}", option, ids)
                          : say("{} {}: this line has no such scanner, only {}", option, id, ids));
}

config::Config ScannerChoice::of(config::Config config) const {
  const config::ArmSettings chosen = config.arm(arm(config));
  static_cast<config::ArmSettings&>(config) = chosen;
  return config;
}

std::string id_if_several(const config::Config& config) {
  return config.arms.several() ? std::string(config.by.scanner.view()) : std::string();
}

std::string scanner_of_arm(const config::Config& config, std::size_t arm) {
  return std::string(config.arms.list[arm].scanner.view());
}

}  // namespace slabd::cli
