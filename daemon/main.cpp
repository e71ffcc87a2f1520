// SPDX-License-Identifier: Apache-2.0
//
// slabd: connects the ports to the loop and runs it. A configuration or a database that cannot be used does not end the
// process, because the PLC must see the fault, not a dead interface.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <atomic>
#include <csignal>
#include <cstdarg>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "daemon/log_outlet.h"
#include "daemon/loop.h"
#include "daemon/measure.h"
#include "daemon/seal.h"
#include "daemon/slab_ends.h"

namespace slabd::daemon {
namespace {

constexpr int kExitUsage = 2;
constexpr int kExitBadInput = 3;
constexpr int kExitUnreachable = 4;
constexpr int kExitInternal = 5;
/// Time given to a reader of stderr at the end.
constexpr int kFlush_ms = 1'000;

std::atomic<bool> g_stop{false};
void on_signal(int) {
  g_stop = true;
}

void catch_signals() {
  struct sigaction action {};
  action.sa_handler = on_signal;
  sigaction(SIGTERM, &action, nullptr);
  sigaction(SIGINT, &action, nullptr);
  std::signal(SIGPIPE, SIG_IGN);
  // `slabctl recipe reload` reloads the recipes and reports the result. A closed terminal or a log rotation must not
  // end a slab.
  std::signal(SIGHUP, SIG_IGN);
  // Their default action is to end the process, which is never intended here. An operator may test whether slabd is
  // alive, or a tool may expect a program that reopens its log. Timers and profilers are not used.
  for (const int ignored : {SIGUSR1, SIGUSR2, SIGALRM, SIGVTALRM, SIGPROF, SIGIO, SIGPWR})
    std::signal(ignored, SIG_IGN);
  for (int real_time = SIGRTMIN; real_time <= SIGRTMAX; ++real_time) std::signal(real_time, SIG_IGN);
}

/// Writes to the log without waiting for its reader.
[[gnu::format(printf, 1, 2)]] void say_text(const char* format, ...) {
  std::array<char, 768> text{};
  va_list args;
  va_start(args, format);
  std::vsnprintf(text.data(), text.size(), format, args);
  va_end(args);
  put_log(text.data());
}

void print(const std::vector<config::Problem>& problems) {
  for (const config::Problem& problem : problems) put_log("error: " + problem.text + "\n");
}

// Stand-ins for a robot link and a scanner that could not be set up. The daemon keeps running and reports the reason:
// the PLC sees the link down, and a command that needs it fails with the code.

class AbsentPose : public hal::PosePort {
 public:
  explicit AbsentPose(std::string_view why) : why_(why) {}
  [[nodiscard]] int fd() const override { return -1; }
  [[nodiscard]] bool next(std::int64_t, PoseSample&) override { return false; }
  [[nodiscard]] const hal::PoseLinkCounters& counters() const override { return counters_; }
  [[nodiscard]] std::string_view trouble() const override { return why_.view(); }

 private:
  FixedString<limits::kErrorTextBytes> why_;
  hal::PoseLinkCounters counters_;
};

class AbsentScanner : public hal::ScannerPort {
 public:
  explicit AbsentScanner(const Error& why) : why_(why) {}
  [[nodiscard]] Result<AcquiredScan> acquire(const ScanRequest&, std::span<float>, const std::atomic<bool>&,
                                             const hal::ScanDecoded&) override {
    return why_;
  }
  void idle() override {}
  [[nodiscard]] bool online() const override { return false; }
  [[nodiscard]] std::uint64_t stray_files() const override { return 0; }
  [[nodiscard]] hal::ScannerText trouble() const override { return why_.text; }

