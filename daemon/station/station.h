// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <variant>

#include "base/base.h"
#include "base/calibration.h"
#include "base/jobs.h"
#include "daemon/station/pose_gate.h"
#include "daemon/station/station_views.h"
#include "daemon/station/still_watch.h"

/// The inspection cycle as a pure state machine: `step(station, event, actions)`. No socket, clock, file, thread or
/// log; time arrives in `Tick`. The loop turns ports into events and carries out the actions; each action that can
/// fail is answered by one event.
///
///   idle --SLAB_BEGIN--> slab open --SCAN--> journal -> settle -> scan -> durable (ACQ_SEQ, robot may leave)
///                             ^                               |              |
///                             +---- next SCAN at once      measure ----------+-> commit -> result record
///   slab open --SLAB_END--> wait for measurements -> slab fit -> commit -> slab verdict --RES_ACK--> idle
///
/// Measuring begins when the points are in memory, beside their way to the disk; what it finds is kept back until the
/// scan is durable, and dropped when the scan comes to nothing. A scan that measuring refuses (BlockMeasured::refused)
/// is a failed one as long as it is not acquired; afterwards its block's result is not measured, with the same code.
///
/// Beside it there is maintenance: views for a calibration, taken while no slab is open (capture.cpp).
///
/// Rules that are never bent: nothing is acknowledged or shown before it is durable; a result reads pass only when it
/// was measured and passed; a scan is never repeated on our own account.
namespace slabd::daemon {

// ---- configuration ---------------------------------------------------------------------------------------------

struct StationSettings {
  std::span<const Recipe> recipes;  ///< must outlive the station
  Pose T_base_slab;
  Pose T_flange_scanner;         ///< commissioning values: used until a calibration is applied ...
  CalibrationId calibration_id;  ///< ... and their id; empty: there are none
  SpliceSettings splice;
  std::int64_t check_interval_us = 0;  ///< between daily checks, 0: none are due
  FixedString<64> software;
  PathText spool_dir;
  PoseSettings pose;
  CaptureGuard capture;
  std::uint16_t warn = 0;  ///< PlcWarn bits that hold for the whole run
  Code fault = Code::ok;   ///< a fault that only a restart clears (504 config)
  bool simulation = false;
  std::int64_t settle_timeout_ns = 8 * kNsPerS;  ///< SCAN accepted until settled; acquisition must end in 20 s
  std::int64_t scan_timeout_ns = 10 * kNsPerS;   ///< requested until the scan is seen
  std::int64_t heartbeat_lost_ns = 2'500'000'000;
  std::int64_t heartbeat_period_ns = 500'000'000;
};

// ---- events ----------------------------------------------------------------------------------------------------

/// At start, once, before any other event: what storage remembers.
struct Recovered {
  const RecoveredLine* line = nullptr;  ///< read during the step only
};
struct Tick {
  std::int64_t mono_ns = 0;
  std::int64_t utime_us = 0;
};
struct LinkStatus {
  bool scanner_online = false;
  bool scanner_hangs = false;  ///< its worker may not come back for long
  std::uint64_t stray_files = 0;
  bool spool_hangs = false;     ///< it is the disk of the scans that the worker waits for
  bool recipes_differ = false;  ///< the recipe folder from what is in use
};
/// Twice for a scan that comes: when its points lie in the buffer, and when it is durable. The first may be missing; a
/// scan that comes to nothing has the second alone.
struct ScanDone {
  std::uint16_t cmd_seq = 0;
  std::uint8_t slot = 0;
  bool durable = false;  ///< the last word
  Code code = Code::ok;
  AcquiredScan scan;              ///< valid when code is ok
  std::uint64_t fingerprint = 0;  ///< of its points; 0: not taken
  /// Of its points, with the last word; none: not taken.
  std::optional<std::uint32_t> points_crc32c{};
  FixedString<limits::kErrorTextBytes> text;  ///< why not
};
struct BlockMeasured {
  std::int64_t slab_key = 0;
  std::uint8_t attempt = 0;
  std::uint8_t slot = 0;
  std::uint16_t cmd_seq = 0;  ///< of the SCAN that took this cloud, as it was asked to be measured
  std::int64_t scan_utime_us = 0;
  BlockResult block;
  BlockMaps maps{};    ///< only carried through
  NoisePrint noise{};  ///< only carried through
  /// The points, their noise or the block's place belong to another exposure than the requested one: frame_incomplete.
  /// Then `block` is not measured. ok otherwise.
  Code refused = Code::ok;
  FixedString<limits::kErrorTextBytes> refused_text;  ///< why
};
struct SlabJudged {
  std::int64_t slab_key = 0;
  SlabResult slab;
};
inline constexpr std::uint32_t kNoJobTicket = 0;  ///< of no job: what the storage thread found when it had none
struct StoreDone {
  std::uint32_t ticket = kNoJobTicket;
  Code code = Code::ok;
  double commit_ms = 0.0;                       ///< how long it took, for the status
  FixedString<limits::kErrorTextBytes> text{};  ///< why not, for the status
};
/// Another calibration is in force in the database, or a check was added. An open slab goes on with its own.
struct CalibrationChanged {
  const LineCalibration* calibration = nullptr;  ///< read during the step only
};
using CaptureName = FixedString<100>;
/// Somebody calibrates. What becomes of it stands in Station::capture after the step; `Capture::refusal` says why
/// nothing was done.
struct CaptureRequest {
  enum class Action : std::uint8_t { begin, shoot, keep, release, end } action = Action::keep;
  CaptureName session;
  FixedString<60> operator_name;
  std::uint32_t uid = 0;
  std::int64_t lease_s = 0;
  bool take_over = false;
  PathText scan;  ///< release: which
};
using Event = std::variant<Recovered, Tick, LinkStatus, PlcInputs, PoseSample, ScanDone, BlockMeasured, SlabJudged,
                           StoreDone, CalibrationChanged, CaptureRequest>;

// ---- actions ---------------------------------------------------------------------------------------------------

struct AcquireScan {
  ScanRequest request;
  std::uint8_t slot = 0;  ///< buffer to fill
};
struct CancelScan {};
struct MeasureBlock {
  std::int64_t slab_key = 0;
  std::uint8_t station = 0;
  std::uint8_t attempt = 0;
  std::uint8_t slot = 0;
  std::uint16_t cmd_seq = 0;
  std::int64_t scan_utime_us = 0;
  double read_ms = 0.0;
  bool reload = false;  ///< after a restart: read `scan_path` into the slot first
  PathText scan_path;
  std::optional<std::uint32_t> points_crc32c{};  ///< of the points that were acquired; a reload holds the file to it
  ScanShape shape;
  std::uint16_t slab_type = 0;
  Pose T_base_scanner;  ///< spliced, with the station's correction where it holds
  Pose T_base_slab;
  ScannerNumbers verified;  ///< the scanner's acceptance the slab was begun with
};
/// Answered at once: run the slab fit over `station.blocks()`.
struct JudgeSlab {
  std::int64_t slab_key = 0;
  std::uint16_t slab_type = 0;
};
/// Deletes a scan of a view: it came to nothing, or the session has its copy.
struct DropScan {
  PathText path;
};
/// Deletes views' scans that lie in `folder` for longer than a week.
struct TidyCaptures {
  PathText folder;
};
struct LogLine {
  enum class Level : std::uint8_t { info, warning, error } level = Level::info;
  std::uint16_t code = 0;
  FixedString<limits::kErrorTextBytes> text;
};
using Action =
    std::variant<StoreJob, AcquireScan, CancelScan, MeasureBlock, JudgeSlab, DropScan, TidyCaptures, LogLine>;
using Actions = FixedVector<Action, limits::kActionsMax>;

// ---- state -----------------------------------------------------------------------------------------------------

/// Who may command, and which command is being carried out.
struct CommandDesk {
  std::uint16_t session = 0;       ///< shown to the PLC
  std::uint16_t session_next = 0;  ///< differs while a change of session is on its way to the database
  std::uint32_t writer = 0;        ///< connection that owns HR 10..39; 0 = nobody yet
  std::uint16_t ack = 0;           ///< CMD_ACK
  std::uint16_t status = 0;        ///< CMD_STATUS
  std::uint16_t acq_seq = 0;
  std::uint16_t refused = 0;
  std::uint16_t refuse_code = 0;
  std::uint16_t refuse_seq = 0;
  std::uint16_t judged_seq = 0;  ///< CMD_SEQ (with `judged_echo`) last looked at: a repeated image is not news
  std::uint16_t judged_echo = 0;
  std::uint32_t judged_writer = 0;
  std::uint32_t judged_writes = 0;
  std::uint16_t judged_ack = 0;               ///< CMD_ACK then
  std::int64_t refusal_logged_ns = -kNsPerS;  ///< a peer that repeats itself fills one line a second
  std::int64_t session_logged_ns = -kNsPerS;  ///< likewise
  std::uint32_t sessions_unsaid = 0;
  bool pending = false;        ///< `pending_inputs` waits for its journal entry
  bool pending_abort = false;  ///< ABORT was raised meanwhile
  PlcInputs pending_inputs;    ///< also after it is done: the command of CMD_ACK, when its CMD_SEQ says so
  BeginSlabJob pending_begin;  ///< when it is SLAB_BEGIN
};

struct PlcLink {
  PlcInputs inputs;  ///< last image
  bool alive = false;
  bool was_lost = false;
  std::int64_t changed_ns = 0;  ///< when the heartbeat last changed
};

/// The scan in hand.
struct Acquisition {
  /// clearing: a scan is taken and thrown away first, see Station::scan_unseen.
  enum class Phase : std::uint8_t { none, settling, clearing, scanning, checking, storing } phase = Phase::none;
  std::uint16_t cmd_seq = 0;
  std::uint16_t session = 0;
  std::uint8_t station = 0;
  std::uint8_t slot = 0;
  bool slot_taken = false;
  bool abort = false;  ///< ABORT or SLAB_ABORT while it runs
  std::int64_t started_ns = 0;
  std::int64_t clearing_since_ns = 0;
  std::int64_t cleared_in_ns = 0;  ///< what the scan that was thrown away took; 0: there was none
  std::int64_t settled_ns = 0;
  std::int64_t taken_ns = 0;  ///< checking: when the exposure was over
  double read_ms = 0.0;
  Attempt attempt;
  bool decoded = false;           ///< the points are in the buffer, and are new
  bool repeats = false;           ///< they are those of an earlier scan
  std::uint64_t fingerprint = 0;  ///< of them, when they are new
  /// Measuring ahead of the database, and mostly of the disk. From its beginning on the buffer is the measurement's.
  enum class Ahead : std::uint8_t { no, measuring, measured } ahead = Ahead::no;
  std::int64_t ahead_ns = 0;  ///< when measuring began
  BlockMeasured block;        ///< measured ahead: kept back
};

/// One view for a calibration, taken or refused.
struct CaptureShot {
  std::uint32_t number = 0;  ///< 1, 2, ... of the session; 0: none yet
  bool done = false;
  Code code = Code::ok;
  FixedString<limits::kErrorTextBytes> text;  ///< why it was refused
  // The rest is valid when done and ok.
  PathText scan_path;
  ScanShape shape;
  Pose T_base_flange;  ///< mean of the window
  double spread_mm = 0.0;
  double spread_rad = 0.0;
  std::uint32_t samples = 0;
  PoseSample first;  ///< of the window
  PoseSample last;
  std::int64_t requested_utime_us = 0;
  std::int64_t scan_utime_us = 0;
  std::int64_t pose_age_us = 0;  ///< our wall clock minus the sender's, at the last pose
};

/// Maintenance (STATE 8): who calibrates, and the view in hand. Lost with the process, on purpose.
struct Capture {
  enum class Phase : std::uint8_t { closed, ready, settling, scanning, checking } phase = Phase::closed;
  CaptureName session;
  FixedString<60> operator_name;
  std::uint32_t uid = 0;
  std::int64_t since_utime_us = 0;
  std::int64_t lease_ns = 0;
  std::int64_t lease_until_ns = 0;
  bool ending = false;     ///< ended while the scanner's worker still writes into the buffer
  bool abort = false;      ///< of the view in hand
  bool looked_at = false;  ///< its points were compared with those of earlier scans,
  bool repeats = false;    ///< and are those of one of them
  bool unseen = false;     ///< before it was marked the scanner may have held a scan that nobody saw
  /// kUnseenScan, which has to be durable before the scanner is asked: no journal knows of a view.
  enum class Mark : std::uint8_t { none, storing, durable } mark = Mark::none;
  std::uint32_t mark_ticket = 0;
  std::uint8_t slot = 0;
  std::uint16_t request_no = 0;  ///< see next_own_request(); never starts where the last process did
  std::int64_t started_ns = 0;
  std::int64_t taken_ns = 0;
  CaptureShot shot;             ///< the last one
  Error refusal{Code::ok, {}};  ///< of the last request; ok: carried out
};

enum class SlabPhase : std::uint8_t { none, open, ending, storing_end };

struct OpenSlab {
  SlabPhase phase = SlabPhase::none;
  SlabHeader header;
  const Recipe* recipe = nullptr;
  LineCalibration calibration;  ///< what it was begun with, to its end
  std::array<StationRecord, limits::kStationsMax> stations{};
  std::uint16_t end_seq = 0;  ///< CMD_SEQ of SLAB_END or SLAB_ABORT
  bool aborting = false;
  bool judging = false;  ///< the slab fit has been asked for
  SlabResult result;     ///< while it is being stored
};

/// What the PLC is shown of results.
struct ResultDesk {
  FixedQueue<PlcResult, limits::kResultQueueMax> queue;  ///< front is presented
  std::uint16_t last_seq = 0;
  std::uint16_t ack_before = 0;  ///< RES_ACK that stood here before the record of this number was shown; 0: none
  std::array<PlcStationRow, limits::kStationsMax> table{};
  Verdict slab_verdict = Verdict::none;
  std::uint16_t slab_reason = 0;
  std::uint32_t slab_no = 0;
  std::uint8_t slab_emulated = 0;  ///< emulation bits of the slab whose verdict is shown
  PlcResult slab_record;           ///< for REPORT
};

/// A store job on its way, so that its answer finds its meaning.
struct PendingStore {
  enum class Kind : std::uint8_t {
    session,
    begin_slab,
    command,
    acquired,
    failed_attempt,
    block,
    slab,
    ack,
    report,
    seen_scan,
    measuring
  };
  Kind kind{};
  std::uint32_t ticket = 0;
  std::uint8_t station = 0;
  std::uint8_t attempt = 0;
  std::uint8_t slot = 0;
  std::uint16_t value = 0;  ///< CMD_SEQ, session or RES_SEQ
  std::int64_t slab_key = 0;
  std::uint64_t fingerprint = 0;  ///< that the job is to keep; 0: none
  PlcResult record;
};

/// A request that was given up because the scanner's worker hangs in a call that nobody can end. Whatever it still does
/// is done to its own buffer, and nothing else is asked of it until it is back.
struct OwedScan {
  bool waits = false;
  bool slot_taken = false;  ///< the worker may still write into it
  std::uint8_t slot = 0;
};

struct Station {
  explicit Station(const StationSettings& settings_in)
      : settings(settings_in), gate(settings_in.pose), still(settings_in.capture, settings_in.pose) {}

