// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <functional>
#include <limits>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "config/config.h"
#include "daemon/control/calibration_desk.h"
#include "daemon/crew.h"
#include "daemon/recipe_watch.h"
#include "daemon/station/station.h"

namespace slabd::daemon {

/// What the loop is plugged into. `store` may be absent (nothing usable to store in): the PLC then reads a fault.
struct Ports {
  hal::PlcPort& plc;
  hal::PosePort& pose;
  hal::ScannerPort& scanner;
  storage::Store* store = nullptr;
  hal::ControlPort* control = nullptr;
  hal::Clock& clock;
  hal::ServiceNotify& notify;
  /// FAULT_RESET as the PLC wrote it last. Shared by loops that follow each other: held down it is an edge for none.
  bool* fault_reset_held = nullptr;
  RecipeWatch* recipes = nullptr;  ///< of the recipe folder; absent: nothing is looked at
};

/// What `slabctl status` shows beside the station's own state.
struct LoopFigures {
  std::int64_t started_ns = 0;  ///< of the process; 0: of this loop
  std::uint64_t blocks_measured = 0;
  double block_last_ms = 0.0;
  double block_max_ms = 0.0;
  double commit_last_ms = 0.0;
  double commit_max_ms = 0.0;
  std::uint64_t poses_stale = 0;                    ///< times that the newest pose became too old
  std::uint64_t poses_wrong_frame = 0;              ///< times that another base or tool became active
  FixedString<limits::kErrorTextBytes> store_text;  ///< why the database could not be written; empty: it could
  hal::PlcRole plc_role = hal::PlcRole::server;
  hal::WordOrder plc_word_order = hal::WordOrder::abcd;
  hal::PoseType pose_type = hal::PoseType::flange_pose;
  std::string config_path;
  std::string db_path;
  /// Another daemon uses the spool: which folder and who. Then the line stands in fault 504, and main() looks again.
  std::string used_by_another;
};

/// The fault in which a line stands whose storage cannot be used for `why`. store_full where a disk is full, which a
/// person mends by making room; journal_write for all else. Both are tried again.
[[nodiscard]] Code fault_without_store(const Error& why);

/// A number for what the points are, from some thousands of their coordinates, spread over the scan and over x, y and
/// z. Never 0. `xyz`: x, y, z of each point.
[[nodiscard]] std::uint64_t fingerprint_of(std::span<const float> xyz);

/// A state of which only changes are told: those that have lasted, so that one that flickers cannot fill the disk.
template <typename State>
class ToldOnce {
 public:
  struct When {
    std::int64_t lasts_ns = 0;                                        ///< a change is told when it has lasted so long,
    std::int64_t apart_ns = 0;                                        ///< and the last one was told so long ago;
    std::int64_t late_ns = std::numeric_limits<std::int64_t>::max();  ///< or, lasting or not, when that was so long ago
  };

  explicit ToldOnce(const State& first = {}) : seen_(first), told_(first) {}

  /// Looks at the state. True: it is to be told now, and then counts as told.
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
  /// At the last look.
  [[nodiscard]] const State& seen() const { return seen_; }

 private:
  State seen_;
  State told_;
  std::int64_t seen_ns_ = 0;  ///< since when it is so
  std::int64_t told_ns_ = -(std::int64_t{1} << 40U);
};

/// Ports -> events -> step -> actions, on one thread; the crew (storage, scanner, measuring) does what blocks.
/// Everything is allocated by the constructor; run() allocates nothing on the inspection path.
class Loop {
 public:
  static constexpr std::int64_t kStorePatience_ns = 5 * kNsPerS;
  /// Each try reads the whole database; a damaged one does not become better by it.
  static constexpr std::int64_t kStorePatienceMax_ns = 300 * kNsPerS;

