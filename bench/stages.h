// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "bench/samples.h"
#include "bench/scene.h"

namespace slabd::bench {

struct StageOptions {
  std::string folder;  ///< with the scan files of bench/scene.h
  bool quick = false;  ///< fewer repetitions, no growth
  std::string filter;  ///< regular expression on names; empty: all
};

/// Registers every stage with Google Benchmark; what it measures goes to `samples`. Call once. The scene and the scans
/// drawn here stay in memory to the end of the process.
void register_stages(const StageOptions& options, const Recipe& recipe, const Scene& scene, const Scan& organised,
                     Samples& samples);

/// Runs all of them once, one repetition here, one there, in random order, so that a busy minute falls on everybody.
void run_stages(const StageOptions& options);

/// The instruction sets of this machine that slabd has code for, best first.
[[nodiscard]] std::vector<std::string> instruction_sets();

}  // namespace slabd::bench