  StationSettings settings;
  bool recovered = false;
  std::int64_t now_ns = 0;
  std::int64_t utime_us = 0;
  std::uint16_t heartbeat = 0;
  std::int64_t heartbeat_ns = 0;
  std::uint16_t fault = 0;  ///< latched code; FAULT_RESET clears it unless settings.fault holds
  std::uint16_t warn = 0;
  NewestTime newest_time;  ///< of any record
  LinkStatus links;
  LineCalibration calibration;       ///< in force: of the next slab
  LineCalibration calibration_next;  ///< takes its place when no SLAB_BEGIN is on its way to the database
  bool calibration_waits = false;
  CalibrationFault calibration_fault_said = CalibrationFault::none;

  CommandDesk desk;
  PlcLink plc;
  PoseGate gate;
  StillWatch still;  ///< of the view in hand
  Capture capture;
  Acquisition acquisition;
  OpenSlab slab;  ///< with phase none: the last one, as long as no other was begun
  Views views;    ///< where the scans of this slab and the last one showed their blocks
  int stop_alike = 0;  ///< of the last slab: a station whose stop is like the next one's; 0: none
  ResultDesk results;
  std::array<std::uint64_t, kFingerprintsKept> fingerprints{};  ///< of the last scans; 0: none
  std::size_t fingerprint_next = 0;                             ///< the oldest
  /// Those that could not be stored: they go with the first job after which the disk works again.
  FixedVector<std::uint64_t, kFingerprintsKept> unsaved_fingerprints;
  /// Acknowledgements that could not be stored go the same way. One more would only be shown again after a restart.
  FixedVector<std::uint16_t, limits::kResultQueueMax> unsaved_acks;
  /// The scanner may hold a scan that nobody saw (kUnseenScan). What it gives next is remembered and thrown away.
  bool scan_unseen = false;
  bool scan_emulated = false;  ///< the newest scan declared itself emulated
  std::array<bool, limits::kScanSlots> slot_busy{};
  OwedScan owed;
  std::array<bool, limits::kStationsMax> station_measuring{};       ///< until its result is stored
  std::array<std::uint8_t, limits::kStationsMax> measuring_slot{};  ///< the buffer whose answer is waited for
  std::uint32_t measuring = 0;                                      ///< how many of them
  std::int64_t last_slab_key = 0;
  std::uint32_t last_ticket = 0;
  FixedVector<PendingStore, limits::kWorkerQueue> storing;
};

/// One event in, actions out. `actions` is cleared first.
void step(Station& station, const Event& event, Actions& actions);

/// What the PLC reads now.
[[nodiscard]] PlcOutputs plc_view(const Station& station);

}  // namespace slabd::daemon
