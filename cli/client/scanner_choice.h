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
  std::string id{};                  ///< empty: the only scanner of the line
  std::string option = "--scanner";  ///< another one in commands in which --scanner means something else

  void add_to(args::Command& command);
  /// Index of its arm. Stops if the line has no such scanner, or if it has two and none is named.
  [[nodiscard]] std::size_t arm(const config::Config& config) const;
  /// The configuration for a command about this scanner: the settings of its arm in the place of those of arm 0, so
  /// that `by` names it. Stops as arm().
  [[nodiscard]] config::Config of(config::Config config) const;
};

/// Id of the scanner `config.by` for a request to the daemon; empty on a line with one.
[[nodiscard]] std::string id_if_several(const config::Config& config);

/// Id of an arm's scanner, as records contain it.
[[nodiscard]] std::string scanner_of_arm(const config::Config& config, std::size_t arm);

}  // namespace slabd::cli
