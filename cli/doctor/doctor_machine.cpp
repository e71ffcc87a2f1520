// SPDX-License-Identifier: Apache-2.0
#include <fmt/core.h>
#include <sys/resource.h>
#include <sys/timex.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "algo/algo.h"
#include "base/limits.h"
#include "cli/client/control.h"
#include "cli/doctor/doctor.h"
#include "cli/terminal/say.h"

namespace slabd::cli {
namespace {

std::string first_line(const std::string& path) {
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  return line;
}

/// Value of "MemAvailable" and similar keys in bytes; 0 if missing.
std::uint64_t memory(const std::string& key) {
  std::ifstream file("/proc/meminfo");
  std::string line;
  while (std::getline(file, line))
    if (line.rfind(key + ":", 0) == 0) return 1024 * std::strtoull(line.c_str() + key.size() + 1, nullptr, 10);
  return 0;
}

void examine_memory(const config::Config& config, Examination& report) {
  const std::uint64_t takes = limits::inspection_bytes(config.arms.list.size());
  const std::uint64_t needed = 2 * takes;
  const std::uint64_t total = memory("MemTotal");
  const std::uint64_t available = memory("MemAvailable");
  const std::string saw =
      say("{:.1f} GB, {:.1f} GB available; inspection takes {:.2f} GB", static_cast<double>(total) / 1e9,
          static_cast<double>(available) / 1e9, static_cast<double>(takes) / 1e9);
  if (available < needed)
    report.failed("memory", saw, say("end other programs, or give the computer more memory"));
  else
    report.ok("memory", saw);
}

}  // namespace

void examine_machine(const config::Config& config, Examination& report) {
  const unsigned cores = std::thread::hardware_concurrency();
  const std::string set(algo::instruction_set());
  const std::string saw = say("{} cores, kernels for {}, {} of them measure", cores, set, config.measure_threads);
  if (set == "SSE2" || set == "SCALAR" || set == "EMU128")
    report.warning("processor", saw, say("without SSE4 or AVX2 a block takes several times as long"));
  else if (static_cast<int>(cores) < config.measure_threads)
    report.warning("processor", saw, "[measure] threads = 1");
  else
    report.ok("processor", saw);

  const std::string governor = first_line("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor");
  if (governor == "powersave")
    report.note("processor", say("the processor saves power: a block takes longer after a pause"),
                "cpupower frequency-set -g performance");
  examine_memory(config, report);
  const std::string pages = first_line("/sys/kernel/mm/transparent_hugepage/enabled");
  if (pages.find("[never]") != std::string::npos)
    report.note("huge pages", say("switched off: reading a scan takes longer"),
                "echo madvise > /sys/kernel/mm/transparent_hugepage/enabled");
}

void examine_limits(const config::Config& config, Examination& report) {
  const std::int64_t pid = daemon_process(config.control_socket);
  std::ifstream file(fmt::format("/proc/{}/limits", pid));
  if (pid == 0 || !file)
    return report.unknown("limits", say("those of the daemon cannot be read"), say("as root: slabctl doctor"));
  struct Need {
    const char* name;  ///< as named by the kernel
    std::uint64_t least;
    const char* unit;
    const char* cure;
  };
  // Required limits: a scan of 6 million points as PLY, or a database of some ten thousand slabs; sockets, files and a
  // reserve; the buffers and the process itself.
  const std::array needs = {
      Need{"Max file size", std::uint64_t{100} << 30U, marked("bytes"),
           marked("LimitFSIZE=infinity in the unit, or ulimit -f unlimited")},
      Need{"Max open files", 256, marked("files"), marked("LimitNOFILE=1024 in the unit")},
      Need{"Max address space", 4 * std::uint64_t{limits::inspection_bytes(config.arms.list.size())}, marked("bytes"),
           marked("LimitAS=infinity in the unit, or twice what slabctl status shows as memory")}};
  std::string line;
  bool all = true;
  std::size_t found = 0;
  while (std::getline(file, line))
    for (const Need& need : needs) {
      if (line.rfind(need.name, 0) != 0) continue;
      ++found;
      const std::string soft = line.substr(std::string_view(need.name).size());
      const std::size_t at = soft.find_first_not_of(' ');
      if (at == std::string::npos || soft.compare(at, 9, "unlimited") == 0) continue;
      const std::uint64_t allowed = std::strtoull(soft.c_str() + at, nullptr, 10);
      if (allowed >= need.least) continue;
      all = false;
      report.failed("limits", say("{}: {} {}, needed {}", need.name, allowed, translated(need.unit), need.least),
                    std::string(translated(need.cure)));
    }
  if (found != needs.size())
    return report.unknown("limits", say("the kernel lists them in a form this slabctl does not know"));
  if (all) report.ok("limits", say("file size, open files and address space suffice"));
}

void examine_clock(Examination& report) {
  timex state{};
  const int answer = ::adjtimex(&state);
  if (answer < 0) {
    report.unknown("clock", say("the kernel does not tell whether it is synchronised"));
  } else if (answer == TIME_ERROR || (state.status & STA_UNSYNC) != 0) {
    report.warning("clock", say("not synchronised: times in records are this computer's own"),
                   say("set up NTP (timedatectl set-ntp true, or chrony with the plant's server)"));
  } else {
    report.ok("clock", say("synchronised, within {:.1f} ms", static_cast<double>(state.maxerror) / 1e3));
  }
}

/// Inode of the UDP socket on a local port, as "socket:[N]"; empty if there is none.
static std::string udp_socket(unsigned port) {
  const std::string wanted = fmt::format(":{:04X}", port);
  // The kernel gives the table in pages and may skip a line when sockets close between two of them: the second or third
  // reading has it.
  for (int reading = 0; reading < 3; ++reading) {
    std::ifstream sockets("/proc/net/udp");
    for (std::string line; std::getline(sockets, line);) {
      std::istringstream words(line);
      const std::vector<std::string> columns{std::istream_iterator<std::string>(words), {}};
      if (columns.size() > 9 && columns[1].ends_with(wanted)) return "socket:[" + columns[9] + "]";
    }
  }
  return "";
}

std::string udp_program(unsigned port) {
  namespace fs = std::filesystem;
  const std::string socket = udp_socket(port);
  if (socket.empty()) return "";
  std::error_code fault;
  for (fs::directory_iterator process("/proc", fault), end; !fault && process != end; process.increment(fault)) {
    // "self" is this program, which may have inherited a socket from the one that started it.
    const std::string pid = process->path().filename();
    if (pid.find_first_not_of("0123456789") != std::string::npos || pid == std::to_string(::getpid())) continue;
    // A process that ends in the meantime is passed over.
    std::error_code ended;
    for (fs::directory_iterator file(process->path() / "fd", ended), last; !ended && file != last;
         file.increment(ended)) {
      if (fs::read_symlink(file->path(), ended) != socket) {
        ended.clear();
        continue;
      }
      std::ifstream comm(process->path() / "comm");
      std::string name;
      std::getline(comm, name);
      return fmt::format("{} (pid {})", name, pid);
    }
  }
  return "";
}

}  // namespace slabd::cli
