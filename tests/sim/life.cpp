// SPDX-License-Identifier: Apache-2.0
#include "tests/sim/life.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <filesystem>

#include "config/config.h"
#include "daemon/loop.h"
#include "tests/places/places.h"
#include "tests/sim/allocation.h"
#include "tests/sim/disk.h"
#include "tests/sim/ports.h"
#include "tests/sim/promises.h"
#include "tests/sim/workers.h"

namespace slabd::sim {
namespace {

namespace fs = std::filesystem;

constexpr const char* kDatabase = "data/slabd.db";
constexpr const char* kSpool = "spool";
constexpr std::int64_t kTurn = 25 * kMs;
constexpr std::int64_t kQuietTurn = 60 * kMs;
constexpr std::int64_t kWatchdog = 10 * kSecond;      ///< of the service unit
constexpr std::int64_t kStartTimeout = 60 * kSecond;  ///< of the service unit
constexpr std::int64_t kRestartPause = 2 * kSecond;   ///< of the service unit
constexpr std::int64_t kCalmTimeout = 900 * kSecond;  ///< time in which the line must pass a good slab after the last
                                                      ///< fault
constexpr std::size_t kAnyState = kStates;

/// A fault that is triggered at its time and in a given state of slabd.
struct Episode {
  Fault fault = Fault::kill;
  std::int64_t from_ns = 0;
  std::size_t state = kAnyState;
  std::int64_t lasts_ns = 0;
  bool fired = false;
};

class Life {
 public:
  Life(std::uint64_t seed, const std::vector<Recipe>& recipes, bool loud, int robots)
      : world_(seed, loud),
        clock_(world_),
        recipes_(recipes),
        line_(world_, recipes_, robots),
        disk_(world_),
        wire_(world_),
        plc_(world_, line_, wire_),
        control_room_(world_, line_.arms.several()),
        promises_(world_, line_),
        notify_(world_),
        chance_(world_.chance(10)) {
    for (std::size_t arm = 0; arm < line_.robots.size(); ++arm) poses_.emplace_back(line_, arm);
    plc_.decided = [this](const Decision& decision) {
      promises_.decided(decision);
      if (calm_ && decision.slab_no == calm_slab_no_) calm_verdict_ = decision.verdict;
    };
    overhear_log();
    think_up_faults();
  }
  ~Life() {
    process_.reset();
    std::fclose(stderr);
    stderr = real_stderr_;
  }
  Life(const Life&) = delete;
  Life& operator=(const Life&) = delete;

  LifeResult run();

 private:
  void overhear_log();
  void think_up_faults();
  void think_up_clusters();
  void boot();
  Result<std::unique_ptr<storage::Store>> open_store();
  Status calibrate(storage::Store& store);
  void run_daemon();
  void bury(bool power);
  void manage_service();
  void trigger_faults();
  void fire(Episode& episode);
  void begin_calm();
  void check_calm();
  [[nodiscard]] std::int64_t next_ns() const;
  [[nodiscard]] std::size_t state() const;
  [[nodiscard]] daemon::StationSettings settings() const;

  World world_;
  WorldClock clock_;
  std::vector<Recipe> recipes_;
  Line line_;
  Disk disk_;
  Wire wire_;
  Plc plc_;
  std::deque<PoseStream> poses_;  ///< [arm]
  ControlRoom control_room_;
  Promises promises_;
  SimNotify notify_;
  Prng chance_;
  FILE* real_stderr_ = nullptr;

  std::unique_ptr<Process> process_;
  Process::Thread* loop_thread_ = nullptr;
  std::int64_t booted_ns_ = 0;
  std::int64_t boot_at_ns_ = 0;
  std::size_t shown_state_ = 0;
  bool quiet_ = false;
  bool stop_ = false;         ///< asked to end, as by systemctl restart
  bool power_after_ = false;  ///< the process ends because the computer loses power
  bool config_broken_ = false;
  std::int64_t repaired_ns_ = 0;
  std::int64_t fail_allocation_ = 0;
  std::int64_t kill_in_boot_ = 0;

