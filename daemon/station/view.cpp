// SPDX-License-Identifier: Apache-2.0
//
// What the PLC reads, derived from the state alone. A result appears here only after its commit.
#include "daemon/station/parts.h"
#include "daemon/station/pose_gate.h"

namespace slabd::daemon {
namespace {

bool acquired_or_measured(const StationRecord& record) {
  return record.phase == StationPhase::acquired || record.phase == StationPhase::measured;
}

/// A scan of this row became durable: it has a verdict that is not the code of a failed acquisition.
bool row_has_scan(const PlcStationRow& row) {
  const bool code = row.verdict == Verdict::not_measured && row.reason != 0 && row.reason < kReasonItemBase;
  const bool measuring_code = row.reason > 401 && row.reason < 500;
  return row.attempts != 0 && row.verdict != Verdict::none && (!code || measuring_code);
}

void count_station(PlcOutputs& out, std::size_t index, bool has_scan) {
  if (!has_scan) return;
  ++out.stations_done;
  out.station_mask |= 1U << index;
}

PlcStationRow provisional_row(const StationRecord& record) {
  PlcStationRow row;
  row.attempts = record.attempts;
  if (record.phase == StationPhase::measured) {
    row.verdict = record.block.verdict;
    row.reason = record.block.reason;
  } else if (record.phase == StationPhase::failed) {
    row.verdict = Verdict::not_measured;
    row.reason = record.code;
  }
  return row;
}

PlcState state_of(const Station& s) {
  if (!s.recovered) return PlcState::recover;
  if (in_maintenance(s)) return PlcState::maintenance;
  if (current_fault(s) != Code::ok) return PlcState::fault;
  switch (s.acquisition.phase) {
    case Acquisition::Phase::settling: return PlcState::settling;
    case Acquisition::Phase::clearing:
    case Acquisition::Phase::scanning:
    case Acquisition::Phase::checking:
    case Acquisition::Phase::storing: return PlcState::scanning;
    case Acquisition::Phase::none: break;
  }
  if (s.slab.phase != SlabPhase::none) return PlcState::slab_open;
  return s.results.queue.empty() ? PlcState::idle : PlcState::waiting_for_plc;
}

}  // namespace

std::uint8_t emulation_of_line(const Station& s) {
  unsigned bits = s.settings.simulation ? kEmulatedLine : 0U;
  // A robot that is silent is neither real nor emulated.
  const PoseSample* pose = s.gate.newest();
  if (pose != nullptr && s.now_ns - pose->arrival_ns < PoseGate::kForgetNs)
    bits |= (pose->emulated ? kEmulatedRobot : 0U) | (pose->commanded ? kCommandedPoses : 0U);
  return static_cast<std::uint8_t>(bits);
}

std::uint8_t emulation_shown(const Station& s) {
  const bool open = s.slab.phase != SlabPhase::none;
  unsigned bits = emulation_of_line(s) | (s.scan_emulated ? kEmulatedScan : 0U);
  bits |= open ? s.slab.header.emulated : s.results.slab_emulated;
  if (!s.results.queue.empty()) bits |= s.results.queue.front().emulated;
  return static_cast<std::uint8_t>(bits);
}

FixedString<32> emulation_words(std::uint8_t bits) {
  FixedString<32> words;
  for (std::size_t i = 0; i < kEmulationNames.size(); ++i) {
    if ((bits & (1U << i)) == 0) continue;
    if (!words.empty()) words.append(", ");
    words.append(kEmulationNames[i]);
  }
  return words;
}

PlcOutputs plc_view(const Station& s) {
  PlcOutputs out;
  const Code fault = current_fault(s);
  const bool open = s.slab.phase != SlabPhase::none;
  out.heartbeat = s.heartbeat;
  out.state = state_of(s);
  out.fault = static_cast<std::uint16_t>(fault);
  const bool waiting = s.results.queue.size() > limits::kStationsMax;
  out.simulation = emulation_shown(s) != 0;
  out.warn = static_cast<std::uint16_t>(
      s.warn | s.settings.warn | calibration_warnings(s) | (waiting ? +kWarnResultsWaiting : 0) |
      (s.links.recipes_differ ? +kWarnRecipesDiffer : 0) | (out.simulation ? +kWarnEmulation : 0));
  const bool shooting = in_maintenance(s) && s.capture.phase != Capture::Phase::ready;
  out.busy = s.desk.pending || shooting || s.acquisition.phase != Acquisition::Phase::none ||
             s.slab.phase == SlabPhase::ending || s.slab.phase == SlabPhase::storing_end;
  out.ready =
      s.recovered && fault == Code::ok && !out.busy && !in_maintenance(s) && s.desk.session == s.desk.session_next;
  out.acquired = s.desk.acq_seq != 0 && s.desk.acq_seq == s.desk.ack;
  out.result = !s.results.queue.empty();
  out.slab_open = open;
  out.fault_present = fault != Code::ok;
  out.warn_present = out.warn != 0;
  out.pose_ok = s.gate.link(s.now_ns) == Code::ok;
  out.scanner_ok = s.links.scanner_online;
  out.plc_link_ok = s.plc.alive;
  // In fault 504 no database is opened.
  out.store_ok = s.recovered && fault != Code::journal_write && fault != Code::store_full && fault != Code::config;

  out.session = s.desk.session;
  out.cmd_ack = s.desk.ack;
  out.cmd_status = s.desk.status;
  out.acq_seq = s.desk.acq_seq;
  out.current_station = s.acquisition.station;
  out.refused = s.desk.refused;
  out.refuse_code = s.desk.refuse_code;
  out.refuse_seq = s.desk.refuse_seq;
  out.utime_us = s.utime_us;
  out.results_pending = static_cast<std::uint16_t>(s.results.queue.size());
  if (!s.results.queue.empty()) out.record = s.results.queue.front();

  if (open) {
    out.slab_no = s.slab.header.slab_no;
    out.slab_type = s.slab.header.slab_type;
    for (std::size_t i = 0; i < s.slab.stations.size(); ++i) {
      const StationRecord& record = s.slab.stations[i];
      out.table[i] = provisional_row(record);
      count_station(out, i, acquired_or_measured(record));
    }
    out.table_slab_no = s.slab.header.slab_no;
  } else {
    out.table = s.results.table;
    out.slab_verdict = s.results.slab_verdict;
    out.slab_reason = s.results.slab_reason;
    out.table_slab_no = s.results.slab_no;
    for (std::size_t i = 0; i < out.table.size(); ++i) count_station(out, i, row_has_scan(out.table[i]));
  }
  return out;
}

}  // namespace slabd::daemon
