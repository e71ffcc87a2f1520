// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>

#include "daemon/station/station.h"

/// The parts `step` is made of; private to the station's source files.
///
///   station.cpp           dispatch, time, recovery, faults
///   commands.cpp          the PLC's command desk: who may command, what is refused, sessions, acknowledgements
///   acquire.cpp           one SCAN from the settled robot to a measured, committed block
///   capture.cpp           maintenance: views for a calibration
///   station_views.cpp     which stop a scan shows its block from
///   commands.cpp              a slab's begin and end
///   stored.cpp            what a durable (or failed) store job means
///   calibration.cpp          which calibration counts, what a scan is spliced with, fault 503
///   station.cpp              what the PLC reads
namespace slabd::daemon {

// ---- station.cpp ----
[[gnu::format(printf, 4, 5)]] void log(Actions& actions, LogLine::Level level, Code code, const char* format, ...);
void raise_fault(Station& s, Actions& actions, Code code, const char* doing);
/// Hands a job to storage; `pending` says what its answer will mean.
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

// ---- station.cpp ----
/// emulation bits of the line as it is configured and of the poses that come now.
[[nodiscard]] std::uint8_t emulation_of_line(const Station& s);
/// The same, and of the newest scan, the open slab, and every result that the PLC is shown.
[[nodiscard]] std::uint8_t emulation_shown(const Station& s);
/// "line, scan"; empty for 0.
[[nodiscard]] FixedString<32> emulation_words(std::uint8_t bits);

// ---- calibration.cpp ----
/// Time for expiry: the wall clock, or the newest record where that is later.
[[nodiscard]] inline std::int64_t expiry_utime_us(const Station& s) {
  return std::max(s.utime_us, s.newest_time.utime_us());
}
void recover_calibration(Station& s, const RecoveredLine& line, Actions& actions);
void on_calibration_changed(Station& s, const LineCalibration& calibration);
/// Takes up a changed calibration when it may, and says once what keeps slabs from beginning.
void advance_calibration(Station& s, Actions& actions);
/// May a slab begin?
[[nodiscard]] CalibrationFault calibration_fault(const Station& s);
/// What a scan of this station of the open slab is spliced with; says why when it is not corrected though it could be.
[[nodiscard]] Splice splice_now(const Station& s, std::uint8_t station, const Pose& T_base_flange, Actions& actions);
/// Warnings that follow from calibrations.
[[nodiscard]] std::uint16_t calibration_warnings(const Station& s);
/// The table of this slab type if it may be used now, else nullptr.
[[nodiscard]] const StationsInForce* usable_table(const Station& s, std::uint16_t slab_type);

// ---- commands.cpp ----
void on_plc(Station& s, const PlcInputs& inputs, Actions& actions);
void watch_heartbeat(Station& s, Actions& actions);
void bump_session(Station& s, Actions& actions, const char* why);
/// Sets CMD_STATUS if `cmd_seq` is still the last command.
void set_status(Station& s, std::uint16_t cmd_seq, std::uint16_t status);
inline void set_status(Station& s, std::uint16_t cmd_seq, CommandStatus status) {
  set_status(s, cmd_seq, static_cast<std::uint16_t>(status));
}
inline void set_failed(Station& s, std::uint16_t cmd_seq, Code code) {
  set_status(s, cmd_seq, static_cast<std::uint16_t>(kCommandFailed + static_cast<std::uint16_t>(code)));
}
/// Is there room in the result queue for `more` records beside those already promised (blocks being measured, the
/// slab's end, repeated records on their way)? While a slab is open its own record always keeps a place.
[[nodiscard]] bool room_for_records(const Station& s, std::size_t more);
/// A journalled command begins: CMD_ACK has moved to it.
void begin_command(Station& s, Actions& actions);

// ---- acquire.cpp ----
void begin_acquisition(Station& s, const PlcInputs& inputs, Actions& actions);
void advance_acquisition(Station& s, Actions& actions);
void on_scan_done(Station& s, const ScanDone& done, Actions& actions);
void on_acquired_stored(Station& s, const PendingStore& pending, Code code, Actions& actions);
void fail_acquisition(Station& s, Code code, Actions& actions);
/// A scanner program that hangs may export its last scan under every new name, and 18 blocks are as alike as one to
/// itself: the same points again are no scan of this block. Two real scans never agree in all their noise.
/// True: the points of this scan were there before. New ones are remembered, for good by a job of their own: this is
/// for scans that become no attempt.
[[nodiscard]] bool was_seen(Station& s, const ScanDone& done, Actions& actions);
void store_fingerprint(Station& s, std::uint64_t fingerprint, Actions& actions);
inline constexpr std::string_view kRepeatedScan =
    "the scanner gave the points of an earlier scan again; restart the scanner program";
/// Gives up the request in hand of a worker that hangs; with `slot_taken` its buffer stays busy until the worker is
/// back.
void owe_scan(Station& s, std::uint8_t slot, bool slot_taken, Actions& actions);
/// Where a worker that hangs does so: in the scanner's folder, or on the disk of the spool.
[[nodiscard]] Code code_of_hang(const Station& s);
[[nodiscard]] const char* why_it_hangs(const Station& s);
void abort_acquisition(Station& s, Actions& actions);
void on_block_measured(Station& s, const BlockMeasured& measured, Actions& actions);
/// Clouds that are durable and not measured (after a restart or a storage fault) go back to the worker, one at a time,
/// each marked in the database first. One on which a process ended is not measured again: its result is "not measured".
void remeasure(Station& s, Actions& actions);
/// The answer to the mark.
void on_measuring_stored(Station& s, const PendingStore& pending, Code code, Actions& actions);
/// SLAB_ABORT does not wait: what is being measured is dropped, its buffers come back with the late answers.
void drop_measurements(Station& s);

/// A buffer nobody uses, or -1.
[[nodiscard]] int free_slot(const Station& s);

// ---- capture.cpp ----
void on_capture_request(Station& s, const CaptureRequest& request, Actions& actions);
void advance_capture(Station& s, Actions& actions);
/// The number of a request to the scanner that no command stands behind: a view, or a scan that is thrown away. Its
/// session is 0, which is never the PLC's. Scanner programs may take a number they know for a request they have
/// answered.
std::uint16_t next_own_request(Station& s);
/// The answer to a fingerprint job: a view may be asked for when its mark is durable.
void on_view_marked(Station& s, std::uint32_t ticket, Code code, Actions& actions);
/// True: the scan was a view's.
[[nodiscard]] bool on_view_scanned(Station& s, const ScanDone& done, Actions& actions);
/// ABORT by the PLC.
void abort_shot(Station& s, Actions& actions);
[[nodiscard]] inline bool in_maintenance(const Station& s) {
  return s.capture.phase != Capture::Phase::closed;
}
/// Where views' scans lie until the session has them.
[[nodiscard]] PathText capture_folder(const Station& s);

// ---- commands.cpp ----
void open_slab(Station& s, const BeginSlabJob& job);
[[nodiscard]] BeginSlabJob slab_to_begin(const Station& s, const PlcInputs& inputs);
void begin_end(Station& s, std::uint16_t cmd_seq, bool aborting, Actions& actions);
void advance_end(Station& s, Actions& actions);
void on_slab_judged(Station& s, const SlabJudged& judged, Actions& actions);
/// Counts RES_SEQ up and stamps the record with it.
void number_record(Station& s, PlcResult& record);

// ---- stored.cpp ----
void on_stored(Station& s, const StoreDone& done, Actions& actions);
void store_acknowledgement(Station& s, std::uint16_t res_seq, Actions& actions);

}  // namespace slabd::daemon
