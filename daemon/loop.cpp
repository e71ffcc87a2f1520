// SPDX-License-Identifier: Apache-2.0
#include "daemon/loop.h"

#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <thread>
#include <utility>

#include "base/plain_text.h"
#include "base/rules.h"
#include "daemon/control/calibration_changer.h"
#include "daemon/log_outlet.h"
#include "daemon/measure.h"
#include "daemon/slab_ends.h"
#include "daemon/station/parts.h"
#include "hal/system/journal.h"
#include "storage/chain.h"

namespace slabd::daemon {
namespace {

constexpr std::int64_t kWatchdogPeriod_ns = 3 * kNsPerS;
/// Time after which a worker without a sign of life counts as stuck; the service manager's watchdog then ends the
/// process. Longer than any scan timeout and than a sync of a slow disk.
constexpr std::int64_t kWorkerStuck_ns = 60 * kNsPerS;
/// Time after which a block is given up (405). By counted work alone no block takes longer than some seconds
/// (limits::kDenoiseLooksMax), so this is for a computer that is ten times too slow.
constexpr std::int64_t kMeasuringMax_ns = 15 * kNsPerS;
/// Duration after which a state of the PLC link is logged, and age of the last line after which it is logged in any
/// case.
constexpr std::int64_t kPlcNews_ns = kNsPerS;
constexpr std::int64_t kPlcNewsPeriod_ns = 60 * kNsPerS;
constexpr std::int64_t kScannerNews_ns = 2 * kNsPerS;
constexpr std::int64_t kScannerNewsPeriod_ns = 10 * kNsPerS;
/// Views not fetched within a week are deleted; the operator repeats a calibration that is interrupted for longer.
constexpr std::int64_t kCaptureKept_us = 7 * 86'400'000'000LL;

/// Returns an error if there is not enough memory for a text: the job fails, but the daemon continues.
template <typename Work>
auto or_failed(const Work& work) -> decltype(work()) {
  try {
    return work();
  } catch (const std::exception& e) {
    return error(Code::internal, "%s", e.what());
  }
}

/// The same for work that is retried ten times a second.
template <typename Work>
void or_later(const Work& work) {
  try {
    work();
  } catch (const std::exception&) {
  }
}

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
  store_worker_ = workers_->storage([this](const StoreTask& task) { return do_task(task); },
                                    [this] {
                                      delete_one();
                                      if (store_ == nullptr) return;
                                      or_later([this] { keep_events(); });
                                      or_later([this] { store_->idle(); });
                                      tell_store_trouble();
                                    });
  assert(ports_.arms() == line_arms_.list.size());
  for (std::size_t arm = 0; arm < ports_.arms(); ++arm)
    scan_workers_[arm] = workers_->scanner(
        arm, [this](const AcquireScan& job) { return scan(job); },
        [this, arm] {
          if (scanner_is_ours_) or_later([this, arm] { ports_.scanner_of(arm).idle(); });
        });
  measure_worker_ = workers_->measuring();
  (void)events_.push({storage::LineEvent::Kind::started, Code::ok, ports_.clock.utime_us()});
}

Loop::~Loop() {
  for (LoopArm& arm : arms_) arm.cancel_scan = true;
}

// ---- on the workers' threads -------------------------------------------------------------------------------------

StoreAnswer Loop::do_task(const StoreTask& task) {
  if (const auto* job = std::get_if<StoreJob>(&task)) return store(*job);
  if (std::holds_alternative<ChangeCalibration>(task)) {
    calibration_changer_.carry_out(store_.get());
    return ChangeCalibration{};
  }
  open_store();
  return OpenStore{};
}

void Loop::open_store() {
  recovered_ = or_failed([this]() -> Result<std::unique_ptr<RecoveredLine>> {
    Result<std::unique_ptr<storage::Store>> made = open_(scanner_is_ours_);
    if (!made.ok()) return made.error();
    store_ = std::move(made.value());
    return store_->recover();
  });
  if (!recovered_.ok()) store_ = nullptr;  // data that could not be read must not be overwritten
}

StoreDone Loop::store(const StoreJob& job) {
  StoreDone done;
  done.ticket = job.ticket;
  if (store_ == nullptr) {
    // Commands are refused in this state because of the fault; only the session number may be shown.
    done.code = std::holds_alternative<SessionJob>(job.what) ? Code::ok : Code::journal_write;
    return done;
  }
  const std::int64_t start_ns = ports_.clock.mono_ns();
  const Status status = or_failed([&] { return store_->apply(job); });
  done.commit_ms = ms_from_ns(ports_.clock.mono_ns() - start_ns);
  if (!status.ok()) {
    done.code = status.error().code;
    done.text = status.error().text;
    say({LogLine::Level::error, static_cast<std::uint16_t>(done.code), status.error().text});
  }
  if (const auto* end = std::get_if<SlabJob>(&job.what); end != nullptr && status.ok()) note_chain(end->slab_key);
  if (spool_trouble_.is_news(store_->spool_trouble()) && !spool_trouble_.seen().empty())
    say({LogLine::Level::warning, static_cast<std::uint16_t>(Code::store_full), spool_trouble_.seen()});
  return done;
}

void Loop::keep_events() {
  std::vector<storage::LineEvent> events;
  {
    const std::lock_guard lock(events_guard_);
    for (const NotedEvent& event : events_)
      events.push_back({event.kind, static_cast<std::uint16_t>(event.code),
                        std::string(event.code == Code::ok ? software_version().view() : describe(event.code)),
                        event.utime_us});
  }
  if (events.empty() || !store_->keep_events(events).ok()) return;
  const std::lock_guard lock(events_guard_);
  FixedVector<NotedEvent, kEventsMax> later;
  for (std::size_t i = events.size(); i < events_.size(); ++i) (void)later.push(events_[i]);
  events_ = later;
}

/// The journal is evidence outside of the database.
void Loop::note_chain(std::int64_t slab_key) {
  const storage::ChainHead head = storage::chain_head(*store_);
  if (head.entries == 0) return;
  LogLine line{LogLine::Level::info, static_cast<std::uint16_t>(Code::ok), {}};
  line.text.printf("slab key %lld is sealed: entry %lld of the chain of results, SHA-256 %s",
                   static_cast<long long>(slab_key), static_cast<long long>(head.entries), head.sha256.c_str());
  say(line);
}

void Loop::tell_store_trouble() {
  const std::string_view trouble = store_->trouble();
  if (store_trouble_.is_news(trouble)) {
    if (trouble.empty())
      say({LogLine::Level::info, static_cast<std::uint16_t>(Code::ok), "the database is in its place again"});
    else
      say({LogLine::Level::error, static_cast<std::uint16_t>(Code::journal_write), trouble});
  }
  if (trouble.empty()) return;
  // Posted repeatedly, because a fault that was reset must come back as long as its cause remains.
  StoreDone lost;
  lost.ticket = kNoJobTicket;
  lost.code = Code::journal_write;
  lost.text = trouble;
  (void)store_worker_->post(lost);
}

std::uint64_t fingerprint_of(std::span<const float> xyz) {
  constexpr std::size_t kLooks = 8'191;
  std::uint64_t hash = xyz.size() + 1;
  std::size_t step = xyz.size() / kLooks + 1;
  if (step % 3 == 0) ++step;  // x alone may be the same in every scan, as for parallel rays
  for (std::size_t i = 0; i < xyz.size(); i += step)
    hash = (hash ^ std::bit_cast<std::uint32_t>(xyz[i])) * 0x9E3779B97F4A7C15U ^ (hash >> 31U);
  return hash | 1U;
}

ScanDone Loop::scan(const AcquireScan& job) {
  ScanDone done;
  done.cmd_seq = job.request.cmd_seq;
  done.slot = job.slot;
  done.arm = job.arm;
  std::atomic<bool>& cancel = arms_[job.arm].cancel_scan;
  // Measuring need not wait for the disk. If this early event cannot be posted, it begins when the scan is durable.
  const std::span<float> xyz = workers_->slot(job.slot);
  const auto decoded = [this, &done, xyz](const AcquiredScan& scan) {
    done.scan = scan;
    const std::span<const float> points = xyz.first(std::min(3 * scan.shape.points, xyz.size()));
    done.fingerprint = fingerprint_of(points);
    // From here on the buffer belongs to the measurement, which changes it. Scans in records are read again below,
    // which is fast. For all others the checksum takes a twentieth of the reading time.
    if (!scan.shape.in_records) done.points_crc32c = hal::points_crc32c(points);
    (void)scan_workers_[done.arm]->post(done);
  };
  const Result<AcquiredScan> result =
      or_failed([&] { return ports_.scanner_of(job.arm).acquire(job.request, xyz, cancel, decoded); });
  done.durable = true;
  if (result.ok()) {
    done.scan = result.value();
    if (done.scan.shape.in_records && !cancel) done.points_crc32c = workers_->points_crc32c(done.scan, job.arm);
  } else {
    done.code = result.error().code;
    done.text = result.error().text;
    say_of(job.arm, {LogLine::Level::warning, static_cast<std::uint16_t>(done.code), result.error().text});
  }
  return done;
}

// ---- on the loop's thread ----------------------------------------------------------------------------------------

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

/// Faults are events for the plant's database. A fault that lasts less than a second is not one.
void Loop::note_fault() {
  constexpr std::int64_t kLasts_ns = kNsPerS;
  const auto code = static_cast<std::uint16_t>(current_fault(*station_));
  const std::uint16_t before = fault_told_;
  if (!fault_seen_.is_news(code, ports_.clock.mono_ns(), {.lasts_ns = kLasts_ns})) return;
  fault_told_ = code;
  const std::int64_t now_us = ports_.clock.utime_us();
  const std::lock_guard lock(events_guard_);
  using Kind = storage::LineEvent::Kind;
  if (before != 0) (void)events_.push({Kind::cleared, static_cast<Code>(before), now_us});
  if (code != 0) (void)events_.push({Kind::fault, static_cast<Code>(code), now_us});
}

/// Two daemons with one drop folder take each other's scans, so the second one stays in fault until the first has
/// ended.
void Loop::look_for_another_daemon() {
  if (ports_.store == nullptr) return;  // the fault of the store is shown
  Code& fault = station_->settings.fault;
  hal::ScannerText text;
  for (std::size_t arm = 0; arm < ports_.arms() && text.empty(); ++arm) text = ports_.scanner_of(arm).used_by_another();
  if (text.empty() == !scanner_is_anothers_) return;
  scanner_is_anothers_ = !text.empty();
  fault = scanner_is_anothers_ ? Code::config : Code::ok;
  if (scanner_is_anothers_)
    say({LogLine::Level::error, static_cast<std::uint16_t>(fault), text.view()});
  else
    say({LogLine::Level::info, static_cast<std::uint16_t>(fault), "the drop folder is this daemon's alone"});
}

/// Design sheets are frozen with a slab at its begin, so that new ones may come at any time but while one is stored.
void Loop::apply_new_designs() {
  Station& s = *station_;
  if (s.command.pending) return;
  const std::shared_ptr<const config::DesignSet> next = ports_.designs->newer_than(designs_in_use_);
  if (next == nullptr) return;
  const bool is_first = designs_in_use_ == nullptr;
  designs_in_use_ = next;
  s.settings.designs = next->sheets;
  s.settings.designs_faulty = !next->problems.empty();
  LogLine line;
  if (!is_first || !next->sheets.empty()) {
    line.level = LogLine::Level::info;
    line.text.printf("design sheets of %zu slabs are in use", next->sheets.size());
    say(line);
  }
  if (next->problems.empty()) return;
  line.level = LogLine::Level::warning;
  line.text.printf("%zu faults in the design sheets; a file with a fault is not used: %s", next->problems.size(),
                   next->problems.front().text.c_str());
  say(line);
}

/// Loads new recipes between two slabs, once the last slab is finished.
void Loop::apply_reloaded_recipes() {
  Station& s = *station_;
  LogLine line;
  if (const bool differs = ports_.recipes->differs(); recipes_differ_.is_news(differs)) {
    line.level = differs ? LogLine::Level::warning : LogLine::Level::info;
    line.text = differs ? ports_.recipes->words() : RecipeWatch::Text("the recipe folder holds what is in use");
    say(line);
  }
  if (ports_.recipes->next_note(line.text)) {
    line.level = LogLine::Level::warning;
    say(line);
  }
  std::shared_ptr<const RecipeSet> next = ports_.recipes->checked();
  if (next == nullptr) return;
  const bool idle = s.recovered && s.settings.fault == Code::ok && s.slab.phase == SlabPhase::none &&
                    !s.command.pending && s.acquisition.phase == Acquisition::Phase::none && s.measuring == 0 &&
                    std::none_of(s.slot_busy.begin(), s.slot_busy.end(), [](bool busy) { return busy; });
  if (!idle) {
    ports_.recipes->refuse(
        s.settings.fault != Code::ok
            ? "slabd is in fault 504, which only a restart clears"
            : "a slab is open, or a scan or a measurement of one is under way; the recipes in use stay "
              "in force until it has ended");
    return;
  }
  s.slab.recipe = nullptr;
  s.settings.recipes = next->recipes;
  s.settings.warn = static_cast<std::uint16_t>(s.settings.warn & ~(kWarnUnconfirmedNominals | kWarnRecipeUnusable));
  for (const Recipe& recipe : next->recipes)
    if (unconfirmed_count(recipe) > 0) s.settings.warn |= kWarnUnconfirmedNominals;
  workers_->use_recipes(next->recipes);
  if (ports_.store != nullptr) ports_.store->use_recipes(next->texts);
  recipes_in_use_ = next;
  ports_.recipes->taken_up();
  line.level = LogLine::Level::info;
  line.text.printf("%zu recipes were taken up; the next slab begins with them", next->recipes.size());
  say(line);
  line.level = LogLine::Level::warning;
  for (const AlikeRecipes& alike : alike_recipes(next->recipes)) {
    line.text = text_of(alike);
    say(line);
  }
}

void Loop::take_gauges() {
  if (ports_.gauges == nullptr) return;
  ports_.gauges->newest(gauge_samples_);
  handle(GaugesSampled{&gauge_samples_});
  LogLine line;
  line.level = LogLine::Level::warning;
  if (ports_.gauges->next_note(ports_.clock.mono_ns(), line.text)) say(line);
}

void Loop::say_of(std::size_t arm, LogLine line) const {
  if (line_arms_.several()) {
    const Arm& by = line_arms_.list[arm];
    const FixedString<limits::kErrorTextBytes> text = line.text;
    line.text.printf("robot %s, scanner %s: %s", by.robot.c_str(), by.scanner.c_str(), text.c_str());
  }
  say(line);
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

void Loop::log_pose_changes(std::size_t arm) {
  const std::int64_t now_ns = ports_.clock.mono_ns();
  const PoseGate& gate = station_->arms[arm].gate;
  LoopArm& seen = arms_[arm];
  const Code code = gate.link(now_ns);
  if (code != seen.pose_link.seen()) {
    if (code == Code::pose_stale) ++figures_.poses[arm].stale;
    if (code == Code::wrong_frame) ++figures_.poses[arm].wrong_frame;
  }
  LogLine line;
  if (seen.pose_link.is_news(code, now_ns, {.lasts_ns = kNsPerS})) {
    line.level = code == Code::ok ? LogLine::Level::info : LogLine::Level::warning;
    line.code = static_cast<std::uint16_t>(code);
    if (code == Code::ok) {
      line.text = "robot poses arrive";
    } else {
      line.text.printf("robot pose: %s; %s", describe(code).data(), cure(code).data());
    }
    say_of(arm, line);
  }
  line.code = 0;
  line.level = LogLine::Level::warning;
  if (!seen.commanded_said && code == Code::ok && figures_.pose_type == hal::PoseType::flange_pose &&
      !gate.newest()->measured) {
    seen.commanded_said = true;
    line.text =
        "the robot marks its poses as commanded (flags, bit 0); a commanded pose can differ from the real one; send "
        "the measured ones (docs/ROBOT.md)";
    say_of(arm, line);
  }
  if (ports_.pose_of(arm).next_note(now_ns, line.text)) say_of(arm, line);
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

void Loop::log_scanner_changes(std::size_t arm) {
  hal::ScannerPort& scanner = ports_.scanner_of(arm);
  const bool online = scanner.online();
  LogLine line;
  // At the start the port's first look is still in progress.
  if (arms_[arm].scanner_online.is_news(online, ports_.clock.mono_ns(),
                                        {.lasts_ns = kScannerNews_ns, .apart_ns = kScannerNewsPeriod_ns})) {
    line.level = online ? LogLine::Level::info : LogLine::Level::warning;
    const Code why_not = scanner.spool_hangs() ? Code::journal_write : Code::scanner_offline;
    line.code = static_cast<std::uint16_t>(online ? Code::ok : why_not);
    const hal::ScannerText why = scanner.trouble();
    line.text.printf("%s%s%s", online ? "the scanner is available again" : "the scanner is not available",
                     online || why.empty() ? "" : ": ", online ? "" : why.c_str());
    say_of(arm, line);
  }
  line.code = 0;
  line.level = LogLine::Level::warning;
  if (scanner.next_note(line.text)) say_of(arm, line);
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

void Loop::log_plc_changes() {
  LogLine line;
  const std::int64_t now_ns = ports_.clock.mono_ns();
  const std::string_view trouble = ports_.plc.trouble();
  if (plc_trouble_.is_news(trouble, now_ns, {.lasts_ns = kPlcNews_ns, .late_ns = kPlcNewsPeriod_ns})) {
    line.level = trouble.empty() ? LogLine::Level::info : LogLine::Level::error;
    line.text = trouble.empty() ? "PLC link is up" : trouble;
    say(line);
  }
  if (!ports_.plc.next_note(now_ns, line.text)) return;
  line.level = LogLine::Level::warning;
  say(line);
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
    tidy_captures(tidy->folder);
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

/// Deletes a file later on the storage thread, when it is idle. Deleting sixty megabytes may take a slow disk long, and
/// the PLC waits for its heartbeat.
bool Loop::delete_later(const PathText& path) {
  const std::lock_guard<std::mutex> lock(to_delete_guard_);
  return to_delete_.push(path);
}

bool Loop::delete_one() {
  PathText path;
  {
    const std::lock_guard<std::mutex> lock(to_delete_guard_);
    if (to_delete_.empty()) return false;
    path = to_delete_[0];
    to_delete_.erase(0);
  }
  delete_file(path);
  return true;
}

void Loop::delete_file(const PathText& path) const {
  if (::unlink(path.c_str()) == 0 || errno == ENOENT) return;
  LogLine line{LogLine::Level::warning, 0, {}};
  line.text.printf("%s cannot be deleted: %s", path.c_str(), std::strerror(errno));
  say(line);
}

/// Deletes views that were not fetched, a few at a time; the others are deleted at the next calibration.
void Loop::tidy_captures(const PathText& folder) {
  const std::int64_t oldest_us = ports_.clock.utime_us() - kCaptureKept_us;
  std::error_code fault;  // error: the folder does not exist, so it contains no views
  for (std::filesystem::directory_iterator entry(folder.c_str(), fault), end; !fault && entry != end;
       entry.increment(fault)) {
    // The change time is the time of the move to this folder.
    struct stat there {};
    const bool scan = ::lstat(entry->path().c_str(), &there) == 0 && S_ISREG(there.st_mode);
    if (scan && there.st_ctim.tv_sec * std::int64_t{1'000'000} < oldest_us && !delete_later(entry->path().c_str()))
      return;
  }
}

namespace {

std::atomic<std::uint64_t> untold_lines = 0;

/// Reports lost lines once the journal accepts lines again.
void tell_untold() {
  const std::uint64_t lines = untold_lines.exchange(0, std::memory_order_relaxed);
  if (lines == 0) return;
  LogLine line;
  line.level = LogLine::Level::warning;
  line.text.printf("%llu lines are missing here: the journal did not take them",
                   static_cast<unsigned long long>(lines));
  say_line(line);
}

/// Converts the text to one line of valid UTF-8. File names may contain line ends and invalid bytes, which the journal
/// would show as "blob data". A text that was cut may end within a character.
FixedString<limits::kErrorTextBytes> visible(std::string_view text) {
  FixedString<limits::kErrorTextBytes> line;
  while (!text.empty()) {
    const CodePoint c = code_point_at(text);
    const bool control = c.value < 0x20 || (c.value >= 0x7F && c.value < 0xA0);
    line.append(control || !c.is_utf8 ? std::string_view("?") : text.substr(0, c.bytes));
    text.remove_prefix(c.bytes);
  }
  return line;
}

}  // namespace

void say_line(const LogLine& line) {
  // Under a service manager a line is sent to the journal with its fields; on a terminal the level is written as a
  // word.
  static const bool in_journal = hal::stderr_is_journal();
  static const hal::Journal journal;
  hal::Priority priority = hal::Priority::info;
  const char* word = "info";
  switch (line.level) {
    case LogLine::Level::info: break;
    case LogLine::Level::warning:
      priority = hal::Priority::warning;
      word = "warning";
      break;
    case LogLine::Level::error:
      priority = hal::Priority::error;
      word = "error";
      break;
  }
  const FixedString<limits::kErrorTextBytes> said = visible(line.text.view());
  if (in_journal && journal.say(priority, line.code, said.view())) return tell_untold();
  FixedString<16> prefix;
  if (in_journal) {
    prefix.printf("<%u>", static_cast<unsigned>(priority));
  } else {
    prefix.printf("%s: ", word);
  }
  FixedString<640> text;
  if (line.code != 0) {
    text.printf("%sslabd: [%u] %s\n", prefix.c_str(), line.code, said.c_str());
  } else {
    text.printf("%sslabd: %s\n", prefix.c_str(), said.c_str());
  }
  if (!in_journal) return put_log(text.view());
  // The same journal reads stderr. If it does not read, the line is dropped and counted, so that the loop does not
  // block.
  const ssize_t sent = ::send(STDERR_FILENO, text.c_str(), text.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
  if (sent >= 0) return;
  untold_lines.fetch_add(1, std::memory_order_relaxed);
  count_lost_lines(1);
}

}  // namespace slabd::daemon
