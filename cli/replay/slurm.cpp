// SPDX-License-Identifier: Apache-2.0
#include "cli/replay/slurm.h"

#include <fmt/core.h>

#include <string_view>

#include "cli/exit.h"

namespace slabd::cli {
namespace {

/// The word as the shell reads it back.
std::string shell_word(const std::string& word) {
  constexpr std::string_view kPlain = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-./:,=+@%";
  if (word.find('\n') != std::string::npos)
    stop(kUsage, "a word of the command contains a line break; the batch script cannot contain it");
  if (!word.empty() && word.find_first_not_of(kPlain) == std::string::npos) return word;
  std::string quoted = "'";
  for (const char c : word) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

// A task needs 100 to 200 MB: one scan in memory and the measuring workspace. Slurm ends a task that needs more than
// --mem. --requeue starts a task again after the loss of its node, not after the end of its process.
constexpr const char* kScript = R"(#!/bin/bash
# Measures stored slabs again in {count} shards. Submit with: sbatch FILE
#SBATCH --job-name=slabd-replay
#SBATCH --array=0-{last}
#SBATCH --cpus-per-task={threads}
#SBATCH --mem=400M
#SBATCH --nice=1000
#SBATCH --requeue
# The network is slower than the processors, so run the tasks where the scans are. Give the nodes that store them a
# feature in slurm.conf (Feature=spool_line1), and remove one # from the next line:
##SBATCH --constraint=spool_line1
exec {command} --shard $((SLURM_ARRAY_TASK_ID + 1))/{count} --out {out}

# After the end of all tasks, on any machine that reads the folder:
#   {program} replay --merge {out}
# If slabs are missing, submit this script again: finished slabs are not measured again.
)";

}  // namespace

std::string slurm_script(const SlurmJob& job) {
  const std::string program = shell_word(job.program);
  std::string command = program + " replay";
  for (const std::string& option : job.options) command += " " + shell_word(option);
  return fmt::format(kScript, fmt::arg("count", job.shards), fmt::arg("last", job.shards - 1),
                     fmt::arg("threads", job.threads), fmt::arg("command", command), fmt::arg("program", program),
                     fmt::arg("out", shell_word(job.out)));
}

}  // namespace slabd::cli