 private:
  Error why_;
};

/// Address or device at which the PLC is connected.
FixedString<limits::kErrorTextBytes> plc_place(const hal::PlcSettings& plc) {
  FixedString<limits::kErrorTextBytes> place;
  switch (plc.role) {
    case hal::PlcRole::server: place.printf("Modbus/TCP server on %s:%u", plc.host.c_str(), unsigned{plc.port}); break;
    case hal::PlcRole::client: place.printf("Modbus/TCP client of %s:%u", plc.host.c_str(), unsigned{plc.port}); break;
    case hal::PlcRole::rtu:
      place.printf("Modbus RTU slave %u on %s, %u baud", unsigned{plc.unit_id}, plc.device.c_str(), plc.baud);
      break;
  }
  return place;
}

/// Prints settings that are allowed but probably not intended, and faults of [web] and [plant], which the inspection
/// does not use; once, at the start and by --check.
void print_doubts(const config::Config& config) {
  for (const config::Problem& doubt : config.doubts) put_log("warning: " + doubt.text + "\n");
  for (const auto* beside : {&config.web_problems, &config.plant_problems, &config.genicam_problems})
    for (const config::Problem& problem : *beside) put_log("warning: " + problem.text + "\n");
}

int check(const config::Config& config, const std::vector<config::Problem>& config_problems,
          const std::vector<Recipe>& recipes, const std::vector<config::Problem>& recipe_problems) {
  print(config_problems);
  print(recipe_problems);
  print_doubts(config);
  if (!config_problems.empty()) return kExitBadInput;
  // The configuration itself is valid, so a check before its installation reports ok for it.
  std::printf("%s: ok%s\n", config.path.c_str(),
              recipe_problems.empty() ? "" : ", but not the recipes it names (see above)");
  if (!recipe_problems.empty()) return kExitBadInput;
  for (const Recipe& recipe : recipes)
    std::printf("recipe %s: slab type %u, %u blocks, %d nominals and tolerances unconfirmed\n", recipe.name.c_str(),
                recipe.slab_type, recipe.stations(), unconfirmed_count(recipe));
  for (const AlikeRecipes& alike : alike_recipes(recipes)) std::printf("warning: %s\n", text_of(alike).c_str());
  for (std::size_t i = 0; i < config.arms.list.size(); ++i) {
    const config::ArmSettings& arm = config.arm(i);
    const std::string by = config.arms.several() ? " of scanner " + std::string(arm.by.scanner.view()) : std::string();
    std::printf("calibration%s %s\n", by.c_str(),
                arm.calibration.id.empty()
                    ? "none in the configuration: slabs wait for one to be applied"
                    : (std::string(arm.calibration.id.view()) + " (commissioning values: the handedness of the "
                                                                "scanner's frame is not proven)")
                          .c_str());
  }
  std::printf("PLC: %s\n", plc_place(config.plc).c_str());
  std::printf("inspection memory %.0f MB\n",
              static_cast<double>(limits::inspection_bytes(config.arms.list.size())) / 1e6);
  return 0;
}

void set_arm(const config::ArmSettings& arm, StationArmSettings& settings) {
  settings.T_flange_scanner = arm.calibration.T_flange_scanner;
  settings.calibration_id = arm.calibration.id;
  settings.splice = arm.splice;
  settings.scanner_drift = arm.scanner_drift;
  settings.pose = arm.pose;
  settings.settle_timeout_ns = arm.settle_timeout_ns;
  settings.scan_timeout_ns = arm.scan_timeout_ns;
}

StationSettings station_settings(const config::Config& config, const std::vector<Recipe>& recipes) {
  StationSettings settings;
  settings.recipes = recipes;
  settings.T_base_slab = config.T_base_slab;
  set_arm(config, settings);
  settings.arms = config.arms;
  for (const config::ArmSettings& other : config.more_arms) {
    StationArmSettings arm;
    set_arm(other, arm);
    static_cast<void>(settings.more_arms.push(arm));  // the configuration has no more
  }
  settings.id_pattern = config.id_pattern ? &*config.id_pattern : nullptr;
  settings.mould_from_id = config.mould_from_id ? &*config.mould_from_id : nullptr;
  settings.second_chip_required = config.second_chip_required;
  settings.gauges = {config.gauges.data(), config.gauges.size()};
  settings.plc_memory_lasts = config.plc.role == hal::PlcRole::client;
  settings.check_interval_us = config.check_interval_us;
  settings.software = software_version();
  settings.spool_dir = std::string_view(config.storage.spool_dir);
  settings.capture = config.capture;
  settings.simulation = config.simulation;
  for (const Recipe& recipe : recipes)
    if (const int count = unconfirmed_count(recipe); count > 0) {
      settings.warn |= kWarnUnconfirmedNominals;
      say_text("warning: recipe %s: verdicts depend on %d unconfirmed nominals and tolerances\n", recipe.name.c_str(),
               count);
    }
  for (const AlikeRecipes& alike : alike_recipes(recipes)) say_text("warning: %s\n", text_of(alike).c_str());
  return settings;
}

/// Creates the scanner port of an arm's backend; one that cannot be set up reports the reason in trouble().
std::unique_ptr<hal::ScannerPort> scanner_port(const config::Config& config, const config::ArmSettings& arm,
                                               const hal::Clock& clock) {
  const auto port = [](auto made) -> std::unique_ptr<hal::ScannerPort> {
    if (made.ok()) return std::move(made.value());
    say_text("error: %s\n", made.error().text.c_str());
    return std::make_unique<AbsentScanner>(made.error());
  };
  switch (arm.scanner_backend) {
    case hal::ScannerBackend::tcp: return port(hal::make_scan_stream(arm.stream, clock));
    case hal::ScannerBackend::drop: break;
  }
  // The folder may be on a share that hangs, so only the scanner's own thread accesses it.
  hal::ScanDropSettings settings = arm.scanner;
  settings.make_drop_dir = true;
  settings.read_threads = config.measure_threads;
  settings.owner = hal::lock_owner_of_this_process(config.path);
  return port(hal::make_scan_drop(settings, clock));
}

/// Robot and scanner of an arm.
struct ArmLinks {
  std::unique_ptr<hal::PosePort> pose;
  std::unique_ptr<hal::ScannerPort> scanner;
};

/// Creates the ports of an arm. A pose port that cannot be set up is a fault of the configuration.
ArmLinks arm_links(const config::Config& config, const config::ArmSettings& arm, const hal::Clock& clock, Code& fault) {
  ArmLinks links;
  if (auto made = hal::make_lcm_pose_port(arm.robot); made.ok()) {
    links.pose = std::move(made.value());
  } else {
    say_text("error: %s\n", made.error().text.c_str());
    fault = Code::config;
    links.pose = std::make_unique<AbsentPose>(made.error().text.view());
  }
  links.scanner = scanner_port(config, arm, clock);
  return links;
}

/// Reason why the thread of a scanner hung.
std::string hung_scanner(const std::vector<ArmLinks>& arms) {
  for (const ArmLinks& arm : arms)
    if (arm.scanner->hangs()) return std::string(arm.scanner->trouble().view());
  return {};
}

/// Ends the process without waiting for its threads, because one of them is in a call that cannot be interrupted. As
/// with a kill, all durable data remain.
[[noreturn]] void leave(hal::ServiceNotify& notify, const std::string& meanwhile) {
  notify.stopping();
  say_text("info: slabd: stopped while %s\n", meanwhile.c_str());
  (void)flush_log(kFlush_ms);
  std::_Exit(0);
}

/// Opens the database. The scanner belongs to the process that holds the database and the spool: two processes with one
/// drop folder take each other's scans, and with one spool they would delete each other's scans as unknown files.
class Opener {
 public:
  explicit Opener(const config::Config& config)
      : config_(config.storage), spool_lock_(hal::lock_owner_of_this_process(config.path)) {}