  /// With the crew of a running daemon. `scan_form`: of the scan files, which lie in the spool as the scanner wrote
  /// them. `measure_threads`: 1 or 2.
  Loop(const Ports& ports, const StationSettings& settings, const hal::ScanForm& scan_form, int measure_threads,
       LoopFigures figures);
  Loop(const Ports& ports, const StationSettings& settings, std::unique_ptr<Crew> crew, LoopFigures figures);
  ~Loop();
  Loop(const Loop&) = delete;
  Loop& operator=(const Loop&) = delete;

  /// Runs until `stop` becomes true, and finishes store jobs under way before it returns. Also returns, with true, when
  /// wants_store(patience_ns). `recovered` is called once, when what storage remembers has been taken up and everything
  /// that works on slabs is there; not when storage cannot be used.
  bool run(const std::atomic<bool>& stop, std::int64_t patience_ns = kStorePatience_ns,
           const std::function<void()>& recovered = {});

  // What run() consists of, for whoever moves the clock himself.
  /// Takes up what storage remembers; once, first.
  void start();
  /// One turn: waits at most `wait_ms` for something to happen, then serves it all.
  void turn(int wait_ms);
  /// Handles everything that has happened, without waiting.
  void serve();
  /// Storage could not be used at the start (fault 501 or 502), and either `patience_ns` are over or the PLC has reset
  /// the fault: whoever made this loop opens the store anew and makes another one. A disk that fails for a moment must
  /// not stop the line until somebody comes.
  [[nodiscard]] bool wants_store(std::int64_t patience_ns) const;
  /// Ends the scan in hand and waits for the store jobs under way; last.
  void finish();
  /// After finish(): waits until the scanner's worker can be ended. False: it hangs, and nobody can say for how long.
  [[nodiscard]] bool scanner_comes_back();

  [[nodiscard]] const Station& station() const { return *station_; }

 private:
  void wait(int wait_ms);
  void tick();
  void look_for_another_daemon();
  void take_poses();
  void say_pose_news();
  void take_answers();
  void say_scanner_news();
  void serve_plc();
  void say_plc_news();
  void serve_control();
  void feed_watchdog();
  void give_measurements_up();
  void take_up_recipes();
  void handle(const Event& event);
  void perform(const Action& action);
  void judge_slab(const JudgeSlab& action);
  /// False: too many wait for it.
  [[nodiscard]] bool delete_later(const PathText& path);
  /// Deletes one file that waits for it; false: there is none. By the storage thread, or when nothing else runs.
  bool delete_one();
  void delete_file(const PathText& path) const;
  void tidy_captures(const PathText& folder);
  void say(const LogLine& line) const { say_line(line); }

  [[nodiscard]] StoreDone store(const StoreTask& task);
  void note_chain(std::int64_t slab_key);
  /// What the store has found wrong by itself is a fault without a job.
  void tell_store_trouble();
  [[nodiscard]] ScanDone scan(const AcquireScan& job);

  Ports ports_;
  LoopFigures figures_;

  std::unique_ptr<Station> station_;
  std::unique_ptr<Actions> actions_;
  std::unique_ptr<Event> follow_up_;  ///< the one event an action answers at once
  bool has_follow_up_ = false;
  std::vector<BlockResult> blocks_;  ///< of the slab being judged
  std::unique_ptr<SlabJudged> judged_;

  std::unique_ptr<Crew> crew_;
  std::atomic<bool> cancel_scan_{false};
  /// The store has gone over from start(), which reads it on the loop's thread, to the storage thread.
  std::atomic<bool> store_handed_over_{false};

  std::mutex to_delete_guard_;
  FixedVector<PathText, 32> to_delete_;

