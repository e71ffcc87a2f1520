// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

/// Times measured on a machine with other load.
///
/// A sample is disturbed if the kernel preempted it (an involuntary context switch). It is also disturbed if wall and
/// CPU time of a single thread differ by more than a twentieth. The figure is the median of the undisturbed samples;
/// the minimum is reported as well. If too few samples are undisturbed, the figure is the CPU time for one thread and
/// the minimum for two, and `basis` names it.
namespace slabd::bench {

struct Sample {
  double wall_ms = 0.0;
  double cpu_ms = 0.0;  ///< of all threads of the process
  bool disturbed = false;
};

struct Figure {
  double ms = 0.0;      ///< reported value
  double min_ms = 0.0;  ///< of the wall times
  double cpu_ms = 0.0;  ///< median of the CPU times
  std::size_t samples = 0;
  std::size_t disturbed = 0;
  const char* basis = "";  ///< "wall", "cpu" or "min wall": the quantity in `ms`
};

/// Figure of the samples. Requires at least one.
[[nodiscard]] Figure figure_of(const std::vector<Sample>& samples, int threads);

/// Wall and CPU clocks around a piece of work, laps between them.
class Stopwatch {
 public:
  Stopwatch() { restart(); }
  void restart();
  /// Sample since the last lap, restart or construction.
  [[nodiscard]] Sample lap(int threads);
  /// Sample since `restart` or construction.
  [[nodiscard]] Sample total(int threads) const;

 private:
  struct Instant {
    double wall_ms;
    double cpu_ms;
    long switches;
  };
  [[nodiscard]] static Instant now();
  [[nodiscard]] static Sample between(const Instant& from, const Instant& to, int threads);
  Instant start_{};
  Instant lap_{};
};

/// Samples by name; names are "what/how/threads", for example "block/organised/1".
using Samples = std::map<std::string, std::vector<Sample>>;

}  // namespace slabd::bench
