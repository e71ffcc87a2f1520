// SPDX-License-Identifier: Apache-2.0
#include "daemon/loop.h"

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <thread>
#include <utility>

#include "base/rules.h"
#include "daemon/control/calibration_changer.h"
#include "daemon/log_outlet.h"
#include "daemon/measure.h"
#include "daemon/station/parts.h"

namespace slabd::daemon {
namespace {

constexpr std::int64_t kWatchdogPeriod_ns = 3 * kNsPerS;
/// Time after which a worker without a sign of life counts as stuck; the service manager's watchdog then ends the
/// process. Longer than any scan timeout and than a sync of a slow disk.
constexpr std::int64_t kWorkerStuck_ns = 60 * kNsPerS;
/// Time after which a block is given up (405). By counted work alone no block takes longer than some seconds
/// (limits::kDenoiseLooksMax), so this is for a computer that is ten times too slow.
constexpr std::int64_t kMeasuringMax_ns = 15 * kNsPerS;

}  // namespace

Code fault_without_store(const Error& why) {
  if (why.code == Code::busy) return Code::config;
  return why.code == Code::store_full ? Code::store_full : Code::journal_write;
}

Loop::Loop(const Ports& ports, const StationSettings& settings, StoreOpener open, const ScanForms& scan_forms,
           int measure_threads, LoopFigures figures)
    : Loop(ports, settings, std::move(open),
           make_workers(settings.recipes, scan_forms, ports.clock, measure_threads, settings.simulation),
           std::move(figures)) {}

Loop::Loop(const Ports& ports, const StationSettings& settings, StoreOpener open, std::unique_ptr<Workers> workers,
           LoopFigures figures)
    : ports_(ports),
      line_arms_(settings.arms),
      figures_(std::move(figures)),
      station_(std::make_unique<Station>(settings)),
      actions_(std::make_unique<Actions>()),
      follow_up_(std::make_unique<Event>()),
      blocks_(limits::kStationsMax),
      judged_(std::make_unique<SlabJudged>()),
      workers_(std::move(workers)),
      open_(std::move(open)),
      calibration_changer_(change_folder(figures_.db_path)) {
  if (figures_.started_ns == 0) figures_.started_ns = ports_.clock.mono_ns();
  store_worker_ = workers_->storage([this](const StoreTask& task) { return do_task(task); }, [this] { idle_store(); });
  assert(ports_.arms() == line_arms_.list.size());
  for (std::size_t arm = 0; arm < ports_.arms(); ++arm)
    scan_workers_[arm] = workers_->scanner(
        arm, [this](const AcquireScan& job) { return scan(job); }, [this, arm] { idle_scanner(arm); });
  measure_worker_ = workers_->measuring();
  (void)events_.push({storage::LineEvent::Kind::started, Code::ok, ports_.clock.utime_us()});
}

Loop::~Loop() {
  for (LoopArm& arm : arms_) arm.cancel_scan = true;
}

void Loop::start() {
  if (const Code fault = station_->settings.fault; fault == Code::ok)
    order_store();
  else
    handle(NotRecovered{fault});
  ports_.notify.ready();
}

/// A new station takes the place of the present one, because the commands refused without a store must leave no trace.
/// It is made in place: a temporary of 1.9 MB would stay resident on the stack, and the loop requests no memory.
void Loop::order_store() {
  if (!store_worker_->push(OpenStore{})) return;
  StationSettings settings = station_->settings;
  settings.fault = Code::ok;
  const LineGauges gauges = station_->gauges;  // what has arrived keeps its time of arrival
  std::destroy_at(station_.get());
  std::construct_at(station_.get(), settings);
  station_->gauges.samples = gauges.samples;
  station_->gauges.masters = gauges.masters;
  station_->gauges.plc_seq = gauges.plc_seq;
  station_->gauges.plc_seen = gauges.plc_seen;
  figures_.opening = true;
  fault_was_reset_ = false;
  reopen_ns_.reset();
}

void Loop::take_store() {
  figures_.opening = false;
  if (recovered_.ok()) {
    ports_.store = store_.get();
    figures_.store_text.clear();
    const std::unique_ptr<RecoveredLine> line = std::move(recovered_.value());
    workers_->remember(line->noise);
    handle(Recovered{line.get()});
    return;
  }
  const Error& why = recovered_.error();
  const Code fault = fault_without_store(why);
  say({LogLine::Level::error, static_cast<std::uint16_t>(fault), why.text});
  figures_.store_text = why.text;
  if (holds(Rule::store_retried)) reopen_ns_ = ports_.clock.mono_ns() + store_patience_ns_;
  // Another daemon may end at any time.
  store_patience_ns_ =
      why.code == Code::busy ? kStorePatience_ns : std::min(2 * store_patience_ns_, kStorePatienceMax_ns);
  handle(NotRecovered{fault});
}

void Loop::finish() {
  ports_.notify.stopping();
  for (LoopArm& arm : arms_) arm.cancel_scan = true;
  store_worker_->drain();
  abandon_measurements();
  while (delete_one()) continue;
}

/// An orderly shutdown removes the marks of measurements, so that the next process may measure these scans again.
void Loop::abandon_measurements() {
  if (ports_.store == nullptr) return;
  const Station& s = *station_;
  const auto give_up = [this](const Attempt& attempt) {
    const MeasuringJob job{attempt.slab_key, attempt.station, attempt.number, 0};
    (void)store_worker_->push(StoreJob{kNoJobTicket, job});
  };
  if (s.acquisition.phase == Acquisition::Phase::storing) give_up(s.acquisition.attempt);
  for (std::size_t i = 0; i < s.station_measuring.size(); ++i)
    if (s.station_measuring[i]) give_up(s.slab.stations[i].attempt);
  store_worker_->drain();
}

bool Loop::wait_for_scanner_thread() {
  for (LoopArm& arm : arms_) arm.cancel_scan = true;
  for (std::size_t arm = 0; arm < ports_.arms(); ++arm) {
    const ScanQueue& worker = *scan_workers_[arm];
    for (const std::uint64_t before = worker.turns(); worker.turns() == before;) {
      if (ports_.scanner_of(arm).hangs()) return false;
      std::this_thread::sleep_for(std::chrono::milliseconds(kTurn_ms));
    }
  }
  return true;
}

void Loop::turn(int wait_ms) {
  wait(wait_ms);
  serve();
}

void Loop::serve() {
  tick();
  take_gauges();
  for (std::size_t arm = 0; arm < ports_.arms(); ++arm) take_poses(arm);
  take_answers();
  serve_plc();
  serve_control();
  feed_watchdog();
}

void Loop::wait(int wait_ms) {
  std::array<pollfd, hal::kPlcPollFds + hal::kControlPollFds + 2 + 2 * limits::kArmsMax> fds{};
  std::size_t count = ports_.plc.poll_fds(std::span(fds).first(hal::kPlcPollFds));
  if (ports_.control != nullptr) count += ports_.control->poll_fds(std::span(fds).subspan(count, hal::kControlPollFds));
  const auto add = [&](int fd) {
    if (fd >= 0) fds[count++] = {fd, POLLIN, 0};
  };
  add(store_worker_->fd());
  add(measure_worker_->fd());
  for (std::size_t arm = 0; arm < ports_.arms(); ++arm) {
    add(ports_.pose_of(arm).fd());
    add(scan_workers_[arm]->fd());
  }
  ::poll(fds.data(), count, wait_ms);
}

void Loop::tick() {
  handle(Tick{ports_.clock.mono_ns(), ports_.clock.utime_us()});
  const bool recipes_differ = ports_.recipes != nullptr && ports_.recipes->differs();
  for (std::size_t arm = 0; arm < ports_.arms(); ++arm) {
    const hal::ScannerPort& scanner = ports_.scanner_of(arm);
    handle(LinkStatus{scanner.online(), scanner.hangs(), scanner.stray_files(), scanner.spool_hangs(), recipes_differ,
                      static_cast<std::uint8_t>(arm)});
  }
  if (ports_.recipes != nullptr && !is_opening()) apply_reloaded_recipes();
  if (ports_.designs != nullptr) apply_new_designs();
  look_for_another_daemon();
  note_fault();
  if (reopen_ns_ && (fault_was_reset_ || ports_.clock.mono_ns() >= *reopen_ns_)) order_store();
}

void Loop::take_gauges() {
  if (ports_.gauges == nullptr) return;
  ports_.gauges->newest(gauge_samples_);
  handle(GaugesSampled{&gauge_samples_});
  LogLine line;
  line.level = LogLine::Level::warning;
  if (ports_.gauges->next_note(ports_.clock.mono_ns(), line.text)) say(line);
}

void Loop::take_poses(std::size_t arm) {
  hal::PosePort& port = ports_.pose_of(arm);
  PoseSample sample;
  for (std::size_t i = 0; i < limits::kPosesPerTurn && port.next(ports_.clock.mono_ns(), sample); ++i) {
    sample.arm = static_cast<std::uint8_t>(arm);
    handle(sample);
  }
  if (const std::string_view trouble = port.trouble(); arms_[arm].pose_trouble.is_news(trouble)) {
    LogLine line;
    line.level = trouble.empty() ? LogLine::Level::info : LogLine::Level::error;
    line.code = static_cast<std::uint16_t>(trouble.empty() ? Code::ok : Code::no_pose);
    line.text = trouble.empty() ? "robot pose link is up" : trouble;
    say_of(arm, line);
  }
  log_pose_changes(arm);
}

void Loop::take_answers() {
  StoreAnswer answer;
  while (store_worker_->next(answer)) {
    if (const auto* stored = std::get_if<StoreDone>(&answer))
      take_stored(*stored);
    else if (std::holds_alternative<ChangeCalibration>(answer))
      take_change();
    else
      take_store();
  }
  ScanDone scanned;
  for (std::size_t arm = 0; arm < ports_.arms(); ++arm) {
    while (scan_workers_[arm]->next(scanned)) handle(scanned);
    log_scanner_changes(arm);
  }
  BlockMeasured measured;
  while (measure_worker_->next(measured)) {
    ++figures_.blocks_measured;
    figures_.block_last_ms = measured.block.times.total_ms;
    figures_.block_max_ms = std::max(figures_.block_max_ms, figures_.block_last_ms);
    handle(measured);
  }
}

void Loop::take_stored(const StoreDone& stored) {
  // The text stays until the next failure, as the fault does.
  const bool is_lost = stored.code == Code::journal_write || stored.code == Code::store_full;
  if (is_lost && !stored.text.empty()) figures_.store_text = stored.text;
  if (stored.ticket != kNoJobTicket) {
    figures_.commit_last_ms = stored.commit_ms;
    figures_.commit_max_ms = std::max(figures_.commit_max_ms, stored.commit_ms);
  }
  handle(stored);
}

void Loop::take_change() {
  if (const CellCalibration* calibration = calibration_changer_.finish()) handle(CalibrationChanged{calibration});
  if (const storage::DispositionRecord* kept = calibration_changer_.disposition())
    handle(DispositionKept{kept->slab_key, kept->decision});
  if (const GaugeCheck* const check = calibration_changer_.gauge_check()) handle(GaugeChecked{*check});
  LogLine line;
  line.level = calibration_changer_.succeeded() ? LogLine::Level::info : LogLine::Level::warning;
  line.text = calibration_changer_.summary().view();
  say(line);
}

void Loop::serve_plc() {
  ports_.plc.publish(plc_view(*station_));
  PlcInputs inputs;
  // Every write is one event; bounded, so that a PLC that only writes cannot block the loop.
  for (std::size_t i = 0; i < limits::kModbusClientsMax * limits::kModbusFramesPerTurn; ++i) {
    if (!ports_.plc.next(ports_.clock.mono_ns(), inputs)) break;
    // A level held down is not a reset: only the edge counts, as for every other fault.
    const bool held = std::exchange(fault_reset_held_, inputs.fault_reset);
    fault_was_reset_ = fault_was_reset_ || (inputs.fault_reset && !held);
    handle(inputs);
    ports_.plc.publish(plc_view(*station_));
  }
  log_plc_changes();
}

void Loop::serve_control() {
  if (ports_.control == nullptr) return;
  std::string_view line;
  for (std::size_t i = 0; i < limits::kControlClientsMax && ports_.control->next(ports_.clock.mono_ns(), line); ++i)
    ports_.control->reply(answer_control(line, *station_, ports_, figures_, calibration_changer_,
                                         [this](const Event& event) { handle(event); }));
  if (calibration_changer_.is_waiting() && store_worker_->push(ChangeCalibration{})) calibration_changer_.started();
}

void Loop::feed_watchdog() {
  constexpr std::size_t kStore = 0;
  constexpr std::size_t kMeasure = 1;
  constexpr std::size_t kScanner = 2;  // of arm 0
  const std::int64_t now_ns = ports_.clock.mono_ns();
  bool alive = true;
  for (std::size_t i = 0; i < kScanner + ports_.arms(); ++i) {
    const bool is_scanner = i >= kScanner;
    const std::uint64_t turns = i == kStore     ? store_worker_->turns()
                                : i == kMeasure ? measure_worker_->turns()
                                                : scan_workers_[i - kScanner]->turns();
    if (turns != worker_turns_[i] || worker_moved_ns_[i] == 0) worker_moved_ns_[i] = now_ns;
    worker_turns_[i] = turns;
    // A large database takes minutes to open. A share that hangs is reported (301) and recovers with its server;
    // restarting slabd would not help.
    if ((i == kStore && is_opening()) || (is_scanner && ports_.scanner_of(i - kScanner).hangs()))
      worker_moved_ns_[i] = now_ns;
    alive = alive && now_ns - worker_moved_ns_[i] < kWorkerStuck_ns;
  }
  const bool long_at_it = now_ns - worker_moved_ns_[kMeasure] >= kMeasuringMax_ns;
  if (long_at_it && !measuring_given_up_) workers_->give_up_measuring();
  measuring_given_up_ = long_at_it;
  if (!alive || now_ns - watchdog_ns_ < kWatchdogPeriod_ns) return;
  watchdog_ns_ = now_ns;
  ports_.notify.watchdog();
  if (is_opening()) return ports_.notify.status("the database is being opened and checked");
  FixedString<160> line;
  const PlcOutputs view = plc_view(*station_);
  line.printf("state %u, fault %u, slab %u, stations %u, results waiting %u", static_cast<unsigned>(view.state),
              view.fault, view.slab_no, view.stations_done, view.results_pending);
  ports_.notify.status(line.view());
}

void Loop::handle(const Event& event) {
  step(*station_, event, *actions_);
  for (const Action& action : *actions_) perform(action);
  while (has_follow_up_) {
    has_follow_up_ = false;
    step(*station_, *follow_up_, *actions_);
    for (const Action& action : *actions_) perform(action);
  }
}

void Loop::perform(const Action& action) {
  bool accepted = true;
  if (const auto* job = std::get_if<StoreJob>(&action)) {
    accepted = store_worker_->push(*job);
  } else if (const auto* scan = std::get_if<AcquireScan>(&action)) {
    arms_[scan->arm].cancel_scan = false;
    accepted = scan_workers_[scan->arm]->push(*scan);
  } else if (const auto* cancel = std::get_if<CancelScan>(&action)) {
    arms_[cancel->arm].cancel_scan = true;
  } else if (const auto* block = std::get_if<MeasureBlock>(&action)) {
    accepted = measure_worker_->push(*block);
  } else if (const auto* judge = std::get_if<JudgeSlab>(&action)) {
    judge_slab(*judge);
  } else if (const auto* drop = std::get_if<DropScan>(&action)) {
    if (!delete_later(drop->path)) delete_file(drop->path);
  } else if (const auto* tidy = std::get_if<TidyCaptures>(&action)) {
    tidy_captures_later(tidy->folder);
  } else if (const auto* line = std::get_if<LogLine>(&action)) {
    say(*line);
  }
  if (!accepted) {
    // The station keeps fewer jobs in progress than the queues hold, so an overflow is a broken invariant.
    put_log("<2>slabd: a worker's queue overflowed\n");
    (void)flush_log(200);
    std::abort();
  }
}

void Loop::judge_slab(const JudgeSlab& action) {
  judged_->slab_key = action.slab_key;
  judged_->slab = {};
  daemon::judge_slab(action.basis, station_->slab.stations, blocks_, judged_->slab);
  *follow_up_ = *judged_;
  has_follow_up_ = true;
}

}  // namespace slabd::daemon
