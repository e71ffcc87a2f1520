// SPDX-License-Identifier: Apache-2.0
//
// Runs thousands of lives: several processes take seeds from a common counter and add up their figures in shared
// memory. The first life that breaks a promise is printed at once, with the command to repeat it.
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>

#include "base/rules.h"
#include "tests/sim/life.h"

namespace slabd::sim {
namespace {

using Clock = std::chrono::steady_clock;

struct Options {
  std::uint64_t seeds = 1'000;
  std::uint64_t from = 1;
  std::uint64_t seed = 0;
  std::uint64_t hashes = 0;
  unsigned jobs = 1;
  int robots = 1;
  double minutes = 0.0;
  std::uint64_t every_pair = 0;
  bool keep_going = false;
};

constexpr unsigned kJobsMax = 256;

/// Located in memory that all workers share.
struct Shared {
  std::atomic<std::uint64_t> next{0};
  std::atomic<bool> stop{false};
  std::atomic_flag lock = ATOMIC_FLAG_INIT;
  Totals totals;
  double slowest_s = 0.0;
  std::uint64_t slowest_seed = 0;
  std::uint64_t finished = 0;
  std::uint64_t lives_until_every_pair = 0;                   ///< 0: a pair of fault and state has not been reached yet
  std::array<std::atomic<std::uint64_t>, kJobsMax> living{};  ///< seed of each worker
};

Shared* g_shared = nullptr;
/// Ctrl-C ends a run with the summary, as the last seed would.
void on_signal(int) {
  if (g_shared != nullptr) g_shared->stop = true;
}

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

/// Command that repeats a life.
std::string again(const Options& options, std::uint64_t seed) {
  return "script/sim" + std::string(options.robots == 2 ? " --robots 2" : "") + " --seed " + std::to_string(seed);
}

void print_failure(const Options& options, std::uint64_t seed, const LifeResult& life) {
  std::printf("SEED %llu BROKE A PROMISE: %s\n  again: %s\n", static_cast<unsigned long long>(seed),
              life.violation.c_str(), again(options, seed).c_str());
  const std::size_t shown = std::min<std::size_t>(life.last_lines.size(), 25);
  for (std::size_t i = life.last_lines.size() - shown; i < life.last_lines.size(); ++i)
    std::printf("  %s\n", life.last_lines[i].c_str());
  std::fflush(stdout);
}

int unreached_pairs(const Totals& totals) {
  int missing = 0;
  for (const auto& of_state : totals.injected)
    missing += static_cast<int>(std::count(of_state.begin(), of_state.end(), std::uint64_t{0}));
  return missing;
}

void work(const Options& options, Shared& shared, unsigned worker) {
  const auto begun = Clock::now();
  const std::vector<Recipe> recipes = life_recipes();
  const std::string folder = enter_own_folder();
  while (!shared.stop) {
    const std::uint64_t index = shared.next++;
    if (index >= options.seeds) break;
    if (options.minutes > 0.0 && seconds_since(begun) > 60.0 * options.minutes) break;
    const auto start = Clock::now();
    shared.living[worker] = options.from + index;
    const LifeResult life = live(options.from + index, recipes, false, options.robots);
    const double took_s = seconds_since(start);
    while (shared.lock.test_and_set()) ::usleep(50);
    shared.totals.add(life.totals);
    ++shared.finished;
    if (shared.lives_until_every_pair == 0 && unreached_pairs(shared.totals) == 0)
      shared.lives_until_every_pair = shared.finished;
    if (options.every_pair != 0 && shared.finished >= options.every_pair && shared.lives_until_every_pair != 0)
      shared.stop = true;
    if (took_s > shared.slowest_s) {
      shared.slowest_s = took_s;
      shared.slowest_seed = options.from + index;
    }
    if (!life.violation.empty()) {
      print_failure(options, options.from + index, life);
      if (!options.keep_going) shared.stop = true;
    }
    shared.lock.clear();
  }
  std::filesystem::current_path("/");
  std::filesystem::remove_all(folder);
}

void print_summary(const Options& options, const Shared& shared, double real_s) {
  const Totals& t = shared.totals;
  const auto u = [](std::uint64_t value) { return static_cast<unsigned long long>(value); };
  const double simulated_h = static_cast<double>(t.simulated_ns) * 1e-9 / 3600.0;
  std::printf("seeds                    %llu (%llu..%llu), %llu broke a promise\n", u(t.seeds), u(options.from),
              u(options.from + t.seeds - 1), u(t.failed));
  std::printf("simulated                %.1f h in %.1f s (%.0f times as fast)\n", simulated_h, real_s,
              simulated_h * 3600.0 / real_s);
  std::printf("slabs                    %llu begun, %llu judged, %llu passed, %llu let go on a pass\n",
              u(t.slabs_begun), u(t.slabs_judged), u(t.passes), u(t.passes_taken));
  std::printf("blocks                   %llu passed, each on a scan of this block on this slab\n", u(t.blocks_passed));
  const std::uint64_t slabs = t.slabs_judged;
  std::printf("wrong passes             %llu of %llu judged (below %.2g per slab and %.2g per seed with 95 %%)\n",
              u(t.wrong_passes), u(slabs), 3.0 / static_cast<double>(std::max<std::uint64_t>(slabs, 1)),
              3.0 / static_cast<double>(std::max<std::uint64_t>(t.seeds, 1)));
  std::printf("lost rows                %llu of %llu looked for after restarts\n", u(t.lost_rows), u(t.rows_checked));
  std::printf("stuck lives              %llu\n", u(t.stuck));
  std::printf("restarts                 %llu, of which %llu after a loss of power\n", u(t.restarts), u(t.power_losses));
  std::printf("scans, commits, turns    %llu, %llu, %llu\n", u(t.scans), u(t.commits), u(t.turns));
  if (options.robots == 2) std::printf("scans by robot 2         %llu\n", u(t.scans_by_second));
  std::printf("slowest seed             %llu, %.2f s\n", u(shared.slowest_seed), shared.slowest_s);

  std::printf("\n%-24s", "fault in state");
  for (std::size_t s = 0; s < kStates; ++s) std::printf(" %9.9s", state_name(s).data());
  std::printf("\n");
  std::string unreached;
  for (std::size_t f = 0; f < kFaults; ++f) {
    std::printf("%-24s", name(static_cast<Fault>(f)).data());
    for (std::size_t s = 0; s < kStates; ++s) {
      std::printf(" %9llu", u(t.injected[f][s]));
      if (t.injected[f][s] != 0) continue;
      unreached += "  " + std::string(name(static_cast<Fault>(f))) + " / " + std::string(state_name(s)) + "\n";
    }
    std::printf("\n");
  }
  std::printf("\nunreached pairs          %d of %zu\n%s", unreached_pairs(t), kFaults * kStates, unreached.c_str());
  if (shared.lives_until_every_pair != 0)
    std::printf("every pair reached       after %llu lives\n", u(shared.lives_until_every_pair));
}

int live_once(const Options& options) {
  const std::vector<Recipe> recipes = life_recipes();
  const std::string folder = enter_own_folder();
  const LifeResult life = live(options.seed, recipes, true, options.robots);
  std::filesystem::current_path("/");
  std::filesystem::remove_all(folder);
  std::printf("seed %llu, %.0f s, trace %016llx: %s\n", static_cast<unsigned long long>(options.seed),
              static_cast<double>(life.totals.simulated_ns) * 1e-9, static_cast<unsigned long long>(life.hash),
              life.violation.empty() ? "every promise kept" : life.violation.c_str());
  return life.violation.empty() ? 0 : 1;
}

/// Prints one line for each seed, for comparison with another compiler.
int print_hashes(const Options& options) {
  const std::vector<Recipe> recipes = life_recipes();
  const std::string folder = enter_own_folder();
  for (std::uint64_t i = 0; i < options.hashes; ++i)
    std::printf("%llu %016llx\n", static_cast<unsigned long long>(options.from + i),
                static_cast<unsigned long long>(live(options.from + i, recipes, false, options.robots).hash));
  std::filesystem::current_path("/");
  std::filesystem::remove_all(folder);
  return 0;
}

int live_many(const Options& options) {
  void* memory = ::mmap(nullptr, sizeof(Shared), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  if (memory == MAP_FAILED) return 5;
  auto* shared = new (memory) Shared;
  g_shared = shared;
  std::signal(SIGINT, on_signal);
  std::signal(SIGTERM, on_signal);
  const auto start = Clock::now();
  std::vector<pid_t> workers;
  for (unsigned i = 0; i < std::clamp(options.jobs, 1U, kJobsMax); ++i) {
    const pid_t pid = ::fork();
    if (pid == 0) {
      work(options, *shared, i);
      std::fflush(stdout);
      ::_exit(0);
    }
    workers.push_back(pid);
  }
  bool crashed = false;
  for (std::size_t i = 0; i < workers.size(); ++i) {
    int status = 0;
    while (::waitpid(workers[i], &status, 0) < 0 && errno == EINTR) {
    }
    if (WIFEXITED(status) && WEXITSTATUS(status) == 0) continue;
    crashed = true;
    const auto seed = static_cast<unsigned long long>(shared->living[i].load());
    std::printf("SEED %llu CRASHED\n  again: %s\n", seed, again(options, seed).c_str());
    std::fflush(stdout);
  }
  print_summary(options, *shared, seconds_since(start));
  const bool too_few = options.every_pair != 0 && shared->lives_until_every_pair == 0;
  return crashed || too_few || shared->totals.failed != 0 ? 1 : 0;
}

#ifdef SLABD_REMOVABLE_RULES
void remove_rule(const std::string& name) {
  const auto* const found =
      std::find_if(kRuleTexts.begin(), kRuleTexts.end(), [&](const RuleText& rule) { return rule.name == name; });
  if (found == kRuleTexts.end()) throw CLI::ValidationError("--without", name + " is not in --list-rules");
  removed_rules.set(static_cast<std::size_t>(found->rule));
}

void list_rules() {
  for (const RuleText& rule : kRuleTexts) std::printf("%-30s %s\n", rule.name.data(), rule.text.data());
  throw CLI::Success();
}

void add_rule_options(CLI::App& app) {
  app.add_option_function<std::string>("--without", remove_rule, "a safety rule that slabd does not have");
  app.add_flag_callback("--list-rules", list_rules, "print the names of --without, and end");
}
#else
void add_rule_options(CLI::App& /*app*/) {}
#endif

}  // namespace
}  // namespace slabd::sim

int main(int argc, char** argv) {
  using namespace slabd::sim;
  CLI::App app{"Lives of the simulated line: seeds that break a promise of slabd's, and what was tried"};
  Options options;
  app.add_option("--seeds", options.seeds, "how many lives")->capture_default_str();
  app.add_option("--from", options.from, "the first of them")->capture_default_str();
  app.add_option("--seed", options.seed, "live only this one, and tell everything");
  app.add_option("--hashes", options.hashes, "print the trace's hash of this number of lives from --from on");
  app.add_option("--jobs", options.jobs, "processes")->capture_default_str();
  app.add_option("--robots", options.robots, "robots with a scanner each")
      ->check(CLI::Range(1, 2))
      ->capture_default_str();
  app.add_option("--minutes", options.minutes, "end after so long, whatever --seeds says");
  app.add_flag("--keep-going", options.keep_going, "also after a promise was broken");
  app.add_option("--every-pair", options.every_pair,
                 "end after this number of lives, when every fault was injected in every state; fail if --seeds is too "
                 "few for it");
  add_rule_options(app);
  CLI11_PARSE(app, argc, argv);
  ::unsetenv("JOURNAL_STREAM");  // so that the log's prefixes are written to the trace
  if (options.seed != 0) return live_once(options);
  if (options.hashes != 0) return print_hashes(options);
  return live_many(options);
}