  Result<std::unique_ptr<storage::Store>> open(std::atomic<bool>& scanner_is_ours) {
    if (!scanner_is_ours) {
      if (storage::is_written_elsewhere(config_.db_path))
        return error(Code::journal_write, "another process works with %s, and with its scanner: only one may",
                     config_.db_path.c_str());
      if (const Status taken = take_spool(); !taken.ok()) return taken.error();
      scanner_is_ours = true;
    }
    auto made = storage::open_store(config_);
    // Taken again, because the first start makes the folder.
    if (const Status taken = take_spool(); !taken.ok()) return taken.error();
    return made;
  }

 private:
  /// busy: another daemon holds the spool.
  Status take_spool() {
    std::error_code none;
    if (!std::filesystem::exists(config_.spool_dir, none)) return success();
    const hal::FolderLock::State state = spool_lock_.take(config_.spool_dir.c_str());
    if (state == hal::FolderLock::State::anothers)
      return error(Code::busy, "storage.spool_dir %s is used by another daemon (%s): one at a time may",
                   config_.spool_dir.c_str(), spool_lock_.text().c_str());
    if (state == hal::FolderLock::State::cannot && !std::exchange(unlockable_said_, true))
      say_text("warning: storage.spool_dir %s cannot be locked (%s): no other slabd may use it\n",
               config_.spool_dir.c_str(), spool_lock_.text().c_str());
    return success();
  }

