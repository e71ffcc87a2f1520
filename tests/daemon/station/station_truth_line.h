// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <tuple>

#include "tests/daemon/station/station_line.h"
#include "tests/daemon/station/station_truth_parts.h"

/// A line driven by random events that records which block every scan really shows. Everything around the station may
/// fail at any turn, alone or together; these conditions are checked at every step:
///
///   a scan recorded for a block was exposed for it, and the block's measurement uses that scan;
///   a process that starts now would not accept the first scan of a scanner that holds an unseen one;
///   the scanner has one request at a time, into a buffer that is not being measured;
///   a buffer that is being measured is not written by the scanner, and is used by one measurement only;
///   only jobs that a database would accept are submitted, and not more than the daemon's queue holds;
///   a scan that measuring refused before it was recorded is not recorded, and no refused scan has a verdict;
///   without further faults a whole slab passes within some commands, and nothing is left over.
///
/// A scenario covers only the cases its author thought of. This test finds the others: sequences of a death, an ABORT
/// or a lost answer after which a scan counts for another block.
namespace slabd::daemon {

class TruthLine {
 public:
  explicit TruthLine(std::uint64_t seed);

  /// Runs turns of 10 ms with random faults.
  void live(int turns);
  /// Runs a whole slab without further faults, with at most `orders_max` commands.
  void pass_a_slab(int orders_max);

  /// The first violated condition, and its step; empty: none.
  [[nodiscard]] const std::string& violation() const { return violation_; }

  /// Event counts, to detect a line on which nothing happens.
  struct Figures {
    std::uint64_t steps = 0;
    std::uint64_t scans_recorded = 0;
    std::uint64_t scans_thrown_away = 0;
    std::uint64_t views_asked = 0;
    std::uint64_t reloads = 0;
    std::uint64_t deaths = 0;
    std::uint64_t refused = 0;  ///< scans that measuring refused
    int orders = 0;             ///< for the slab that passed
    bool operator==(const Figures&) const = default;
  };
  [[nodiscard]] const Figures& figures() const { return figures_; }

 private:
  using ScanKey = std::tuple<std::int64_t, int, int>;  ///< slab, station, attempt

  // ---- the process ----
  void start();
  void feed(const Event& event);
  void carry_out(const StoreJob& job);
  void check_refused(const StoreJob& job);
  void measured(const BlockMeasured& done);
  void carry_out(const AcquireScan& action);
  void carry_out(const CancelScan& action);
  void carry_out(const MeasureBlock& action);
  void carry_out(const JudgeSlab& action);
  void carry_out(const DropScan& action) { scanner_.drop_file(action.path); }
  void carry_out(const TidyCaptures& /*action*/) {}
  void carry_out(const LogLine& /*action*/) {}
  void violated(const std::string& what);

  // ---- random events ----
  void turn();
  void send_poses();
  void act_as_plc();
  void give_some_order(const PlcOutputs& view);
  void order(PlcCommand what, int station_no = 0);
  void press_abort(bool pressed);
  void reset_fault();
  void acknowledge();
  void act_as_maintenance();
  void change_calibration();
  void let_things_go_wrong();
  void die();
  [[nodiscard]] bool a_restart_would_be_deceived() const;
  void mend_everything();

  // ---- the last slab ----
  template <typename Done>
  bool run_until(const Done& done, int turns_max);
  bool order_and_wait(PlcCommand what, int station_no = 0);
  bool scan_every_block();
  [[nodiscard]] bool is_at_rest() const;
  void check_nothing_is_left();

  Chance chance_;
  MemoryStore store_;
  TruthDisk disk_;
  TruthScanner scanner_;
  TruthMeasuring measuring_;
  Recipe recipe_ = test_recipe();
  StationSettings settings_;
  std::unique_ptr<Station> station_;
  std::unique_ptr<Actions> actions_of_a_step_ = std::make_unique<Actions>();  ///< too large for the stack
  Actions& actions_ = *actions_of_a_step_;
  std::optional<SlabJudged> judged_;
  /// Refused scans; true: refused before they were recorded.
  std::map<ScanKey, bool> refused_;

  PlcInputs plc_;
  int robot_station_ = 1;
  bool poses_come_ = true;
  std::int32_t pose_seq_ = 0;
  bool in_maintenance_ = false;
  std::int64_t turn_ = 0;
  std::int64_t dies_at_turn_ = -1;
  std::int64_t now_ns_ = kNsPerS;
  std::int64_t utime_us_ = 1'700'000'000'000'000;

  int orders_left_ = 0;
  Figures figures_;
  std::string violation_;
};

}  // namespace slabd::daemon
