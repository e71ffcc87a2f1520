// SPDX-License-Identifier: Apache-2.0
#include "bench/samples.h"

#include <sys/resource.h>

#include <algorithm>
#include <cassert>
#include <chrono>
#include <ctime>

namespace slabd::bench {
namespace {

constexpr std::size_t kUndisturbedMin = 3;
constexpr double kWallOverCpuMax = 1.05;

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t middle = values.size() / 2;
  return values.size() % 2 == 1 ? values[middle] : 0.5 * (values[middle - 1] + values[middle]);
}

}  // namespace

Figure figure_of(const std::vector<Sample>& samples, int threads) {
  assert(!samples.empty());
  std::vector<double> wall, cpu, quiet;
  for (const Sample& sample : samples) {
    wall.push_back(sample.wall_ms);
    cpu.push_back(sample.cpu_ms);
    if (!sample.disturbed) quiet.push_back(sample.wall_ms);
  }
  Figure figure;
  figure.samples = samples.size();
  figure.disturbed = samples.size() - quiet.size();
  figure.min_ms = *std::min_element(wall.begin(), wall.end());
  figure.cpu_ms = median(cpu);
  if (quiet.size() >= std::min(kUndisturbedMin, samples.size())) {
    figure.ms = median(quiet);
    figure.basis = "wall";
  } else if (threads == 1) {
    figure.ms = figure.cpu_ms;
    figure.basis = "cpu";
  } else {
    figure.ms = figure.min_ms;
    figure.basis = "min wall";
  }
  return figure;
}

Stopwatch::Instant Stopwatch::now() {
  timespec cpu{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &cpu);
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto wall = std::chrono::steady_clock::now().time_since_epoch();
  return {std::chrono::duration<double, std::milli>(wall).count(),
          1e3 * static_cast<double>(cpu.tv_sec) + 1e-6 * static_cast<double>(cpu.tv_nsec), usage.ru_nivcsw};
}

Sample Stopwatch::between(const Instant& from, const Instant& to, int threads) {
  Sample sample{to.wall_ms - from.wall_ms, to.cpu_ms - from.cpu_ms, to.switches != from.switches};
  if (threads == 1 && sample.wall_ms > kWallOverCpuMax * sample.cpu_ms) sample.disturbed = true;
  return sample;
}

void Stopwatch::restart() {
  start_ = lap_ = now();
}

Sample Stopwatch::lap(int threads) {
  const Instant at = now();
  const Sample sample = between(lap_, at, threads);
  lap_ = now();
  return sample;
}

Sample Stopwatch::total(int threads) const {
  return between(start_, now(), threads);
}

}  // namespace slabd::bench
