// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>

#include "config/config.h"

namespace slabd::cli::args {
class Command;
}  // namespace slabd::cli::args

namespace slabd::cli {

/// The option that names the scanner of a command that concerns one scanner.
struct ScannerChoice {
  std::string id;  ///< empty: the only scanner of the line

  /// `option`: its name, for commands in which --scanner means something else.
  void add_to(args::Command& command, const std::string& option = "--scanner");
  /// Index of its arm. Stops if the line has no such scanner, or if it has two and none is named.
  [[nodiscard]] std::size_t arm(const config::Config& config) const;
  /// Id of the scanner; stops as arm().
  [[nodiscard]] std::string scanner(const config::Config& config) const;

 private:
  std::string option_ = "--scanner";
};

/// Id of an arm's scanner, as records contain it.
[[nodiscard]] std::string scanner_of_arm(const config::Config& config, std::size_t arm);

}  // namespace slabd::cli
