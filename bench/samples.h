// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

/// Times taken on a machine that others use too.
///
/// A sample knows whether it was disturbed: whether the kernel took the core away while it ran (an involuntary context
/// switch), or wall and CPU time of a single thread differ by more than a twentieth. Undisturbed samples give the
/// median; the minimum stands beside it. Where too few are left, a single thread is told by its CPU time and two
/// threads by their minimum, and the figure says so.
namespace slabd::bench {

struct Sample {
  double wall_ms = 0.0;
  double cpu_ms = 0.0;  ///< of all threads of the process
  bool disturbed = false;
};

struct Figure {
  double ms = 0.0;      ///< what is reported
  double min_ms = 0.0;  ///< of the wall times
  double cpu_ms = 0.0;  ///< median of the CPU times
  std::size_t samples = 0;
  std::size_t disturbed = 0;
  const char* basis = "";  ///< "wall", "cpu" or "min wall": what `ms` is the median, or the minimum, of
};

/// Needs at least one sample.
[[nodiscard]] Figure figure_of(const std::vector<Sample>& samples, int threads);

/// Wall and CPU clocks around a piece of work, laps between them.
class Stopwatch {
 public:
  Stopwatch() { restart(); }
  void restart();
  /// Since the last lap, restart or construction.
  [[nodiscard]] Sample lap(int threads);
  /// Since `restart` or construction.
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

/// Samples by name; names are "what/how/threads", as in "block/organised/1".
using Samples = std::map<std::string, std::vector<Sample>>;

}  // namespace slabd::bench
