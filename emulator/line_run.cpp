// SPDX-License-Identifier: Apache-2.0
#include "emulator/line_run.h"

#include <fmt/core.h>
#include <algorithm>
#include <chrono>
#include <istream>
#include <ostream>
#include <sstream>
#include <string>
#include <thread>

namespace slabd::emulator {
namespace {

/// slabd asks every instrument twice a second, and later on a busy computer.
constexpr std::chrono::milliseconds kGaugeRounds{3'000};

double seconds(PlcClock::duration d) {
  return std::chrono::duration<double>(d).count();
}

PlcOrder plc_order(const SlabOrder& slab, PlcCommand command, int station = 0) {
  return {command, station, slab.slab_type, slab.slab_no, slab.slab_id, slab.mould, slab.temperature_dk, {}};
}

/// True if the trouble ends the run: a broken link or Ctrl-C. Other troubles concern one station.
bool ends_run(const PlcTrouble& trouble) {
  return trouble.link_lost || trouble.interrupted;
}

/// Troubles of a robot, of a scanner or of their calibrations, which another arm does not have. outside_window: slabd
/// waits for the other robot, because the scans of this one cannot be used.
bool is_of_the_arm(Code code) {
  switch (code) {
    case Code::outside_window:
    case Code::no_pose:
    case Code::pose_stale:
    case Code::wrong_frame:
    case Code::scanner_offline:
    case Code::trigger_timeout:
    case Code::calibration_missing: return true;
    default: return false;
  }
}

const ArmChoice& arms_of(const LineArms& line, int station) {
  return line.of_station[static_cast<std::size_t>(station - 1)];
}

/// The next station that this arm usually scans; 0: none.
int next_station(const LineArms& line, std::size_t arm, int station, int stations) {
  for (int k = station + 1; k <= stations; ++k)
    if (!arms_of(line, k).empty() && arms_of(line, k)[0] == arm) return k;
  return 0;
}

/// Moves one arm to its stop at the station.
void move_arm(const ArmPeers& peers, std::size_t arm, const SlabTruth& slab, int station, int next) {
  peers.robot->move_to(slab.at(station).stop(arm).T_base_flange_reported);
  peers.scanner->stand_over(station, next);
}

class SlabProgram {
 public:
  SlabProgram(const Line& line, const SlabOrder& order, const SlabTruth& truth)
      : line_(line), truth_(truth), started_(PlcClock::now()) {
    run_.order = order;
  }

  SlabRun execute() {
    for (std::size_t arm = 0; arm < line_.arms.size(); ++arm)
      line_.arms[arm].scanner->look_at(line_.recipe, truth_, line_.cell, arm);
    if (begin() && scan_all() && end()) run_.finished = true;
    collect_records();
    run_.total_s = seconds(PlcClock::now() - started_);
    return run_;
  }

 private:
  const PlcOutputs& seen() const { return line_.plc.seen(); }
  void tell(int station, std::string_view doing) const {
    if (line_.progress) line_.progress(station, doing);
  }
  StationRun& at(int station) { return run_.station[static_cast<std::size_t>(station - 1)]; }

  /// Continues an open slab with this number; aborts any other open slab first, as an operator would.
  bool begin() {
    tell(0, "SLAB_BEGIN");
    if (seen().slab_open && seen().slab_no == run_.order.slab_no) {
      run_.continued = true;
      return true;
    }
    std::uint16_t seq = 0;
    if (seen().slab_open) {
      PlcOrder abort = plc_order(run_.order, PlcCommand::slab_abort);
      abort.slab_no = seen().slab_no;
      abort.slab_type = seen().slab_type;
      if (!line_.plc.issue(abort, seq, run_.trouble)) return false;
      const auto closed = [&] { return !seen().slab_open; };
      if (!line_.plc.await(closed, line_.timing.result_timeout, "the open slab to be aborted", run_.trouble))
        return false;
    }
    return line_.plc.issue(plc_order(run_.order, PlcCommand::slab_begin), seq, run_.trouble) &&
           line_.plc.await_status(seq, CommandStatus::done, line_.timing.result_timeout, run_.trouble);
  }

  bool scan_all() {
    for (int station = 1; station <= truth_.stations; ++station) {
      const bool done = (seen().station_mask >> (station - 1) & 1U) != 0;
      if (run_.continued && done) continue;
      if (!scan(station)) return false;
    }
    return true;
  }

  /// Arms that may scan the station: the usual one first, those that failed before last.
  [[nodiscard]] std::vector<std::size_t> arms_for(int station) const {
    const ArmChoice& allowed = arms_of(line_.stations, station);
    std::vector<std::size_t> arms(allowed.begin(), allowed.end());
    std::stable_partition(arms.begin(), arms.end(), [this](std::size_t arm) { return !failed_[arm]; });
    return arms;
  }

  /// Returns false only if the run cannot continue.
  bool scan(int station) {
    const std::vector<std::size_t> arms = arms_for(station);
    for (std::size_t turn = 0; turn < arms.size(); ++turn) {
      bool acquired = false;
      if (!scan_with(arms[turn], station, turn + 1 < arms.size(), acquired)) return false;
      if (acquired) return true;
      if (turn + 1 < arms.size()) line_.arms[arms[turn]].robot->move_to(truth_.aside[arms[turn]]);
    }
    return true;
  }

  [[nodiscard]] bool all_stand() const {
    return std::all_of(line_.arms.begin(), line_.arms.end(),
                       [](const ArmPeers& peers) { return peers.robot->standing(); });
  }

  /// Moves the arm there and scans. `another_may`: a failure of this arm ends its attempts at once. False if the run
  /// cannot continue.
  bool scan_with(std::size_t arm, int station, bool another_may, bool& acquired) {
    move_arm(line_.arms[arm], arm, truth_, station, next_station(line_.stations, arm, station, truth_.stations));
    tell(station, "moving");
    if (!line_.plc.await([this] { return all_stand(); }, line_.timing.acquire_timeout, "the robot", run_.trouble))
      return false;
    if (line_.failure.arm == arm && line_.failure.station == station) line_.arms[arm].scanner->switch_off();

    StationRun& run = at(station);
    run.arm = arm;
    for (int scans = 0; scans < line_.scans_per_station_max; ++scans) {
      tell(station, "SCAN");
      PlcTrouble trouble;
      acquired = scan_once(station, run, trouble);
      if (acquired) return true;
      run.trouble = trouble.text;
      if (ends_run(trouble)) {
        run_.trouble = trouble;
        return false;
      }
      if (is_of_the_arm(trouble.code)) failed_[arm] = true;
      if (failed_[arm] && another_may) return true;
    }
    return true;
  }

  bool scan_once(int station, StationRun& run, PlcTrouble& trouble) {
    ++run.scans;
    PlcClock::time_point triggered;
    if (!line_.plc.issue(plc_order(run_.order, PlcCommand::scan, station), run.cmd_seq, trouble, &triggered) ||
        !line_.plc.await_status(run.cmd_seq, CommandStatus::acquired, line_.timing.acquire_timeout, trouble))
      return false;
    acquired_at_[static_cast<std::size_t>(station - 1)] = last_acquired_ = PlcClock::now();
    run.trigger_to_acquired_s = seconds(last_acquired_ - triggered);
    run.trouble.clear();
    return true;
  }

  /// Gauges the slab, and waits until slabd has read its instruments. False if the run cannot continue.
  bool gauge(PlcGauges& gauges) {
    tell(truth_.stations, "gauging");
    gauges = line_.gauges->measure(run_.order.slab_no);
    if (gauges.any && !gauges.late) line_.plc.write_gauges(gauges.thousandths, gauges.slab_no);
    const auto since = PlcClock::now();
    const auto read = [&] { return PlcClock::now() - since > kGaugeRounds; };
    return line_.plc.await(read, line_.timing.result_timeout, "the gauges", run_.trouble);
  }

  bool end() {
    PlcGauges gauges;
    if (line_.gauges != nullptr && !gauge(gauges)) return false;
    tell(truth_.stations, "SLAB_END");
    std::uint16_t seq = 0;
    if (!line_.plc.issue(plc_order(run_.order, PlcCommand::slab_end), seq, run_.trouble)) return false;
    if (gauges.any && gauges.late) line_.plc.write_gauges(gauges.thousandths, gauges.slab_no);
    if (line_.gauges != nullptr) line_.gauges->send_late();
    // The verdict registers are final before the record, because the record waits for the acknowledgement of earlier
    // ones.
    const auto final_table = [&] { return seen().table_slab_no == run_.order.slab_no && !seen().slab_open; };
    PlcClock::time_point shown_at{};
    const auto shown = [&] {
      if (shown_at == PlcClock::time_point{} && final_table()) shown_at = PlcClock::now();
      return line_.plc.result(run_.order.slab_no, 2, 0, seq) != nullptr;
    };
    if (!line_.plc.await(shown, line_.timing.result_timeout, "the slab's verdict", run_.trouble)) return false;
    const StoredResult& stored = *line_.plc.result(run_.order.slab_no, 2, 0, seq);
    run_.record = stored.record;
    if (shown_at == PlcClock::time_point{}) shown_at = stored.at;
    if (last_acquired_ != PlcClock::time_point{}) run_.last_acquired_to_verdict_s = seconds(shown_at - last_acquired_);

    // Registers and record must agree.
    if (!line_.plc.await(final_table, line_.timing.result_timeout, "the station table", run_.trouble)) return false;
    run_.table = seen().table;
    run_.verdict = seen().slab_verdict;
    run_.reason = seen().slab_reason;
    if (run_.verdict != run_.record.verdict) {
      run_.trouble.text =
          fmt::format("IR 106 has {} and the slab's record has {}", name(run_.verdict), name(run_.record.verdict));
      run_.verdict = Verdict::not_measured;
      return false;
    }
    return true;
  }

  void collect_records() {
    for (int station = 1; station <= truth_.stations; ++station) {
      StationRun& run = at(station);
      const StoredResult* stored = line_.plc.result(run_.order.slab_no, 1, station, run.cmd_seq);
      if (stored == nullptr) continue;
      run.has_record = true;
      run.record = stored->record;
      run.acquired_to_result_s = seconds(stored->at - acquired_at_[static_cast<std::size_t>(station - 1)]);
    }
  }

  const Line& line_;
  const SlabTruth& truth_;
  SlabRun run_;
  PlcClock::time_point started_;
  std::array<bool, limits::kArmsMax> failed_{};  ///< robot or scanner of this arm, at an earlier station
  PlcClock::time_point last_acquired_{};
  std::array<PlcClock::time_point, limits::kStationsMax> acquired_at_{};
};

}  // namespace

SlabRun run_slab(const Line& line, const SlabOrder& order, const SlabTruth& truth) {
  return SlabProgram(line, order, truth).execute();
}

namespace {

void show(const StandBy& line, std::size_t slab) {
  for (std::size_t arm = 0; arm < line.arms.size(); ++arm)
    line.arms[arm].scanner->look_at(line.recipe, line.slabs[slab], line.cell, arm);
}

std::string obey(const StandBy& line, std::size_t& slab, const std::string& order) {
  std::istringstream words(order);
  std::string verb;
  int number = 0;
  if (!(words >> verb >> number)) return "error: expected \"slab N\" or \"station K\"";
  if (verb == "slab") {
    if (number < 1 || static_cast<std::size_t>(number) > line.slabs.size())
      return "error: slab 1.." + std::to_string(line.slabs.size());
    slab = static_cast<std::size_t>(number) - 1;
    show(line, slab);
    return "slab " + std::to_string(number);
  }
  const int stations = line.slabs[slab].stations;
  if (verb != "station" || number < 1 || number > stations)
    return "error: station 1.." + std::to_string(stations) + ", or slab N";
  std::size_t arm = arms_of(line.stations, number)[0];
  if (std::string robot; words >> robot) {
    arm = 0;
    while (arm < line.arms.size() && line.stations.list[arm].robot.view() != robot) ++arm;
    if (arm == line.arms.size()) return "error: no robot has the id " + robot;
    for (std::size_t other = 0; other < line.arms.size(); ++other)
      if (other != arm) line.arms[other].robot->move_to(line.slabs[slab].aside[other]);
  }
  move_arm(line.arms[arm], arm, line.slabs[slab], number, next_station(line.stations, arm, number, stations));
  for (const ArmPeers& peers : line.arms)
    while (!peers.robot->standing()) std::this_thread::sleep_for(std::chrono::milliseconds(2));
  return "standing " + std::to_string(number);
}

}  // namespace

int first_station(const LineArms& line, std::size_t arm, int stations) {
  return next_station(line, arm, 0, stations);
}

void stand_by(const StandBy& line, std::istream& in, std::ostream& out, const std::atomic<bool>& stop) {
  std::size_t slab = 0;
  show(line, slab);
  std::string order;
  while (!stop && std::getline(in, order)) out << obey(line, slab, order) << std::endl;
}

}  // namespace slabd::emulator