  std::vector<Episode> episodes_;
  std::vector<Episode> sequels_;  ///< of faults that have just been triggered
  std::int64_t faults_end_ns_ = 0;
  std::int64_t mono_released_ns_ = 0;
  std::size_t covered_state_ = kAnyState;
  bool calm_ = false;
  std::int64_t calm_ns_ = 0;
  std::uint32_t calm_slab_no_ = 0;
  Verdict calm_verdict_ = Verdict::none;
};

/// Redirects the daemon's log into the trace.
void Life::overhear_log() {
  cookie_io_functions_t io{};
  io.write = [](void* world, const char* text, std::size_t bytes) -> ssize_t {
    auto& w = *static_cast<World*>(world);
    const std::size_t end = bytes > 0 && text[bytes - 1] == '\n' ? bytes - 1 : bytes;
    w.trace.line(w.now_ns, "  %.*s", static_cast<int>(end), text);
    return static_cast<ssize_t>(bytes);
  };
  real_stderr_ = stderr;
  stderr = fopencookie(&world_, "w", io);
  static std::array<char, 4096> buffer;
  std::setvbuf(stderr, buffer.data(), _IOLBF, buffer.size());
}

void Life::think_up_faults() {
  faults_end_ns_ = between(chance_, 150, 420) * kSecond;
  const auto count = happens(chance_, 0.05) ? 0 : 6 + chance_.below(24);
  for (std::uint64_t i = 0; i < count; ++i) {
    Episode e;
    e.fault = static_cast<Fault>(chance_.below(kLoneFaults));
    e.from_ns = between(chance_, 0, faults_end_ns_ - 20 * kSecond);
    // Mostly in the working states, but possible in all.
    const double where = chance_.uniform();
    e.state = where < 0.45 ? 3 + chance_.below(3) : where < 0.8 ? chance_.below(kStates) : kAnyState;
    e.lasts_ns = between(chance_, kSecond, happens(chance_, 0.2) ? 60 * kSecond : 12 * kSecond);
    episodes_.push_back(e);
  }
  // A fault that waits for a state may never be triggered unless another fault leads to that state.
  for (std::size_t i = 0; i < count; ++i) {
    const Episode e = episodes_[i];  // a copy: the list grows
    const bool by_restart = e.state <= 1 || e.state == kStateDown;
    if (by_restart) episodes_.push_back({Fault::kill, e.from_ns + kMs, kAnyState, 0, false});
    if (e.state == 7) episodes_.push_back({Fault::disk_read_only, e.from_ns, 3, 8 * kSecond, false});
    if (e.state == 8) episodes_.push_back({Fault::capture, e.from_ns, 2, 20 * kSecond, false});
  }
  think_up_clusters();
}

/// Adds clusters of faults. Errors in assigning a scan to its block need several faults together: a kill, an aborted
/// order and a temporary disk failure. Spread over a life they hardly ever coincide.
void Life::think_up_clusters() {
  constexpr std::array kTogether = {
      Fault::kill,           Fault::kill,           Fault::kill_at_write,  Fault::plc_abort,         Fault::plc_abort,
      Fault::plc_abort,      Fault::plc_restart,    Fault::plc_slab_abort, Fault::disk_eio,          Fault::disk_full,
      Fault::scanner_frozen, Fault::scanner_frozen, Fault::scanner_late,   Fault::scanner_truncated, Fault::capture};
  // A separate random source, so that lives without clusters are unchanged by this function.
  Prng chance = world_.chance(11);
  if (!happens(chance, 0.4)) return;
  const auto clusters = 3 + chance.below(10);
  for (std::uint64_t i = 0; i < clusters; ++i) {
    const std::int64_t from_ns = between(chance, 5 * kSecond, faults_end_ns_ - 40 * kSecond);
    const auto count = 3 + chance.below(6);
    // Faults that turn a mistaken scan into the scan of another block, and a wrong pass.
    for (const Fault fault : {Fault::scanner_frozen, Fault::plc_elsewhere})
      if (happens(chance, 0.7))
        episodes_.push_back({fault, from_ns + between(chance, 0, 10 * kSecond), kAnyState,
                             between(chance, 5 * kSecond, 30 * kSecond), false});
    for (std::uint64_t k = 0; k < count; ++k) {
      Episode e;
      e.fault = kTogether[chance.below(kTogether.size())];
      e.from_ns = from_ns + between(chance, 0, 25 * kSecond);
      e.state = happens(chance, 0.7) ? 4 + chance.below(2) : kAnyState;
      e.lasts_ns = between(chance, 20 * kMs, happens(chance, 0.5) ? kSecond : 10 * kSecond);
      episodes_.push_back(e);
    }
  }
}

std::size_t Life::state() const {
  return process_ == nullptr ? kStateDown : shown_state_;
}

daemon::StationSettings Life::settings() const {
  daemon::StationSettings s;
  s.recipes = recipes_;
  s.T_base_slab = line_.T_base_slab;
  s.T_flange_scanner = line_.T_flange_scanner[0];
  s.calibration_id = "commissioning";
  s.splice.commissioning_mm = 0.02;
  s.splice.commissioning_rad = rad_from_deg(0.001);
  s.splice.repeatability_mm = 0.017;
  s.splice.repeatability_rad = rad_from_deg(0.001);
  s.software = "slabd simulated";
  s.spool_dir = kSpool;
  if (!line_.arms.several()) return s;
  s.arms = line_.arms;
  s.splice.absolute_mm = 0.02;
  s.splice.absolute_rad = rad_from_deg(0.001);
  daemon::StationArmSettings second = s;
  second.T_flange_scanner = line_.T_flange_scanner[1];
  (void)s.more_arms.push(second);
  return s;
}

/// Stores and applies the hand-eye calibrations and the tie of two robots, unless they are in force.
Status Life::calibrate(storage::Store& store) {
  const auto now = store.calibration();
  if (!now.ok()) return now.error();
  if (!now.value()->tie.id.empty()) return success();
  std::array<std::string, 2> ids;
  for (std::size_t arm = 0; arm <= ids.size(); ++arm) {
    storage::CalibrationRecord record;
    record.figures = "{}";
    record.observations = "# none\n";
    record.operator_name = "anna";
    record.software = "simulated";
    record.created_utime_us = 1;
    if (arm < ids.size()) {
      record.scanner = line_.arms.list[arm].scanner.view();
      record.numbers = HandEyeNumbers{line_.T_flange_scanner[arm], 0.02, rad_from_deg(0.001)};
    } else {
      TieNumbers tie;
      tie.robot = line_.arms.list[1].robot;
      tie.T_base_robot = line_.T_base_robot[1];
      tie.centre_mm = line_.T_base_slab.translation_mm;
      tie.covariance = Mat6::Identity() * 1e-10;
      tie.targets = 6;
      tie.rms_mm = 0.02;
      record.numbers = tie;
      record.parent_id = tie_parent(CalibrationId(ids[0]), CalibrationId(ids[1])).view();
    }
    const Result<std::string> id = store.change(storage::KeepCalibration{record});
    if (!id.ok()) return id.error();
    if (arm < ids.size()) ids[arm] = id.value();
    const Result<std::string> applied =
        store.change(storage::ApplyCalibration{id.value(), {"anna", "two robots", world_.utime_us()}});
    if (!applied.ok()) return applied.error();
  }
  return success();
}

// ---- one process of slabd -----------------------------------------------------------------------------------------

void Life::boot() {
  world_.trace.line(world_.now_ns, "slabd starts");
  process_ = std::make_unique<Process>(world_);
  disk_.serve(process_.get());
  if (kill_in_boot_ > 0) disk_.kill_at(std::exchange(kill_in_boot_, 0), happens(chance_, 0.5));
  notify_.begin();
  booted_ns_ = world_.now_ns;
  shown_state_ = 0;
  stop_ = false;
  wire_.listen(true);
  loop_thread_ = &process_->start([this] { run_daemon(); });
}

/// Called by the storage thread.
Result<std::unique_ptr<storage::Store>> Life::open_store() {
  process_->sleep_for(between(chance_, 5 * kMs, 60 * kMs));
  storage::StoreSettings where;
  where.db_path = kDatabase;
  where.spool_dir = kSpool;
  where.arms = line_.arms;
  auto made = storage::open_store(where);
  if (!made.ok()) return made;
  if (line_.arms.several()) {
    try {
      if (const Status status = calibrate(*made.value()); !status.ok()) return status.error();
    } catch (const std::bad_alloc&) {
      return error(Code::internal, "no memory");
    }
  }
  const heap::Aside aside;
  return std::unique_ptr<storage::Store>(
      std::make_unique<OverheardStore>(std::move(made.value()), kDatabase, promises_, *process_));
}

/// The steps of main(), on simulated ports.
void Life::run_daemon() {
  Process& process = *process_;
  try {
    SimPlcPort plc(wire_, [this](const PlcOutputs& out, const hal::InputImage& image) {
      world_.trace.bytes(image.data(), sizeof image);
      promises_.shown(out);
      shown_state_ = static_cast<std::size_t>(out.state);
      quiet_ = !out.busy && !out.slab_open;
    });
    std::deque<SimPose> poses;
    std::deque<SimScanner> scanners;
    for (std::size_t arm = 0; arm < line_.robots.size(); ++arm) {
      poses.emplace_back(poses_[arm]);
      scanners.emplace_back(line_, process, arm);
    }
    SimControl control(world_, control_room_);
    daemon::StationSettings station = settings();
    if (config_broken_) station.fault = Code::config;
    daemon::LoopFigures figures;
    figures.db_path = kDatabase;
    process.sleep_for(between(chance_, 20 * kMs, 150 * kMs));  // time to touch the memory of the scans
    promises_.process_started();
    heap::fail_at(std::exchange(fail_allocation_, 0));
    daemon::Ports ports{plc, poses[0], scanners[0], nullptr, &control, clock_, notify_};
    if (poses.size() > 1) (void)ports.more_arms.push({&poses[1], &scanners[1]});
    daemon::Loop loop(
        ports, station, [this](auto&) { return open_store(); },
        std::make_unique<FiberWorkers>(process, line_, recipes_), std::move(figures));
    loop.start();
    while (!process.dead() && !stop_) {
      process.sleep_until(std::min(world_.now_ns + (quiet_ ? kQuietTurn : kTurn),
                                   std::max(world_.now_ns + kMs, wire_.next_request_ns())));
      if (process.dead()) break;
      const std::uint64_t answers = control_room_.answers;
      heap::watch();
      loop.serve();
      const std::uint64_t requests = heap::stop();
      if (requests > 0 && answers == control_room_.answers)
        world_.violated("the loop asked %llu times for memory after the start",
                        static_cast<unsigned long long>(requests));
      ++world_.totals.turns;
      if (!loop.is_opening()) heap::fail_at(0);
    }
    if (stop_ && !process.dead()) loop.finish();
  } catch (const std::exception& e) {
    heap::fail_at(0);
    world_.trace.line(world_.now_ns, "slabd exits: %s", e.what());
  }
  heap::fail_at(0);
}

void Life::bury(bool power) {
  process_->die();
  process_->bury();
  process_.reset();
  loop_thread_ = nullptr;
  disk_.serve(nullptr);
  disk_.kill_at(0, false);
  wire_.listen(false);
  ++world_.totals.restarts;
  boot_at_ns_ = world_.now_ns + kRestartPause;
  if (!power) return;
  ++world_.totals.power_losses;
  disk_.lose_power();
  boot_at_ns_ = world_.now_ns + between(chance_, 5 * kSecond, 40 * kSecond);
  world_.mono_offset_ns = 5 * kSecond - boot_at_ns_;
  world_.mono_held_ns = 0;
  world_.trace.line(world_.now_ns, "the computer has lost power");
}

/// systemd: the unit's watchdog, start timeout and restart.
void Life::manage_service() {
  if (process_ == nullptr) {
    if (world_.now_ns >= boot_at_ns_) boot();
    return;
  }
  if (process_->dead() || process_->ended()) {
    const bool died = process_->dead();
    world_.trace.line(world_.now_ns, died ? "slabd has died" : "slabd has ended");
    bury(std::exchange(power_after_, false) && died);
    return;
  }
  const bool hangs = notify_.is_ready ? world_.now_ns - notify_.fed_ns > kWatchdog && !notify_.is_stopping
                                      : world_.now_ns - booted_ns_ > kStartTimeout;
  if (!hangs) return;
  world_.trace.line(world_.now_ns, "the service manager's watchdog ends slabd");
  bury(false);
}

// ---- faults ------------------------------------------------------------------------------------------------------

void Life::trigger_faults() {
  const std::size_t now = state();
  if (now != covered_state_) {
    covered_state_ = now;
    for (std::size_t f = 0; f < kFaults; ++f)
      if (world_.weather.until_ns[f] > world_.now_ns) ++world_.totals.injected[f][now];
  }
  if (world_.mono_held_ns != 0 && world_.now_ns >= mono_released_ns_) {
    world_.mono_offset_ns = world_.mono_held_ns - world_.now_ns;
    world_.mono_held_ns = 0;
  }
  if (config_broken_ && world_.now_ns >= repaired_ns_) {
    config_broken_ = false;
    stop_ = true;  // the repair ends with a restart of the service
  }
  for (Episode& e : episodes_) {
    if (e.fired || world_.now_ns < e.from_ns) continue;
    if (e.state != kAnyState && e.state != now && world_.now_ns < e.from_ns + 90 * kSecond) continue;
    fire(e);
  }
  episodes_.insert(episodes_.end(), sequels_.begin(), sequels_.end());
  sequels_.clear();
}

void Life::fire(Episode& e) {
  e.fired = true;
  ++world_.totals.injected[static_cast<std::size_t>(e.fault)][state()];
  world_.trace.line(world_.now_ns, "fault: %s in state \"%s\"", name(e.fault).data(), state_name(state()).data());
  const std::int64_t until_ns = world_.now_ns + e.lasts_ns;
  switch (e.fault) {
    case Fault::clock_ahead: world_.utime_offset_us += 3'600'000'000; break;
    case Fault::clock_back: world_.utime_offset_us -= 3'600'000'000; break;
    case Fault::clock_stall:
      if (world_.mono_held_ns == 0) world_.mono_held_ns = world_.mono_ns();
      mono_released_ns_ = until_ns;
      break;
    case Fault::process_pause:
      if (process_ != nullptr) process_->hold(until_ns);
      break;
    case Fault::torn_write:
    case Fault::kill_at_write:
      power_after_ = e.fault == Fault::torn_write;
      if (process_ != nullptr) {
        const std::int64_t call = between(chance_, 1, 60);
        disk_.kill_at(call, happens(chance_, 0.7));
      } else {
        kill_in_boot_ = between(chance_, 1, 150);
      }
      break;
    case Fault::allocation:
      fail_allocation_ = between(chance_, 1, happens(chance_, 0.5) ? 60 : 3'000);
      if (process_ != nullptr) bury(false);
      break;
    case Fault::kill:
      if (process_ != nullptr) bury(false);
      break;
    case Fault::power_loss:
      if (process_ != nullptr) bury(true);
      break;
    case Fault::config_reload: {
      // An edited recipe, then a restart of the service.
      Recipe& recipe = recipes_[chance_.below(recipes_.size())];
      std::string sha(recipe.sha256.view());
      sha[0] = sha[0] == '0' ? '1' : '0';
      recipe.sha256 = std::string_view(sha);
      stop_ = true;
      break;
    }
    case Fault::config_broken:
      config_broken_ = true;
      repaired_ns_ = until_ns + 20 * kSecond;
      stop_ = true;
      break;
    case Fault::plc_restart: plc_.restart(); break;
    case Fault::plc_abort: plc_.wishes.abort = true; break;
    case Fault::plc_slab_abort:
      // While blocks are still being measured or the slab is being judged, or earlier.
      if (happens(chance_, 0.5))
        plc_.wishes.abort_after_end_ns = between(chance_, 0, 600 * kMs);
      else
        plc_.wishes.slab_abort = true;
      break;
    case Fault::plc_disable: plc_.wishes.disabled_until_ns = until_ns; break;
    case Fault::plc_report: plc_.wishes.report = true; break;
    case Fault::plc_rescan: plc_.wishes.rescan = true; break;
    case Fault::scanner_wrong_block: plc_.wishes.wrong_station = true; break;
    case Fault::robot_moves:
      world_.weather.until_ns[static_cast<std::size_t>(e.fault)] = until_ns;
      // Two faults at once: the poses that would show the motion are lost, or old ones arrive.
      if (happens(chance_, 0.5)) {
        const auto first = static_cast<std::size_t>(Fault::lcm_loss);
        const std::size_t also = first + chance_.below(static_cast<std::size_t>(Fault::robot_moves) - first);
        world_.weather.until_ns[also] = until_ns;
        ++world_.totals.injected[also][state()];
      }
      break;
    case Fault::disk_fsync:
    case Fault::disk_eio:
      world_.weather.until_ns[static_cast<std::size_t>(e.fault)] = until_ns;
      // The damage appears when the power fails, before or after the next process has used the disk.
      if (happens(chance_, 0.3))
        sequels_.push_back({Fault::kill, until_ns - between(chance_, 0, kSecond), kAnyState, 0, false});
      if (happens(chance_, 0.3))
        sequels_.push_back({Fault::power_loss, until_ns + between(chance_, 0, 10 * kSecond), kAnyState, 0, false});
      break;
    default: world_.weather.until_ns[static_cast<std::size_t>(e.fault)] = until_ns; break;
  }
}

// ---- the end of a life: no more faults ---------------------------------------------------------------------------

void Life::begin_calm() {
  calm_ = true;
  calm_ns_ = world_.now_ns;
  world_.weather.clear();
  for (Episode& e : episodes_) e.fired = true;
  if (world_.mono_held_ns != 0) mono_released_ns_ = world_.now_ns;
  if (config_broken_) repaired_ns_ = world_.now_ns;
  plc_.wishes = {};
  disk_.kill_at(0, false);
  power_after_ = false;
  fail_allocation_ = kill_in_boot_ = 0;
  plc_.next_is_good = true;
  world_.trace.line(world_.now_ns, "from here on nothing goes wrong");
}

void Life::check_calm() {
  if (calm_slab_no_ == 0 && plc_.line_is_empty()) calm_slab_no_ = line_.slab.slab_no + 1;
  if (world_.now_ns - calm_ns_ < kCalmTimeout) return;
  ++world_.totals.stuck;
  world_.violated("the line is stuck: no good slab has passed within %lld s without a fault (state %s, fault %u)",
                  static_cast<long long>(kCalmTimeout / kSecond), state_name(state()).data(), plc_.seen().fault);
}

// ---- time --------------------------------------------------------------------------------------------------------

std::int64_t Life::next_ns() const {
  std::int64_t next = std::min(plc_.next_ns(), world_.now_ns + 500 * kMs);
  if (process_ != nullptr)
    next = std::min(next, process_->next_ns());
  else
    next = std::min(next, boot_at_ns_);
  return std::max(next, world_.now_ns);
}

LifeResult Life::run() {
  boot();
  while (world_.violation.empty() && calm_verdict_ == Verdict::none) {
    world_.now_ns = next_ns();
    trigger_faults();
    manage_service();
    if (process_ != nullptr) process_->run_due();
    plc_.act();
    if (process_ != nullptr && wire_.next_request_ns() != kNever && !process_->dead() && loop_thread_ != nullptr)
      loop_thread_->wake_ns = std::min(loop_thread_->wake_ns, std::max(world_.now_ns + kMs, wire_.next_request_ns()));
    if (!calm_ && world_.now_ns >= faults_end_ns_) begin_calm();
    if (calm_) check_calm();
  }
  if (world_.violation.empty() && calm_verdict_ != Verdict::pass)
    world_.violated("a good slab without any fault ended as %s", name(calm_verdict_).data());
  world_.totals.seeds = 1;
  world_.totals.failed = world_.violation.empty() ? 0 : 1;
  world_.totals.simulated_ns = world_.now_ns;
  LifeResult result;
  result.hash = world_.trace.hash();
  result.violation = world_.violation;
  result.totals = world_.totals;
  result.last_lines.assign(world_.trace.last_lines().begin(), world_.trace.last_lines().end());
  return result;
}

}  // namespace

std::vector<Recipe> life_recipes() {
  std::vector<config::Problem> problems;
  Recipe whole;
  config::load_recipe(places::source_dir() + "/recipes/p5600.toml", whole, problems);
  if (!problems.empty()) {
    std::printf("%s\n", problems[0].text.c_str());
    std::exit(3);
  }
  // Six pairs are the minimum for a slab frame; a life then contains more slabs.
  Recipe small = whole;
  small.name = "P3710";
  small.slab_type = 3710;
  small.sha256 = "d1";
  small.sha256.append(whole.sha256.view().substr(2));
  small.slab.pairs = 6;
  small.slab.length_mm.value = 3710;
  return {small, whole};
}

LifeResult live(std::uint64_t seed, const std::vector<Recipe>& recipes, bool loud, int robots) {
  fs::remove_all("data");
  fs::remove_all(kSpool);
  Life life(seed, recipes, loud, robots);
  return life.run();
}

std::string enter_own_folder() {
  for (const char* base : {"/dev/shm", "/tmp"}) {
    std::string path = std::string(base) + "/slabd-sim-XXXXXX";
    if (mkdtemp(path.data()) == nullptr) continue;
    if (chdir(path.c_str()) == 0) return path;
  }
  std::printf("no folder for the simulated disk can be made\n");
  std::exit(5);
}

}  // namespace slabd::sim
