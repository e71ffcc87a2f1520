// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <functional>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "config/config.h"
#include "daemon/control/calibration_changer.h"
#include "daemon/design_watch.h"
#include "daemon/recipe_watch.h"
#include "daemon/station/station.h"
#include "daemon/workers.h"

namespace slabd::daemon {

/// Ports of an arm.
struct ArmPorts {
  hal::PosePort* pose = nullptr;
  hal::ScannerPort* scanner = nullptr;
};

/// Ports of the loop. `pose` and `scanner` are those of arm 0.
struct Ports {
  hal::PlcPort& plc;
  hal::PosePort& pose;
  hal::ScannerPort& scanner;
  storage::Store* store = nullptr;  ///< set by the loop while the store is open
  hal::ControlPort* control = nullptr;
  hal::Clock& clock;
  hal::ServiceNotify& notify;
  hal::GaugePort* gauges = nullptr;                         ///< instruments and UDP; absent: no gauge has such a source
  DesignWatch* designs = nullptr;                           ///< of the design sheets; absent: there is no such folder
  RecipeWatch* recipes = nullptr;                           ///< of the recipe folder; absent: the folder is not watched
  FixedVector<ArmPorts, limits::kArmsMax - 1> more_arms{};  ///< arms after the first: [arm - 1]

  [[nodiscard]] std::size_t arms() const { return 1 + more_arms.size(); }
  [[nodiscard]] hal::PosePort& pose_of(std::size_t arm) const { return arm == 0 ? pose : *more_arms[arm - 1].pose; }
  [[nodiscard]] hal::ScannerPort& scanner_of(std::size_t arm) const {
    return arm == 0 ? scanner : *more_arms[arm - 1].scanner;
  }
};

/// Opens the store, on the storage thread. Sets `scanner_is_ours` once no other process can use the scanner; until then
/// the loop does not touch it. busy: another daemon uses a folder of this one; other errors as storage::open_store().
using StoreOpener = std::function<Result<std::unique_ptr<storage::Store>>(std::atomic<bool>& scanner_is_ours)>;

/// Data that `slabctl status` shows in addition to the station's state.
struct LoopFigures {
  std::int64_t started_ns = 0;  ///< start of the process; 0: start of the loop
  bool opening = false;         ///< the store is being opened
  std::uint64_t blocks_measured = 0;
  double block_last_ms = 0.0;
  double block_max_ms = 0.0;
  double commit_last_ms = 0.0;
  double commit_max_ms = 0.0;
  struct Poses {
    std::uint64_t stale = 0;        ///< number of times the newest pose became too old
    std::uint64_t wrong_frame = 0;  ///< number of times another base or tool became active
  };
  std::array<Poses, limits::kArmsMax> poses{};
  /// Why the database could not be opened or written, or which other daemon uses the spool; empty: no error.
  FixedString<limits::kErrorTextBytes> store_text;
  hal::PlcRole plc_role = hal::PlcRole::server;
  hal::WordOrder plc_word_order = hal::WordOrder::abcd;
  hal::PoseType pose_type = hal::PoseType::flange_pose;
  std::string config_path;
  std::string db_path;
  std::string plant_line;           ///< [plant] line; empty: there is no plant's database
  std::int64_t plant_alarm_us = 0;  ///< results that wait longer are an alarm
};

/// Fault of a line whose store could not be opened because of `why`: store_full if a disk is full, config if another
/// daemon uses a folder (busy), journal_write for all other errors. All are retried.
[[nodiscard]] Code fault_without_store(const Error& why);

/// Hash of the points from some thousands of their coordinates, spread over the scan and over x, y and z. Never 0.
/// `xyz`: x, y, z of each point.
[[nodiscard]] std::uint64_t fingerprint_of(std::span<const float> xyz);

/// Reports changes of a state once they have lasted, so that a flickering state cannot fill the disk.
template <typename State>
class DebouncedState {
 public:
  struct When {
    std::int64_t lasts_ns = 0;                                        ///< a change is reported after this time
    std::int64_t apart_ns = 0;                                        ///< and the last report is at least this old
    std::int64_t late_ns = std::numeric_limits<std::int64_t>::max();  ///< or in any case if the last report is this old
  };

