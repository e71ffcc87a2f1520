// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace slabd::cli {

struct SlurmJob {
  std::string program;               ///< path of slabctl
  std::vector<std::string> options;  ///< of slabctl replay, without --shard and --out
  std::string out;
  int shards = 1;
  int threads = 1;
};
/// Largest number of tasks with Slurm's default MaxArraySize of 1001.
inline constexpr int kSlurmTasksMax = 1'000;
/// Batch script for sbatch: a task for each shard. Stops if a word contains a line break, which a comment of the script
/// cannot contain.
[[nodiscard]] std::string slurm_script(const SlurmJob& job);

}  // namespace slabd::cli
