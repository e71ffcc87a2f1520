// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "bench/samples.h"
#include "bench/scene.h"

namespace slabd::bench {

struct StageOptions {
  std::string folder;  ///< contains the scan files of bench/scene.h
  bool quick = false;  ///< fewer repetitions, no growth
  std::string filter;  ///< regular expression on names; empty: all stages
};

/// Registers every stage with Google Benchmark and stores its samples in `samples`. Call once. The scene and the scans
/// drawn here remain in memory until the process ends.
void register_stages(const StageOptions& options, const Recipe& recipe, const Scene& scene, const Scan& organised,
                     Samples& samples);

/// Runs all stages once, their repetitions in random order, so that other load affects all stages equally.
void run_stages(const StageOptions& options);

/// Instruction sets of this machine that slabd has code for, best first.
[[nodiscard]] std::vector<std::string> instruction_sets();

}  // namespace slabd::bench