  explicit DebouncedState(const State& first = {}) : seen_(first), told_(first) {}

  /// Updates the state. True if it must be reported now; it then counts as reported.
  template <typename Now>
  [[nodiscard]] bool is_news(const Now& state, std::int64_t now_ns = 0, const When& when = {}) {
    if (seen_ != state) {
      seen_ = state;
      seen_ns_ = now_ns;
    }
    const bool lasts = now_ns - seen_ns_ >= when.lasts_ns && now_ns - told_ns_ >= when.apart_ns;
    if (seen_ == told_ || !(lasts || now_ns - told_ns_ >= when.late_ns)) return false;
    told_ = seen_;
    told_ns_ = now_ns;
    return true;
  }
  /// State at the last update.
  [[nodiscard]] const State& seen() const { return seen_; }

 private:
  State seen_;
  State told_;
  std::int64_t seen_ns_ = 0;  ///< start of the present state
  std::int64_t told_ns_ = -(std::int64_t{1} << 40U);
};

/// Turns events of the ports into steps and actions, on one thread; the workers (storage, scanner, measuring) does all
/// blocking work. The constructor allocates everything; the turns allocate nothing on the inspection path.
///
/// The first job of the storage thread is to open the store. A large database is checked for minutes on a slow disk;
/// meanwhile the PLC reads STATE 1 (recover), a counting heartbeat and READY off. If the store cannot be used, the PLC
/// reads the fault, and the store is opened again after a while, or when the PLC resets the fault. A temporary disk
/// error must not stop the line until an operator arrives.
class Loop {
 public:
  /// Longest interval between ticks: PLC acknowledgement within 50 ms, heartbeat, settle gate.
  static constexpr int kTurn_ms = 10;

  /// With the workers of a running daemon. `scan_forms`: of the scan files of each arm, which are stored in the spool
  /// as the scanner wrote them. `measure_threads`: 1 or 2. `ports` and `settings` have the same number of arms.
  Loop(const Ports& ports, const StationSettings& settings, StoreOpener open, const ScanForms& scan_forms,
       int measure_threads, LoopFigures figures);
  Loop(const Ports& ports, const StationSettings& settings, StoreOpener open, std::unique_ptr<Workers> workers,
       LoopFigures figures);
  ~Loop();
  Loop(const Loop&) = delete;
  Loop& operator=(const Loop&) = delete;

  /// Orders the store to be opened, unless the settings contain a fault; call it once, first.
  void start();
  /// One turn: waits at most `wait_ms` for an event, then serves all events.
  void turn(int wait_ms);
  /// Serves all present events without waiting.
  void serve();
  /// True while the store is being opened, for the first time or again. The opening cannot be interrupted.
  [[nodiscard]] bool is_opening() const { return figures_.opening; }
  /// Ends the current scan and waits for the store jobs in progress; call it last.
  void finish();
  /// After finish(): waits until the workers of all scanners can be ended. False if one hangs, for an unknown time.
  [[nodiscard]] bool wait_for_scanner_thread();

  [[nodiscard]] const Station& station() const { return *station_; }

 private:
  static constexpr std::int64_t kStorePatience_ns = 5 * kNsPerS;
  /// Each try reads the whole database, and a retry does not repair a damaged one.
  static constexpr std::int64_t kStorePatienceMax_ns = 300 * kNsPerS;
  /// A database that cannot be written for long must not fill the memory; the last events are then missing.
  static constexpr std::size_t kEventsMax = 32;

  void wait(int wait_ms);
  void tick();
  void look_for_another_daemon();
  void note_fault();
  void take_gauges();
  void take_poses(std::size_t arm);
  void log_pose_changes(std::size_t arm);
  void take_answers();
  void take_stored(const StoreDone& stored);
  void take_change();
  void order_store();
  void take_store();
  void log_scanner_changes(std::size_t arm);
  void serve_plc();
  void log_plc_changes();
  void serve_control();
  void feed_watchdog();
  void abandon_measurements();
  void apply_reloaded_recipes();
  void apply_new_designs();
  void handle(const Event& event);
  void perform(const Action& action);
  void judge_slab(const JudgeSlab& action);
  /// Queues a file for deletion; false if the queue is full.
  [[nodiscard]] bool delete_later(const PathText& path);
  /// Deletes one queued file; false if there is none. Called by the storage thread, or when no other thread runs.
  bool delete_one();
  void delete_file(const PathText& path) const;
  void tidy_captures_later(const PathText& folder);
  /// Called by the storage thread: a folder's disk may stop, and the loop must not.
  void tidy_captures();
  void say(const LogLine& line) const { say_line(line); }
  /// Says a line about one arm; it names the arm if there are several.
  void say_of(std::size_t arm, LogLine line) const;

