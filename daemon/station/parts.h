// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>

#include "daemon/station/station.h"

/// The parts of `step`; private to the station's source files.
///
///   station.cpp        dispatch, time, recovery, faults, the image that the PLC reads
///   commands.cpp       the PLC's commands: permission, refusals, sessions, acknowledgements, a slab's begin and end
///   pose_gate.cpp      whether the robot stands still for a scan
///   still_watch.cpp    the same for a view, with narrower limits
///   exposure.cpp       one request to the scanner: its buffer, its answer, points that were received before
///   acquire.cpp        one SCAN from the settled robot to a measured, committed block
///   capture.cpp        maintenance: views for a calibration
///   station_views.cpp  the stop from which a scan shows its block
///   calibration.cpp    calibration in force, splice of a scan, fault 503
///   gauges.cpp         values of gauges: which of them belong to the slab
///   stored.cpp         meaning of a durable (or failed) store job
namespace slabd::daemon {

// ---- station.cpp ----
[[gnu::format(printf, 4, 5)]] void log(Actions& actions, LogLine::Level level, Code code, const char* format, ...);
void raise_fault(Station& s, Actions& actions, Code code, const char* doing);
/// Passes a job to storage; `pending` contains the meaning of its answer.
template <typename Job>
void submit(Station& s, Actions& actions, const Job& job, PendingStore pending) {
  pending.ticket = ++s.last_ticket;
  StoreJob store;
  store.ticket = pending.ticket;
  store.what = job;
  const bool noted = s.storing.push(pending);
  const bool sent = actions.push(store);
  assert(noted && sent);
  (void)noted;
  (void)sent;
}
template <typename T>
void emit(Actions& actions, const T& action) {
  const bool pushed = actions.push(action);
  assert(pushed);
  (void)pushed;
}
/// The latched fault, or the one the process started with.
[[nodiscard]] Code current_fault(const Station& s);
[[nodiscard]] const Recipe* recipe_for(const Station& s, std::uint16_t slab_type);
/// Basis of the open slab.
[[nodiscard]] inline SlabBasis slab_basis(const Station& s) {
  const TieInForce& tie = s.slab.calibration.tie;
  SlabBasis basis;
  basis.recipe = s.slab.recipe;
  basis.T_base_slab = s.slab.header.T_base_slab;
  for (std::size_t arm = 0; arm < basis.verified.size(); ++arm)
    basis.verified[arm] = s.slab.calibration.arm[arm].scanner.numbers;
  basis.slab = s.slab.facts;
  basis.has_tie = !tie.id.empty() && tie.trouble.empty();
  basis.tie = tie.numbers;
  return basis;
}
/// Number of robots with a scanner.
[[nodiscard]] inline std::size_t arm_count(const Station& s) {
  return s.settings.arms.list.size();
}
/// " (robot 2, scanner 2)" for a message; empty on a line with one arm.
[[nodiscard]] FixedString<64> arm_words(const Station& s, std::size_t arm);
/// Shows another decision about the slab whose verdict is shown.
inline void show_disposition(Station& s, Disposition decision) {
  if (s.results.disposition == decision) return;
  s.results.disposition = decision;
  s.results.disposition_seq = static_cast<std::uint16_t>(s.results.disposition_seq + 1U);
}
/// Emulation bits of the line's configuration and of the present poses of one robot, or of all.
[[nodiscard]] std::uint8_t emulation_of_arm(const Station& s, std::size_t arm);
[[nodiscard]] std::uint8_t emulation_of_line(const Station& s);
/// Emulation bit of the newest scans of all scanners.
[[nodiscard]] std::uint8_t emulation_of_scans(const Station& s);
/// The arm whose links the PLC reads: the first one that has both poses and a scanner, otherwise arm 0.
[[nodiscard]] std::size_t best_arm(const Station& s);
/// The same, plus those of the newest scan, the open slab, and every result shown to the PLC.
[[nodiscard]] std::uint8_t emulation_shown(const Station& s);
/// "line, scan"; empty for 0.
[[nodiscard]] FixedString<32> emulation_words(std::uint8_t bits);

// ---- calibration.cpp ----
/// Time for checking expiry: the wall clock, or the newest record if that is later.
[[nodiscard]] inline std::int64_t expiry_utime_us(const Station& s) {
  return std::max(s.utime_us, s.newest_time.utime_us());
}
/// Puts a stored calibration in force, or the commissioning values if there is none.
void start_calibration(Station& s, const CellCalibration& stored, Actions& actions);
/// The same for the calibration of the open slab.
void recover_slab_calibration(Station& s, const RecoveredLine& line, Actions& actions);
void on_calibration_changed(Station& s, const CellCalibration& calibration);
/// Activates a changed calibration as soon as allowed, and logs once why no slab can begin.
void advance_calibration(Station& s, Actions& actions);
/// Reason why the scans of an arm cannot be used for the next slab.
[[nodiscard]] ArmFault arm_fault(const Station& s, std::size_t arm);
/// One sentence with the fault and its remedy; on a line with several arms it names this one.
[[nodiscard]] FixedString<limits::kErrorTextBytes> describe(const Station& s, std::size_t arm, const ArmFault& fault);
/// Reason why no slab may begin: the fault of arm 0, if no other arm can scan either.
[[nodiscard]] CalibrationFault calibration_fault(const Station& s);
/// Gives the header the calibrations in force of the arms that can be used.
void put_calibrations(const Station& s, SlabHeader& slab);
/// Puts the calibrations of its header in force for the slab that begins.
void take_calibrations(Station& s);
/// True if scans of this arm can be used for the open slab.
[[nodiscard]] bool can_scan(const Station& s, std::size_t arm);
/// Place of the flange in the line's base frame; `T_robot_flange` is in the base of the arm's robot. For the open slab.
[[nodiscard]] Pose in_base_frame(const Station& s, std::size_t arm, const Pose& T_robot_flange);
/// Splice for a scan of this station of the open slab. Logs the reason if it could be corrected but is not.
[[nodiscard]] Splice splice_now(const Station& s, std::size_t arm, std::uint8_t station, const Pose& T_base_flange,
                                Actions& actions);
/// Notes the temperature that a scan declares (NaN: none). Logs when it leaves the range of the acceptance.
void note_scanner_temperature(Station& s, std::size_t arm, double temperature_c, Actions& actions);
/// True if the newest scan's temperature is further from the acceptance's than the configuration allows.
[[nodiscard]] inline bool is_outside_temperature(const Station& s, std::size_t arm) {
  return is_outside_temperature(s.settings.arm(arm).scanner_drift, s.calibration.arm[arm].scanner.numbers,
                                s.arms[arm].scanner_temperature_c);
}
/// Warnings that result from calibrations.
[[nodiscard]] std::uint16_t calibration_warnings(const Station& s);
/// The table of this slab type if it may be used now, otherwise nullptr.
[[nodiscard]] const StationsInForce* usable_table(const Station& s, std::size_t arm, std::uint16_t slab_type);

// ---- commands.cpp ----
void on_plc(Station& s, const PlcInputs& inputs, Actions& actions);
void watch_heartbeat(Station& s, Actions& actions);
void increment_session(Station& s, Actions& actions, const char* why);
/// Sets CMD_STATUS if `cmd_seq` is still the last command.
void set_status(Station& s, std::uint16_t cmd_seq, std::uint16_t status);
inline void set_status(Station& s, std::uint16_t cmd_seq, CommandStatus status) {
  set_status(s, cmd_seq, static_cast<std::uint16_t>(status));
}
inline void set_failed(Station& s, std::uint16_t cmd_seq, Code code) {
  set_status(s, cmd_seq, static_cast<std::uint16_t>(kCommandFailed + static_cast<std::uint16_t>(code)));
}
/// True if the result queue has room for `more` records in addition to those already promised (blocks being measured,
/// the slab's end, repeated records). While a slab is open its own record always has a reserved place.
[[nodiscard]] bool room_for_records(const Station& s, std::size_t more);
/// Starts a journalled command: CMD_ACK already shows it.
void begin_command(Station& s, Actions& actions);
void open_slab(Station& s, const BeginSlabJob& job);
[[nodiscard]] BeginSlabJob slab_to_begin(const Station& s, const PlcInputs& inputs);
void begin_end(Station& s, std::uint16_t cmd_seq, bool aborting, Actions& actions);
void advance_end(Station& s, Actions& actions);
void on_slab_judged(Station& s, const SlabJudged& judged, Actions& actions);
/// Increments RES_SEQ and stores it in the record.
void number_record(Station& s, PlcResult& record);

// ---- exposure.cpp ----
/// An unused buffer, or -1.
[[nodiscard]] int free_slot(const Station& s);
/// Number of a request to the scanner without a command: a view, or a scan that is discarded. Its session is 0, which
/// the PLC never uses. Scanner programs may take a repeated number for a request that they have answered.
std::uint16_t next_own_request(Station& s);
/// Requests a scan of this arm's scanner into this buffer; `e` is that exposure from now on.
void ask_scanner(Station& s, Exposure& e, std::uint8_t arm, int slot, const ScanRequest& request, Actions& actions);
/// True if any scanner may hold an unseen scan.
[[nodiscard]] inline bool any_scan_unseen(const Station& s) {
  return std::any_of(s.arms.begin(), s.arms.end(), [](const StationArm& arm) { return arm.scan_unseen; });
}
/// Frees the buffer if it still belongs to the exposure.
void give_back(Station& s, Exposure& e);
/// Cancels the request. The worker still writes into the buffer, so the exposure ends with its answer.
void break_off(Exposure& e, Actions& actions);
/// Gives up a request whose worker hangs, at once if it was broken off, otherwise `patience_ns` after `since_ns`. Its
/// buffer stays busy until the worker returns. True if it was given up.
[[nodiscard]] bool give_up_when_worker_hangs(Station& s, Exposure& e, std::int64_t since_ns, std::int64_t patience_ns,
                                             Actions& actions);
/// Code for the place where the arm's worker hangs: the scanner's folder, or the disk of the spool.
[[nodiscard]] Code code_of_hang(const Station& s, std::size_t arm);
[[nodiscard]] const char* why_it_hangs(const Station& s, std::size_t arm);
/// Passes the answer to the exposure that it belongs to.
void on_scan_done(Station& s, const ScanDone& done, Actions& actions);
/// True if these points were received before. A scanner program that hangs may export its last scan under every new
/// name, and all 18 blocks look alike. So repeated points are not a scan of this block. Two real scans never agree in
/// all their noise. New points are remembered; the caller stores their fingerprint.
[[nodiscard]] bool is_repeated(Station& s, std::uint64_t fingerprint, Actions& actions);
/// The same for a scan that does not become an attempt: new points are stored by a separate job.
[[nodiscard]] bool was_seen(Station& s, const ScanDone& done, Actions& actions);
void store_fingerprint(Station& s, std::uint64_t fingerprint, Actions& actions);
inline constexpr std::string_view kRepeatedScan =
    "the scanner gave the points of an earlier scan again; restart the scanner program";
/// A pose newer than the end of the exposure must arrive within this time, or the link counts as stale.
inline constexpr std::int64_t kCheckTimeout_ns = kNsPerS;

// ---- acquire.cpp ----
void begin_acquisition(Station& s, const PlcInputs& inputs, Actions& actions);
void advance_acquisition(Station& s, Actions& actions);
/// The answer to the request of a discarded scan and of the block's own.
void on_cleared(Station& s, const ScanDone& done, Actions& actions);
void on_block_scanned(Station& s, const ScanDone& done, Actions& actions);
void on_acquired_stored(Station& s, const PendingStore& pending, Code code, Actions& actions);
void fail_acquisition(Station& s, Code code, Actions& actions);
void abort_acquisition(Station& s, Actions& actions);
void on_block_measured(Station& s, const BlockMeasured& measured, Actions& actions);
/// Passes durable clouds that were not measured (after a restart or a storage fault) to the worker, one at a time. Each
/// is marked in the database first. A cloud during whose measurement a process ended is not measured again: its result
/// is "not measured".
void remeasure(Station& s, Actions& actions);
/// Handles the answer to the job that stored the mark.
void on_measuring_stored(Station& s, const PendingStore& pending, Code code, Actions& actions);
/// SLAB_ABORT does not wait: current measurements are dropped, and their buffers are released by the late answers.
void drop_measurements(Station& s);

// ---- capture.cpp ----
void on_capture_request(Station& s, const CaptureRequest& request, Actions& actions);
void advance_capture(Station& s, Actions& actions);
/// Handles the answer to a fingerprint job: a view may be requested once its mark is durable.
void on_view_marked(Station& s, std::uint32_t ticket, Code code, Actions& actions);
void on_view_scanned(Station& s, const ScanDone& done, Actions& actions);
/// ABORT by the PLC.
void abort_shot(Station& s, Actions& actions);
[[nodiscard]] inline bool in_maintenance(const Station& s) {
  return s.capture.phase != Capture::Phase::closed;
}
/// Folder of views' scans until the calibration session has copied them.
[[nodiscard]] PathText capture_folder(const Station& s);

// ---- gauges.cpp ----
/// Takes the PLC's values if GAUGE_SEQ has changed.
void note_plc_gauges(Station& s, const PlcInputs& in);
void on_gauges_sampled(Station& s, const GaugesSampled& sampled);
void on_gauge_entered(Station& s, const GaugeEntered& entered, Actions& actions);
/// The last check that was made is in force, whatever the clock showed.
void on_gauge_checked(Station& s, const GaugeCheck& check);
void recover_gauges(Station& s, const RecoveredLine& line);
/// The reading if the slab ended now; without an open slab, for the last one.
[[nodiscard]] GaugeReading gauge_reading(const Station& s, std::size_t index);
/// The last value that arrived, of a slab or a master.
[[nodiscard]] const GaugeSample& newest_sample(const Station& s, std::size_t index);
/// Fixes the readings of the open slab at its SLAB_END, also at one that a fault hinders, and logs those that are not
/// usable.
void freeze_gauges(Station& s, Actions& actions);
/// After the slab's result is durable.
void note_used_gauges(Station& s, const SlabResult& result, Actions& actions);
/// Slabs with the same value; nullptr if no slab has one.
[[nodiscard]] const GaugeRun* run_of(const Station& s, std::string_view gauge);
/// A gauge is stuck, or its master check is missing, failed or overdue.
[[nodiscard]] bool gauges_need_care(const Station& s);

// ---- stored.cpp ----
void on_stored(Station& s, const StoreDone& done, Actions& actions);
void store_acknowledgement(Station& s, std::uint16_t res_seq, Actions& actions);

}  // namespace slabd::daemon
