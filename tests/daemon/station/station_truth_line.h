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

/// A line that is led by chance and knows which block every scan really shows. Everything around the station may go
/// wrong at any turn, alone or together; the promises are checked at every step:
///
///   a scan that is recorded for a block was exposed for it, and what is measured for a block is that scan;
///   a process that started now would not trust a scanner that holds a scan which nobody saw;
///   the scanner is asked for one scan at a time, into a buffer that nobody measures;
///   what is measured lies in a buffer that the scanner does not write, and in one that nothing else is measured in;
///   no job comes that a database would refuse, and not more of them than the daemon's queue holds;
///   a scan that measuring refused before it was recorded is not recorded, and none has a result with a verdict;
///   when nothing goes wrong any more a whole slab passes within some orders, and nothing is left over.
///
/// A scenario shows what somebody thought of. This is for what nobody did: which moments a death, an ABORT or a lost
/// answer must hit one after the other, so that a scan comes to stand for another block.
namespace slabd::daemon {

class TruthLine {
 public:
  explicit TruthLine(std::uint64_t seed);

  /// Turns of 10 ms in which everything may go wrong.
  void live(int turns);
  /// From now on nothing does: a whole slab, with at most `orders_max` orders.
  void pass_a_slab(int orders_max);

  /// The first promise that was not kept, and at which step; empty: none.
  [[nodiscard]] const std::string& violation() const { return violation_; }

  /// What happened, so that a line on which nothing does is noticed.
  struct Figures {
    std::uint64_t steps = 0;
    std::uint64_t scans_recorded = 0;
    std::uint64_t scans_thrown_away = 0;
    std::uint64_t views_asked = 0;
    std::uint64_t reloads = 0;
    std::uint64_t deaths = 0;
    std::uint64_t refused = 0;  ///< scans that measuring refused
    int orders = 0;             ///< of the slab that passed
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

  // ---- what leads the line ----
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
  Actions actions_;
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