  [[nodiscard]] StoreAnswer do_task(const StoreTask& task);
  [[nodiscard]] StoreDone store(const StoreJob& job);
  void open_store();
  void idle_store();
  void idle_scanner(std::size_t arm);
  void note_chain(std::int64_t slab_key);
  /// Keeps the events that wait, if the store is open.
  void keep_events();
  /// Raises a fault without a job for an error that the store detected itself.
  void tell_store_trouble();
  [[nodiscard]] ScanDone scan(const AcquireScan& job);

  /// Data of the loop about one arm.
  struct LoopArm {
    std::atomic<bool> cancel_scan{false};
    DebouncedState<std::string> pose_trouble;
    DebouncedState<Code> pose_link{Code::no_pose};
    bool commanded_said = false;                ///< a log line about unmeasured poses was written
    DebouncedState<bool> scanner_online{true};  ///< a scanner that is online from the start is not reported
  };

  Ports ports_;
  const LineArms line_arms_;
  LoopFigures figures_;

  std::unique_ptr<Station> station_;
  std::unique_ptr<Actions> actions_;
  std::unique_ptr<Event> follow_up_;  ///< the one event that an action causes at once
  bool has_follow_up_ = false;
  std::vector<BlockResult> blocks_;  ///< of the slab that is being judged
  std::unique_ptr<SlabJudged> judged_;

  std::unique_ptr<Workers> workers_;
  std::array<LoopArm, limits::kArmsMax> arms_;
  std::atomic<bool> scanner_is_ours_{false};  ///< of all scanners

  StoreOpener open_;                       ///< storage thread only
  std::unique_ptr<storage::Store> store_;  ///< storage thread only; null: it is not open
  /// State read by OpenStore, or why there is none. The storage thread writes it between the order and its answer.
  Result<std::unique_ptr<RecoveredLine>> recovered_{nullptr};
  /// Time of the next OpenStore after a failure.
  std::optional<std::int64_t> reopen_ns_;
  std::int64_t store_patience_ns_ = kStorePatience_ns;

  std::mutex to_delete_guard_;
  FixedVector<PathText, 32> to_delete_;
  PathText to_tidy_;  ///< the captures' folder, also with this guard; empty: nothing to do

  std::mutex events_guard_;
  /// A start of slabd (code 0), or a fault that began or ended. Without memory of the heap, as all of a turn.
  struct NotedEvent {
    storage::LineEvent::Kind kind = storage::LineEvent::Kind::started;
    Code code = Code::ok;
    std::int64_t utime_us = 0;
  };
  FixedVector<NotedEvent, kEventsMax> events_;  ///< not stored yet
  DebouncedState<std::uint16_t> fault_seen_;
  std::uint16_t fault_told_ = 0;  ///< the last one of which there is an event

  bool scanner_is_anothers_ = false;  ///< another daemon uses the drop folder
  bool fault_was_reset_ = false;      ///< by the PLC, since the store was last ordered to be opened
  bool fault_reset_held_ = false;     ///< FAULT_RESET as last written by the PLC
  GaugeSamples gauge_samples_{};
  std::shared_ptr<const config::DesignSet> designs_in_use_;
  std::shared_ptr<const RecipeSet> recipes_in_use_;  ///< loaded since the start
  bool measuring_given_up_ = false;                  ///< for the current block
  std::int64_t watchdog_ns_ = 0;
  /// Storage, measuring, and the scanner of each arm.
  std::array<std::uint64_t, 2 + limits::kArmsMax> worker_turns_{};
  std::array<std::int64_t, 2 + limits::kArmsMax> worker_moved_ns_{};
  DebouncedState<bool> recipes_differ_;
  DebouncedState<std::string> plc_trouble_;
  DebouncedState<FixedString<limits::kErrorTextBytes>> spool_trouble_;  ///< storage thread only
  DebouncedState<FixedString<limits::kErrorTextBytes>> store_trouble_;  ///< storage thread only
  CalibrationChanger calibration_changer_;

