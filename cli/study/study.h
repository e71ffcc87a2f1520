// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "base/recipe.h"
#include "cli/client/scanner_choice.h"
#include "cli/exit.h"
#include "cli/study/source.h"
#include "cli/study/statistics.h"
#include "cli/terminal/parse.h"

namespace slabd::cli::args {
class Command;
}  // namespace slabd::cli::args

/// The subcommands of `slabctl study`.
namespace slabd::cli::study {

void add_repeat(args::Command& study);
void add_grr(args::Command& study);
void add_compare(args::Command& study);

/// Options for measuring scans.
struct ScanOptions {
  std::string recipe;
  ScanFormOptions form;
  int threads = 1;
  void add_to(args::Command& command);
  /// Stops if the recipe is missing or invalid.
  [[nodiscard]] Recipe load() const;
};

/// Adds --same-part WHY.
void add_same_part(args::Command& command, std::string& why);

/// 0 if capable or not judged, otherwise 1.
[[nodiscard]] Exit exit_of(Judgement judgement);

struct Assignment {
  std::string item;
  double value = 0.0;
};
/// Parses "item=value"; stops if it is invalid or does not name an item.
[[nodiscard]] Assignment parse_assignment(const std::string& option, const std::string& text);

// Repeats on the running line, through the daemon.

struct LiveOrder {
  std::string config;  ///< the daemon's configuration
  int station = 0;     ///< the block under the scanner
  std::size_t count = 0;
  bool enter = false;  ///< waits for a line on stdin before every scan: the robot leaves and returns
  int threads = 1;
  ScannerChoice scanner;
};
/// The daemon goes to maintenance, takes the scans while the robot is at rest, and returns to idle, also after a
/// rejected scan. No results go to the PLC or the database. Stops if the daemon is not available, a shot was rejected,
/// or the first scan does not contain a block.
[[nodiscard]] std::vector<MeasuredOnce> live_measurements(const LiveOrder& order, const Recipe& recipe);

}  // namespace slabd::cli::study
