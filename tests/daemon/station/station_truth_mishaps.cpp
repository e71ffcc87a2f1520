// SPDX-License-Identifier: Apache-2.0
//
// Random commands and random faults.
#include <algorithm>

#include "tests/daemon/station/station_truth_line.h"

namespace slabd::daemon {

// ---- the PLC -------------------------------------------------------------------------------------------------------

void TruthLine::act_as_plc() {
  if (chance_.happens(0.05)) acknowledge();
  // Discarded scans are rare and can end in several ways.
  const double abort = scanner_.throws_away() ? 0.02 : 0.004;
  if (chance_.happens(plc_.abort ? 0.1 : abort)) press_abort(!plc_.abort);
  if (station_->fault != 0 && chance_.happens(0.03)) reset_fault();
  if (chance_.happens(0.002)) {
    ++plc_.sync_req;
    feed(plc_);
  }
  if (chance_.happens(0.001)) plc_.command_writer = static_cast<std::uint32_t>(chance_.between(1, 3));
  const PlcOutputs view = plc_view(*station_);
  const bool is_hasty = chance_.happens(0.003);  // does not wait for the end of the last command
  if (is_hasty || (!view.busy && chance_.happens(0.2))) give_some_order(view);
}

void TruthLine::give_some_order(const PlcOutputs& view) {
  if (in_maintenance_) {
    if (view.slab_open) order(PlcCommand::slab_abort);
    return;
  }
  if (!view.slab_open && chance_.happens(0.7)) {
    order(PlcCommand::slab_begin);
    return;
  }
  switch (chance_.between(0, 40)) {
    case 0: order(PlcCommand::slab_abort); break;
    case 1:
    case 2: order(PlcCommand::slab_begin); break;
    case 3:
    case 4: order(PlcCommand::slab_end); break;
    case 5:
    case 6: order(PlcCommand::report, chance_.between(0, limits::kStationsMax)); break;
    default: order(PlcCommand::scan, chance_.between(1, 5)); break;
  }
}

void TruthLine::order(PlcCommand what, int station_no) {
  const PlcOutputs view = plc_view(*station_);
  if (what == PlcCommand::scan && !view.busy) robot_station_ = station_no;
  plc_.enable = true;
  ++plc_.heartbeat;
  plc_.command = static_cast<std::uint16_t>(what);
  plc_.station = static_cast<std::uint16_t>(station_no);
  plc_.slab_type = recipe_.slab_type;
  plc_.session_echo = view.session;
  plc_.cmd_seq = next_sequence(view.cmd_ack);
  if (plc_.command_writer == 0) plc_.command_writer = 1;
  ++plc_.command_writes;
  feed(plc_);
}

void TruthLine::press_abort(bool pressed) {
  plc_.abort = pressed;
  feed(plc_);
}

void TruthLine::reset_fault() {
  for (const bool pressed : {true, false}) {
    plc_.fault_reset = pressed;
    feed(plc_);
  }
}

void TruthLine::acknowledge() {
  const std::uint16_t res_seq = plc_view(*station_).record.res_seq;
  if (res_seq == 0) return;
  plc_.res_ack = res_seq;
  feed(plc_);
}

// ---- maintenance and faults ----------------------------------------------------------------------------------------

/// Views for a calibration, mostly while the PLC is idle, from two independent sessions.
void TruthLine::act_as_maintenance() {
  if (chance_.happens(in_maintenance_ ? 0.0015 : 0.001)) in_maintenance_ = !in_maintenance_;
  if (chance_.happens(0.002)) change_calibration();
  if (!chance_.happens(in_maintenance_ ? 0.04 : 0.003)) return;
  CaptureRequest request;
  request.action = static_cast<CaptureRequest::Action>(chance_.between(0, 4));
  request.session = chance_.happens(0.8) ? "a" : "b";
  request.operator_name = "x";
  request.lease_s = 10;
  request.take_over = chance_.happens(0.3);
  request.scan = "/spool/capture/1-1";
  feed(request);
}

void TruthLine::change_calibration() {
  CellCalibration calibration;
  calibration.arm[0] = calibration_named(chance_.happens(0.5) ? "he-1" : "he-2");
  if (chance_.happens(0.1)) calibration.arm[0].expires_utime_us = utime_us_ + chance_.between(-100, 100) * 1'000'000LL;
  store_.line.calibration = calibration;
  feed(CalibrationChanged{&calibration});
}

void TruthLine::let_things_go_wrong() {
  if (chance_.happens(poses_come_ ? 0.0006 : 0.02)) poses_come_ = !poses_come_;
  if (chance_.happens(scanner_.worker_hangs ? 0.012 : 0.002)) scanner_.worker_hangs = !scanner_.worker_hangs;
  if (chance_.happens(0.004)) scanner_.is_frozen = chance_.happens(0.6);
  if (chance_.happens(disk_.fails ? 0.012 : 0.001)) disk_.fails = !disk_.fails;
  if (chance_.happens(0.003)) disk_.is_slow = chance_.happens(0.5);
  if (chance_.happens(0.0005)) utime_us_ += chance_.between(-400, 400) * std::int64_t{86'400'000'000};
  if (disk_.is_telling_moment) {
    disk_.is_telling_moment = false;
    if (chance_.happens(0.3)) scanner_.is_frozen = true;
    if (chance_.happens(0.6)) dies_at_turn_ = turn_ + chance_.between(0, chance_.happens(0.7) ? 3 : 200);
  }
  if (turn_ == dies_at_turn_ || chance_.happens(0.0008)) die();
}

/// True if the scanner holds a scan that a new process would not recognise, and may return it for the next request.
bool TruthLine::a_restart_would_be_deceived() const {
  const std::uint64_t held = scanner_.holds().fingerprint;
  const bool is_known = std::find(store_.seen.begin(), store_.seen.end(), held) != store_.seen.end();
  return held != 0 && !is_known && store_.trusts_scanner();
}

void TruthLine::die() {
  ++figures_.deaths;
  start();
}

}  // namespace slabd::daemon
