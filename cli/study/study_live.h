// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "cli/study/source.h"

/// Repeats on the running line, through the daemon.
namespace slabd::cli::study {

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
