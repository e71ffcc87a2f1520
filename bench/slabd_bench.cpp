// SPDX-License-Identifier: Apache-2.0
//
// The driver: draws the scan, runs the stages with Google Benchmark and every program of the comparison on the same
// scan, and prints one report. It works in rounds, so that floors, stages and peers share the same minutes of the
// machine.
#include <fmt/chrono.h>
#include <fmt/core.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <thread>

#include "bench/floor.h"
#include "bench/report.h"
#include "bench/stages.h"
#include "tests/accuracy/block_scan.h"

namespace slabd::bench {
namespace {

namespace fs = std::filesystem;

struct Options {
  bool json = false;
  bool markdown = false;
  bool peers = false;
  bool quick = false;
  int rounds = 3;
  std::string filter;
  std::string revision = "unknown";
  std::string save;
  std::string growth;
  std::vector<std::string> lines;
};

/// A folder for the scan files (60 to 140 MB each) in $TMPDIR or /tmp, deleted at exit. Warm files are read from the
/// page cache.
class ScanFolder {
 public:
  ScanFolder() {
    std::string pattern = (fs::temp_directory_path() / "slabd_bench.XXXXXX").string();
    if (mkdtemp(pattern.data()) != nullptr) path_ = pattern;
  }
  ~ScanFolder() {
    std::error_code ignored;
    if (!path_.empty()) fs::remove_all(path_, ignored);
  }
  ScanFolder(const ScanFolder&) = delete;
  ScanFolder& operator=(const ScanFolder&) = delete;
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  std::string path_;
};

struct PeerJob {
  const char* program;
  const char* job;
  int repeats;
  int threads;
  bool first_round_only;  ///< takes at least ten seconds
  bool library;           ///< needs the packages of bench/apt-packages-peers
  bool scored = false;    ///< its errors are compared
};
/// Number of scans, each with another seed, over which errors are computed.
constexpr int kScoredScans = 8;
constexpr PeerJob kPeerJobs[] = {
    {"slabd_peer", "block", 5, 1, false, false, true},     {"slabd_peer", "block-organised", 5, 1, false, false, true},
    {"slabd_peer", "block-organised", 5, 2, false, false}, {"slabd_peer", "denoise", 3, 1, true, false},
    {"slabd_peer", "register", 3, 1, false, false, true},  {"slabd_peer", "plane", 5, 1, false, false, true},
    {"pcl_peer", "block-tuned", 2, 1, false, true, true},  {"pcl_peer", "register", 2, 1, false, true, true},
    {"pcl_peer", "plane", 5, 1, false, true, true},        {"pcl_peer", "plane-refit", 5, 1, false, true, true},
    {"pcl_peer", "block-spec", 1, 1, true, true},          {"open3d_peer", "block-tuned", 2, 1, false, true, true},
    {"open3d_peer", "block-tuned", 2, 2, true, true},      {"open3d_peer", "register", 2, 1, false, true, true},
    {"open3d_peer", "plane", 5, 1, false, true, true},     {"open3d_peer", "plane-refit", 5, 1, false, true, true},
    {"open3d_peer", "block-spec", 1, 1, true, true},       {"cgal_peer", "plane", 2, 1, false, true, true},
    {"cgal_peer", "plane-refit", 2, 1, false, true, true},
};

fs::path own_folder() {
  return fs::read_symlink("/proc/self/exe").parent_path();
}

/// Output of the program on stdout as JSON; nullopt and a message if it fails.
std::optional<Json> run_peer(const PeerJob& job, const std::string& folder, bool count, int repeats) {
  const std::string preload =
      count ? fmt::format("LD_PRELOAD='{}' ", (own_folder() / "libslabd_heap_counter.so").string()) : "";
  const std::string command =
      fmt::format("OMP_NUM_THREADS={} {}'{}' --folder '{}' --job {} --repeats {} --threads {}", job.threads, preload,
                  (own_folder() / "peers" / job.program).string(), folder, job.job, repeats, job.threads);
  fmt::print(stderr, "{} {}{}\n", job.program, job.job, count ? ", counted" : "");
  FILE* pipe = popen(command.c_str(), "r");
  if (pipe == nullptr) return std::nullopt;
  std::string out;
  char piece[4096];
  while (const std::size_t got = std::fread(piece, 1, sizeof piece, pipe)) out.append(piece, got);
  const int status = pclose(pipe);
  // A library may print a line of its own; the program's line is the last.
  const std::size_t begin = out.rfind("{\"peer\"");
  Json json = begin == std::string::npos ? Json() : Json::parse(out.substr(begin), nullptr, false);
  if (status == 0 && json.is_object()) return json;
  fmt::print(stderr, "bench: failed with status {}: {}\n", status, command);
  return std::nullopt;
}

/// Measures errors on other scans of the same scene; false if a scan cannot be written.
bool score_peers(const Options& options, const Recipe& recipe, const std::string& folder, PeerRuns& runs) {
  fs::create_directory(folder);
  for (int i = 1; i <= (options.quick ? 2 : kScoredScans); ++i) {
    fmt::print(stderr, "scan {} for the errors\n", i);
    const Scene scene(recipe, kSeed + static_cast<std::uint64_t>(i));
    if (!scene.write(scene.draw(), folder)) return false;
    for (const PeerJob& job : kPeerJobs) {
      if (!job.scored || (job.library && !options.peers)) continue;
      if (auto run = run_peer(job, folder, false, 1)) runs.push_back(std::move(*run));
    }
  }
  return true;
}

/// Runs the peers; a program that fails is reported and left out.
void run_peers(const Options& options, const std::string& folder, bool first, bool count, PeerRuns& runs) {
  for (const PeerJob& job : kPeerJobs) {
    if (job.library && !options.peers) continue;
    if (job.first_round_only && !first) continue;
    if (options.quick && std::string_view(job.job) == "block-spec") continue;
    // Counted: one block to allocate permanent memory, one to count; a library's slow job counts its only block.
    const int repeats = count ? (job.library ? 1 : 2) : job.repeats;
    if (auto run = run_peer(job, folder, count, repeats)) runs.push_back(std::move(*run));
  }
}

std::string first_value(const char* path, const std::string& key) {
  std::ifstream in(path);
  for (std::string line; std::getline(in, line);) {
    if (line.rfind(key, 0) != 0) continue;
    const std::size_t colon = line.find(':');
    const std::size_t begin = line.find_first_not_of(" \t", colon + 1);
    return begin == std::string::npos ? "" : line.substr(begin);
  }
  return "unknown";
}

std::string load_average() {
  std::ifstream in("/proc/loadavg");
  std::string one, five, fifteen;
  in >> one >> five >> fifteen;
  return fmt::format("{} {} {}", one, five, fifteen);
}

std::string huge_pages() {
  std::ifstream in("/sys/kernel/mm/transparent_hugepage/enabled");
  std::string line;
  std::getline(in, line);
  const std::size_t open = line.find('['), close = line.find(']');
  return open == std::string::npos || close == std::string::npos ? "unknown" : line.substr(open + 1, close - open - 1);
}

Json environment(const Options& options) {
  utsname kernel{};
  uname(&kernel);
  Json json;
  json["date"] = fmt::format("{:%Y-%m-%d %H:%M} UTC", fmt::gmtime(std::time(nullptr)));
  json["processor"] = first_value("/proc/cpuinfo", "model name");
  json["cores"] = std::thread::hardware_concurrency();
  json["cache"] = fmt::format("L1d {} KiB, L2 {} KiB, L3 {} KiB", sysconf(_SC_LEVEL1_DCACHE_SIZE) / 1024,
                              sysconf(_SC_LEVEL2_CACHE_SIZE) / 1024, sysconf(_SC_LEVEL3_CACHE_SIZE) / 1024);
  json["memory"] = first_value("/proc/meminfo", "MemTotal");
  json["kernel"] = fmt::format("{} {}", kernel.sysname, kernel.release);
  json["huge pages"] = huge_pages();
  json["compiler"] = std::string("GCC ") + __VERSION__;
  json["flags"] = SLABD_BENCH_FLAGS;
  json["slabd"] = fmt::format("{} ({})", SLABD_VERSION, options.revision);
  json["instruction sets"] = instruction_sets();
  json["read pass"] = read_pass_registers();
  json["load before"] = load_average();
  return json;
}

/// "PCL 1.13.0", as the programs report it.
std::string versions_of(const PeerRuns& runs) {
  std::set<std::string> versions;
  for (const Json& run : runs)
    if (run["peer"] != "slabd")
      versions.insert(run["peer"].get<std::string>() + " " + run["version"].get<std::string>());
  return fmt::format("{}", fmt::join(versions, ", "));
}

/// Slabs of reports written by `slabctl simulate --json`; null if there are none.
Json slabs_of(const std::vector<std::string>& files) {
  Json slabs;
  for (const std::string& file : files) {
    std::ifstream in(file);
    const Json json = Json::parse(in, nullptr, false);
    if (!json.is_object() || !json.contains("slabs"))
      fmt::print(stderr, "bench: {} holds no report of a simulation\n", file);
    else
      for (const Json& slab : json["slabs"]) slabs.push_back(slab);
  }
  return slabs;
}

/// Stages of a stored report; null if there is none.
Json stages_of(const std::string& file) {
  std::ifstream in(file);
  const Json json = Json::parse(in, nullptr, false);
  if (json.is_object() && json.contains("stages")) return json["stages"];
  fmt::print(stderr, "bench: {} holds no report\n", file);
  return nullptr;
}

double disturbed_percent(const Samples& samples) {
  double all = 0.0, disturbed = 0.0;
  for (const auto& [key, list] : samples) {
    for (const Sample& sample : list) {
      all += 1.0;
      disturbed += sample.disturbed ? 1.0 : 0.0;
    }
  }
  return all > 0.0 ? 100.0 * disturbed / all : 0.0;
}

int run(const Options& options) {
  const std::optional<Recipe> recipe = accuracy::reference_recipe();
  const ScanFolder folder;
  if (!recipe || folder.path().empty()) {
    fmt::print(stderr, "bench: no recipe, or no folder for the scans\n");
    return 1;
  }
  Measured measured;
  measured.environment = environment(options);
  fmt::print(stderr, "drawing and writing the scan\n");
  const Scene scene(*recipe);
  const Scan organised = scene.draw();
  if (!scene.write(organised, folder.path()) || !write_as_text(organised, folder.path())) return 1;
  const StageOptions stages{folder.path(), options.quick, options.filter};
  register_stages(stages, *recipe, scene, organised, measured.stages);
  for (int round = 0; round < options.rounds; ++round) {
    fmt::print(stderr, "round {} of {}\n", round + 1, options.rounds);
    run_stages(stages);
    if (options.filter.empty()) run_peers(options, folder.path(), round == 0, false, measured.peers);
  }
  if (options.filter.empty()) {
    run_peers(options, folder.path(), true, true, measured.counted);
    if (!score_peers(options, *recipe, folder.path() + "/scored", measured.scored)) return 1;
  }
  measured.slabs = slabs_of(options.lines);
  if (!options.growth.empty()) measured.growth = stages_of(options.growth);
  measured.environment["load after"] = load_average();
  measured.environment["disturbed samples"] = fmt::format("{:.0f} %", disturbed_percent(measured.stages));
  if (options.peers) measured.environment["compared with"] = versions_of(measured.peers);

  const Json json = report(measured);
  if (!options.save.empty()) std::ofstream(options.save) << json.dump(2) << "\n";
  fmt::print("{}\n", options.json ? json.dump(2) : markdown(json));
  return 0;
}

}  // namespace
}  // namespace slabd::bench

