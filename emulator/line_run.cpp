// SPDX-License-Identifier: Apache-2.0
#include "emulator/line_run.h"

#include <fmt/core.h>
#include <chrono>
#include <istream>
#include <ostream>
#include <sstream>
#include <string>
#include <thread>

namespace slabd::emulator {
namespace {

/// slabd asks every instrument twice a second.
constexpr std::chrono::milliseconds kGaugeRounds{1'200};

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

class SlabProgram {
 public:
  SlabProgram(const Line& line, const SlabOrder& order, const SlabTruth& truth)
      : line_(line), truth_(truth), started_(PlcClock::now()) {
    run_.order = order;
  }

  SlabRun execute() {
    line_.scanner.look_at(line_.recipe, truth_, line_.cell);
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

  /// Returns false only if the run cannot continue.
  bool scan(int station) {
    line_.robot.move_to(truth_.at(station).T_base_flange_reported);
    line_.scanner.stand_over(station, station < truth_.stations ? station + 1 : 0);
    tell(station, "moving");
    const auto arrived = [&] { return line_.robot.standing(); };
    if (!line_.plc.await(arrived, line_.timing.acquire_timeout, "the robot", run_.trouble)) return false;

    StationRun& run = at(station);
    while (run.scans < line_.scans_per_station_max) {
      tell(station, "SCAN");
      PlcTrouble trouble;
      if (scan_once(station, run, trouble)) return true;
      run.trouble = trouble.text;
      if (ends_run(trouble)) {
        run_.trouble = trouble;
        return false;
      }
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
  PlcClock::time_point last_acquired_{};
  std::array<PlcClock::time_point, limits::kStationsMax> acquired_at_{};
};

}  // namespace

SlabRun run_slab(const Line& line, const SlabOrder& order, const SlabTruth& truth) {
  return SlabProgram(line, order, truth).execute();
}

namespace {

std::string obey(const StandBy& line, std::size_t& slab, const std::string& order) {
  std::istringstream words(order);
  std::string verb;
  int number = 0;
  if (!(words >> verb >> number)) return "error: expected \"slab N\" or \"station K\"";
  if (verb == "slab") {
    if (number < 1 || static_cast<std::size_t>(number) > line.slabs.size())
      return "error: slab 1.." + std::to_string(line.slabs.size());
    slab = static_cast<std::size_t>(number) - 1;
    line.scanner.look_at(line.recipe, line.slabs[slab], line.cell);
    return "slab " + std::to_string(number);
  }
  const int stations = line.slabs[slab].stations;
  if (verb != "station" || number < 1 || number > stations)
    return "error: station 1.." + std::to_string(stations) + ", or slab N";
  line.robot.move_to(line.slabs[slab].at(number).T_base_flange_reported);
  line.scanner.stand_over(number, number < stations ? number + 1 : 0);
  while (!line.robot.standing()) std::this_thread::sleep_for(std::chrono::milliseconds(2));
  return "standing " + std::to_string(number);
}

}  // namespace

void stand_by(const StandBy& line, std::istream& in, std::ostream& out, const std::atomic<bool>& stop) {
  std::size_t slab = 0;
  line.scanner.look_at(line.recipe, line.slabs[slab], line.cell);
  std::string order;
  while (!stop && std::getline(in, order)) out << obey(line, slab, order) << std::endl;
}

}  // namespace slabd::emulator
