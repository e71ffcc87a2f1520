// SPDX-License-Identifier: Apache-2.0
#include <fmt/core.h>
#include <sys/resource.h>
#include <sys/timex.h>

#include <algorithm>
#include <fstream>
#include <string>
#include <thread>

#include "algo/algo.h"
#include "base/limits.h"
#include "cli/doctor/doctor.h"

namespace slabd::cli {
namespace {

std::string first_line(const std::string& path) {
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  return line;
}

/// "MemAvailable" and the like, bytes; 0 where there is none.
std::uint64_t memory(const std::string& key) {
  std::ifstream file("/proc/meminfo");
  std::string line;
  while (std::getline(file, line))
    if (line.rfind(key + ":", 0) == 0) return 1024 * std::strtoull(line.c_str() + key.size() + 1, nullptr, 10);
  return 0;
}

void examine_memory(Examination& report) {
  const std::uint64_t needed = 2 * static_cast<std::uint64_t>(limits::kInspectionBytes);
  const std::uint64_t total = memory("MemTotal");
  const std::uint64_t available = memory("MemAvailable");
  const std::string saw =
      fmt::format("{:.1f} GB, {:.1f} GB available; inspection takes {:.2f} GB", static_cast<double>(total) / 1e9,
                  static_cast<double>(available) / 1e9, static_cast<double>(limits::kInspectionBytes) / 1e9);
  if (available < needed)
    report.failed("memory", saw, "end other programs, or give the computer more memory");
  else
    report.ok("memory", saw);
}

}  // namespace

void examine_machine(const daemon::Config& config, Examination& report) {
  const unsigned cores = std::thread::hardware_concurrency();
  const std::string set(algo::instruction_set());
  const std::string saw =
      fmt::format("{} cores, kernels for {}, {} of them measure", cores, set, config.measure_threads);
  if (set == "SSE2" || set == "SCALAR" || set == "EMU128")
    report.warning("processor", saw, "without SSE4 or AVX2 a block takes several times as long");
  else if (static_cast<int>(cores) < config.measure_threads)
    report.warning("processor", saw, "[measure] threads = 1");
  else
    report.ok("processor", saw);

  const std::string governor = first_line("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor");
  if (governor == "powersave")
    report.note("processor", "the processor saves power: a block takes longer after a pause",
                "cpupower frequency-set -g performance");
  examine_memory(report);
  const std::string pages = first_line("/sys/kernel/mm/transparent_hugepage/enabled");
  if (pages.find("[never]") != std::string::npos)
    report.note("huge pages", "switched off: reading a scan takes longer",
                "echo madvise > /sys/kernel/mm/transparent_hugepage/enabled");
}

void examine_clock(Examination& report) {
  timex state{};
  const int answer = ::adjtimex(&state);
  if (answer < 0) {
    report.unknown("clock", "the kernel does not tell whether it is synchronised");
  } else if (answer == TIME_ERROR || (state.status & STA_UNSYNC) != 0) {
    report.warning("clock", "not synchronised: times in records are this computer's own",
                   "set up NTP (timedatectl set-ntp true, or chrony with the plant's server)");
  } else {
    report.ok("clock", fmt::format("synchronised, within {:.1f} ms", static_cast<double>(state.maxerror) / 1e3));
  }
}

}  // namespace slabd::cli