  // Last: the workers start after all members they use, and end before them.
  std::unique_ptr<StoreQueue> store_worker_;
  std::array<std::unique_ptr<ScanQueue>, limits::kArmsMax> scan_workers_;  ///< null: there is no such arm
  std::unique_ptr<MeasureQueue> measure_worker_;
};

/// The answer to {"verb":"status"} on the control socket: one line of JSON, schema slabd.status/1.
[[nodiscard]] std::string status_json(const Station& station, const Ports& ports, const LoopFigures& figures);
/// Age of the oldest result that the plant's database does not have; 0 if it has all.
[[nodiscard]] double plant_age_s(const storage::Backlog& behind, std::int64_t utime_us);
/// The answer to {"verb":"calibration"}: the calibration in force, that of the open slab, due dates of checks, and the
/// result of the last change; schema slabd.calibration_state/1.
[[nodiscard]] std::string calibration_json(const Station& station, const CalibrationChanger& changer);
/// The answer to {"verb":"capture",...}: operator, state of the robot, result of the last view; schema slabd.capture/1.
[[nodiscard]] std::string capture_json(const Station& station);
/// The answer to {"verb":"gauges"}: every gauge with its newest value, its last master check and its state for the open
/// slab; schema slabd.gauges/1.
[[nodiscard]] std::string gauges_json(const Station& station, const Ports& ports);
/// Parses {"verb":"gauge_enter","gauge":NAME,"value":X,"slab_no":N} into an event. config: the text names the error.
[[nodiscard]] Result<GaugeEntered> parse_gauge_entry(std::string_view line, const Station& station, std::uint32_t uid);
/// The answer to {"verb":"recipes"}: the recipes in use, differences in the folder, result of the last reload; schema
/// slabd.recipes/1. With "reload":true a reload is ordered first, unless a slab is open.
[[nodiscard]] std::string recipes_json(const RecipeWatch& watch);
/// Parses a capture request into an event. config: the text names the error.
[[nodiscard]] Result<CaptureRequest> parse_capture(std::string_view line, std::uint32_t uid);
/// The answer to {"verb":"care"}: results of the last backup and of pruning; schema slabd.care/1.
[[nodiscard]] std::string care_json(const storage::Store& store);
/// Passes {"verb":"backup"} (to a file named after the time, in the backup folder), {"verb":"prune","keep_slabs":N} or
/// {"verb":"sent","epoch":UUID,"seq":N} (by slabd-plant) to the store. config, busy: as Store::order().
[[nodiscard]] Status order_care(std::string_view line, storage::Store& store, const std::string& db_path,
                                std::int64_t utime_us);
/// The text for {"verb":"metrics"}: Prometheus' exposition format.
[[nodiscard]] std::string metrics_text(const Station& station, const Ports& ports, const LoopFigures& figures);
/// The answer to {"verb":"metrics"}: one line of JSON, schema slabd.metrics/1.
[[nodiscard]] std::string metrics_json(const Station& station, const Ports& ports, const LoopFigures& figures);
/// "VmRSS" and similar entries of /proc/self/status, in kB; 0 if the entry is missing.
[[nodiscard]] std::int64_t memory_kb(const std::string& key);
/// Answers one line of a control request; unknown verbs and bad JSON get {"error": ...}. Reading verbs do not change
/// any state. {"verb":"calibration_change","file":...} lays a change on the changer; the caller has it carried out.
/// "capture" is an event for the station: `handle` steps it before the answer is made. {"verb":"metrics","reset":true}
/// resets the maxima of `figures`.
[[nodiscard]] std::string answer_control(std::string_view line, const Station& station, const Ports& ports,
                                         LoopFigures& figures, CalibrationChanger& changer,
                                         const std::function<void(const Event&)>& handle);

}  // namespace slabd::daemon