  bool scanner_is_anothers_ = false;                 ///< another daemon uses the drop folder
  bool fault_was_reset_ = false;                     ///< by the PLC, since the start
  bool fault_reset_held_ = false;                    ///< of this loop, where no other one is to know
  std::shared_ptr<const RecipeSet> recipes_in_use_;  ///< taken up since the start
  bool measuring_given_up_ = false;                  ///< the block in hand
  std::int64_t watchdog_ns_ = 0;
  std::array<std::uint64_t, 3> worker_turns_{};
  std::array<std::int64_t, 3> worker_moved_ns_{};
  std::int64_t begun_ns_ = 0;
  bool commanded_said_ = false;  ///< that poses are not measured; once
  ToldOnce<bool> recipes_differ_;
  ToldOnce<std::string> pose_trouble_;
  ToldOnce<Code> pose_link_{Code::no_pose};
  ToldOnce<bool> scanner_online_{true};  ///< nothing is told of a scanner that is there from the start
  ToldOnce<std::string> plc_trouble_;
  ToldOnce<FixedString<limits::kErrorTextBytes>> spool_trouble_;  ///< storage thread only
  ToldOnce<FixedString<limits::kErrorTextBytes>> store_trouble_;  ///< storage thread only
  CalibrationDesk calibration_desk_;

  // Last: the workers start when everything they touch exists, and end first.
  std::unique_ptr<StoreQueue> store_worker_;
  std::unique_ptr<ScanQueue> scan_worker_;
  std::unique_ptr<MeasureQueue> measure_worker_;
};

/// The answer to {"verb":"status"} on the control socket: one line of JSON, schema slabd.status/1.
[[nodiscard]] std::string status_json(const Station& station, const Ports& ports, const LoopFigures& figures);
/// The answer to {"verb":"calibration"}: what is in force, what the open slab uses, when checks are due, and what
/// became of the last change; schema slabd.calibration_state/1.
[[nodiscard]] std::string calibration_json(const Station& station, const CalibrationDesk& desk);
/// The answer to {"verb":"capture",...}: who calibrates, what the robot does, what became of the last view; schema
/// slabd.capture/1.
[[nodiscard]] std::string capture_json(const Station& station);
/// The answer to {"verb":"recipes"}: what is in use, what the folder holds otherwise, what became of the last reload;
/// schema slabd.recipes/1. With "reload":true a reload is ordered first, unless a slab is open.
[[nodiscard]] std::string recipes_json(const RecipeWatch& watch);
/// A capture request as an event. config: what is wrong with it.
[[nodiscard]] Result<CaptureRequest> parse_capture(std::string_view line, std::uint32_t uid);
/// The answer to {"verb":"care"}: what became of the last backup and of pruning; schema slabd.care/1.
[[nodiscard]] std::string care_json(const storage::Store& store);
/// Carries {"verb":"backup"} (to a file named after the time, in the backup folder) or {"verb":"prune","keep_slabs":N}
/// to the store. config, busy: as Store::order().
[[nodiscard]] Status order_care(std::string_view line, storage::Store& store, const std::string& db_path,
                                std::int64_t utime_us);
/// The text behind {"verb":"metrics"}: Prometheus' exposition format.
[[nodiscard]] std::string metrics_text(const Station& station, const Ports& ports, const LoopFigures& figures);
/// The answer to {"verb":"metrics"}: one line of JSON, schema slabd.metrics/1.
[[nodiscard]] std::string metrics_json(const Station& station, const Ports& ports, const LoopFigures& figures);
/// "VmRSS" and the like from /proc/self/status, in kB; 0 where there is none.
[[nodiscard]] std::int64_t memory_kb(const std::string& key);
/// Answers one control request line; unknown verbs and bad JSON get {"error": ...}. Reading verbs change nothing;
/// {"verb":"calibration_change","file":...} lays a change on the desk, and the caller has it carried out. "capture" is
/// an event for the station: `handle` steps it before the answer is made. {"verb":"metrics","reset":true} begins the
/// maxima of `figures` anew.
[[nodiscard]] std::string answer_control(std::string_view line, const Station& station, const Ports& ports,
                                         LoopFigures& figures, CalibrationDesk& desk,
                                         const std::function<void(const Event&)>& handle);

}  // namespace slabd::daemon