  const storage::StoreSettings& config_;
  hal::FolderLock spool_lock_;
  bool unlockable_said_ = false;
};

/// If memory cannot be locked, log an error and continue, so that the PLC's interface stays up.
void seal() {
  if (const Status locked = lock_memory(); locked.ok())
    say_text("info: slabd: all memory is locked\n");
  else
    say_text("error: --seal: %s\n", locked.error().text.c_str());
}

int run(const config::Config& config, const std::vector<config::Problem>& config_problems,
        const std::vector<Recipe>& recipes, const std::vector<config::Problem>& recipe_problems, bool sealed) {
  start_log_outlet();
  print(config_problems);
  print(recipe_problems);
  print_doubts(config);

  // As a server, a second slabd fails because the port is in use. As a client or on a serial line it would overwrite
  // the first one's registers in the PLC, and take its scans.
  if (config.plc.role != hal::PlcRole::server && storage::is_written_elsewhere(config.storage.db_path)) {
    say_text("error: another process uses %s, most likely slabd itself: only one may\n",
             config.storage.db_path.c_str());
    return kExitUnreachable;
  }
  const auto plc = hal::make_plc_port(config.plc);
  if (!plc.ok()) {
    say_text("error: %s\n", plc.error().text.c_str());
    return kExitUnreachable;
  }
  const auto clock = hal::make_system_clock();
  const auto notify = hal::make_systemd_notify();

  StationSettings settings = station_settings(config, recipes);
  if (!recipe_problems.empty()) settings.warn |= kWarnRecipeUnusable;
  if (!config_problems.empty() || recipes.empty()) settings.fault = Code::config;

  std::vector<ArmLinks> arms;
  std::unique_ptr<hal::ControlPort> control;
  const bool is_usable = settings.fault == Code::ok;
  for (std::size_t i = 0; i < config.arms.list.size(); ++i) {
    if (is_usable) {
      arms.push_back(arm_links(config, config.arm(i), *clock, settings.fault));
      continue;
    }
    // The links are not reported in this case, because the configuration must be corrected first.
    arms.push_back({std::make_unique<AbsentPose>(std::string_view()),
                    std::make_unique<AbsentScanner>(error(Code::config, "the configuration is not usable"))});
  }
  // The control socket is also opened in fault 504, at the configured or default path, so that `slabctl status` can
  // report the fault.
  if (auto made = hal::make_control_socket(config.control_socket.c_str()); made.ok()) {
    control = std::move(made.value());
  } else {
    say_text("warning: %s\n", made.error().text.c_str());
    settings.warn |= kWarnControlSocket;
  }

  LoopFigures figures;
  // Absolute, because clients run in other folders than the daemon.
  std::error_code no_folder;
  figures.config_path = std::filesystem::absolute(config.path, no_folder).lexically_normal().native();
  figures.plc_role = config.plc.role;
  figures.plc_word_order = config.plc.word_order;
  figures.pose_type = config.robot.type;
  figures.db_path = config.storage.db_path;
  figures.plant_line = config.plant.line;
  figures.plant_alarm_us = static_cast<std::int64_t>(config.plant.alarm_h * 3.6e9);
  figures.started_ns = clock->mono_ns();
  std::optional<RecipeWatch> recipe_watch;
  if (settings.fault == Code::ok)
    recipe_watch.emplace(config.recipes_dir,
                         std::make_shared<const RecipeSet>(RecipeSet{recipes, config.storage.recipe_texts}), 2'000,
                         config.gauges);
  std::optional<DesignWatch> design_watch;
  if (settings.fault == Code::ok && !config.designs_dir.empty())
    design_watch.emplace(config.designs_dir,
                         std::make_shared<const config::DesignSet>(config::load_designs(config.designs_dir)));
  std::unique_ptr<hal::GaugePort> gauges;
  const bool fetches = std::any_of(config.gauges.begin(), config.gauges.end(), [](const GaugeSettings& gauge) {
    return gauge.link == GaugeLink::modbus || gauge.link == GaugeLink::udp;
  });
  if (settings.fault == Code::ok && fetches) {
    // Without it the gauges are missing, and the items that need them are not measured.
    if (auto made = hal::make_gauge_port(settings.gauges, config.gauge_senders, *clock); made.ok())
      gauges = std::move(made.value());
    else
      say_text("error: %s\n", made.error().text.c_str());
  }
  Ports ports{.plc = *plc.value(),
              .pose = *arms.front().pose,
              .scanner = *arms.front().scanner,
              .control = control.get(),
              .clock = *clock,
              .notify = *notify,
              .gauges = gauges.get(),
              .designs = design_watch ? &*design_watch : nullptr,
              .recipes = recipe_watch ? &*recipe_watch : nullptr};
  ScanForms scan_forms;
  for (std::size_t i = 0; i < arms.size(); ++i) {
    static_cast<void>(scan_forms.push(config.arm(i).scanner.form));
    if (i > 0) static_cast<void>(ports.more_arms.push({arms[i].pose.get(), arms[i].scanner.get()}));
  }
  Opener opener(config);
  Loop loop(
      ports, settings, [&opener](std::atomic<bool>& scanner_is_ours) { return opener.open(scanner_is_ours); },
      scan_forms, config.measure_threads, std::move(figures));
  loop.start();
  for (bool was_opened = false; !g_stop;) {
    loop.turn(Loop::kTurn_ms);
    if (was_opened || loop.is_opening()) continue;
    was_opened = true;  // or could not be
    say_text("info: %s: %s, inspection memory %.0f MB%s\n", settings.software.c_str(), plc_place(config.plc).c_str(),
             static_cast<double>(limits::inspection_bytes(arms.size())) / 1e6,
             loop.station().settings.fault == Code::ok ? "" : "; in FAULT, see above");
    if (sealed) seal();  // the lock applies to later mappings too
  }
  if (loop.is_opening()) leave(*notify, "the database was being opened");
  loop.finish();
  if (!loop.wait_for_scanner_thread()) leave(*notify, "the scanner's thread hung: " + hung_scanner(arms));
  say_text("info: slabd: stopped\n");
  return 0;
}

}  // namespace
}  // namespace slabd::daemon