int main(int argc, char** argv) {
  slabd::bench::Options options;
  std::string show;
  CLI::App app("Times and counts slabd, stage by stage and next to other programs; script/bench builds and runs it");
  app.add_flag("--json", options.json, "Print one JSON object instead of tables");
  app.add_flag("--peers", options.peers, "Run PCL, Open3D and CGAL too; they must have been built");
  app.add_flag("--quick", options.quick, "A look in two minutes: fewer repetitions, no growth, no slow peers");
  app.add_option("--rounds", options.rounds, "How often everything is run")
      ->check(CLI::Range(1, 100))
      ->capture_default_str();
  app.add_option("--filter", options.filter, "Only stages whose names match this regular expression, and no peers");
  app.add_option("--revision", options.revision, "Name of the source in the report");
  app.add_option("--save", options.save, "Keep the JSON object in this file as well");
  app.add_option("--line", options.lines, "Output of slabctl simulate --json: how long a PLC waits for a verdict");
  app.add_option("--growth", options.growth, "Output of slabd_bench, built for larger scans, with growth/points");
  app.add_option("--show", show, "Print the tables of a JSON object that was saved earlier; runs no measurement");
  CLI11_PARSE(app, argc, argv);
  if (!show.empty()) {
    std::ifstream in(show);
    const auto json = slabd::bench::Json::parse(in, nullptr, false);
    if (!json.is_object()) {
      fmt::print(stderr, "bench: {} holds no report\n", show);
      return 3;
    }
    fmt::print("{}\n", slabd::bench::markdown(json));
    return 0;
  }
  return slabd::bench::run(options);
}
