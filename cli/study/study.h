// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "base/recipe.h"
#include "cli/exit.h"
#include "cli/study/source.h"
#include "cli/study/statistics.h"
#include "cli/terminal/parse.h"

namespace slabd::args {
class Command;
}  // namespace slabd::args

/// The verbs of `slabctl study`.
namespace slabd::cli::study {

void add_repeat(args::Command& study);
void add_grr(args::Command& study);
void add_compare(args::Command& study);

/// How scans are to be measured.
struct ScanOptions {
  std::string recipe;
  ScanFormOptions form;
  int threads = 1;
  void add_to(args::Command& command);
  /// Stops if there is no recipe or a wrong one.
  [[nodiscard]] Recipe load() const;
};

/// --same-part WHY.
void add_same_part(args::Command& command, std::string& why);

/// 0 capable or nothing judged, 1 else.
[[nodiscard]] Exit exit_of(Judgement judgement);

struct Assignment {
  std::string item;
  double value = 0.0;
};
/// "item=value"; stops if it is none or names no item.
[[nodiscard]] Assignment parse_assignment(const std::string& option, const std::string& text);

// Repeats on the running line, through the daemon.

struct LiveOrder {
  std::string config;  ///< the daemon's
  int station = 0;     ///< the block that the robot stands over
  std::size_t count = 0;
  bool enter = false;  ///< wait for a line on stdin before every scan: the robot goes away and comes back
  int threads = 1;
};
/// The daemon goes to maintenance, takes the scans while the robot stands, and goes back to idle, also when one is
/// refused. Takes nothing from the PLC's results and stores none. Stops if the daemon is not there or busy, a shot was
/// refused, or no block is found in the first scan.
[[nodiscard]] std::vector<Take> live_takes(const LiveOrder& order, const Recipe& recipe);

}  // namespace slabd::cli::study