// Only a lack of memory at the start throws here: it ends the process, and the service manager restarts it.
int main(int argc, char** argv) {  // NOLINT(bugprone-exception-escape)
  using namespace slabd::daemon;
  CLI::App app{"slabd: inspects railway track slabs from 3-D scans and reports pass or fail to the PLC"};
  std::string config_path = "/etc/slabd/slabd.toml";
  bool check_only = false;
  app.add_option("--config", config_path, "configuration file")->capture_default_str();
  app.add_flag("--check", check_only, "check configuration and recipes, then exit (0 usable, 3 not)");
  bool seal = false;
  app.add_flag("--seal", seal, "lock all memory; see docs/OPERATING.md")->disable_flag_override();
  app.set_version_flag("--version", std::string(software_version().view()));
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    const int code = app.exit(e);
    return code == 0 ? 0 : kExitUsage;
  }

  try {
    catch_signals();
    use_one_heap();
    slabd::config::Config config;
    std::vector<slabd::config::Problem> config_problems;
    slabd::config::load_config(config_path, config, config_problems);
    std::vector<slabd::Recipe> recipes;
    std::vector<slabd::config::Problem> recipe_problems;
    if (config_problems.empty())
      slabd::config::load_recipes(config.recipes_dir, recipes, recipe_problems, &config.storage.recipe_texts,
                                  &config.doubts, &config.gauges);
    if (check_only) return check(config, config_problems, recipes, recipe_problems);
    const int status = run(config, config_problems, recipes, recipe_problems, seal);
    (void)flush_log(kFlush_ms);
    return status;
  } catch (const std::exception& e) {
    say_text("error: slabd: %s\n", e.what());
    (void)flush_log(kFlush_ms);
    return kExitInternal;
  }
}
