// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <variant>

#include "base/arm.h"
#include "base/base.h"
#include "base/calibration.h"
#include "base/id_pattern.h"
#include "base/jobs.h"
#include "base/rate_limit.h"
#include "daemon/station/pose_gate.h"
#include "daemon/station/station_views.h"
#include "daemon/station/still_watch.h"

/// The inspection cycle as a pure state machine: `step(station, event, actions)`. No socket, clock, file, thread or
/// log; time arrives in `Tick`. The loop turns ports into events and carries out the actions. Each action that can fail
/// is answered by one event.
///
///   idle --SLAB_BEGIN--> slab open --SCAN--> journal -> settle -> scan -> durable (ACQ_SEQ, robot may leave)
///                             ^                               |              |
///                             +---- next SCAN at once      measure ----------+-> commit -> result record
///   slab open --SLAB_END--> wait for measurements -> slab fit -> commit -> slab verdict --RES_ACK--> idle
///
/// Measuring starts when the points are in memory, parallel to writing them to the disk. Its result is kept back until
/// the scan is durable, and dropped if the scan fails. A scan that measuring refuses (BlockMeasured::refused) is a
/// failed scan until it is acquired; afterwards its block's result is "not measured", with the same code.
///
/// There is also maintenance: views for a calibration, taken while no slab is open (capture.cpp).
///
/// Rules without exception: data are acknowledged and shown only after they are durable. A result reads pass only if it
/// was measured and passed. slabd never repeats a scan on its own initiative.
namespace slabd::daemon {

// ---- configuration ---------------------------------------------------------------------------------------------

/// Settings of an arm: its robot, and the scanner on its flange.
struct StationArmSettings {
  Pose T_flange_scanner;         ///< commissioning values: used until a calibration is applied
  CalibrationId calibration_id;  ///< id of these values; empty: there are none
  SpliceSettings splice;
  ScannerDriftSettings scanner_drift;
  PoseSettings pose;
  std::int64_t settle_timeout_ns = 8 * kNsPerS;  ///< from SCAN accepted to settled; acquisition must end in 20 s
  std::int64_t scan_timeout_ns = 10 * kNsPerS;   ///< from request to scan
};

/// The base class contains the settings of arm 0.
struct StationSettings : StationArmSettings {
  LineArms arms;                                                    ///< who may scan which station
  FixedVector<StationArmSettings, limits::kArmsMax - 1> more_arms;  ///< arms after the first: [arm - 1]
  /// Those of arm 0 if there is no such arm.
  [[nodiscard]] const StationArmSettings& arm(std::size_t index) const {
    return index == 0 || index > more_arms.size() ? *this : more_arms[index - 1];
  }
  std::span<const Recipe> recipes;        ///< must outlive the station
  std::span<const DesignSheet> designs;   ///< ascending by SLAB_ID; must outlive the station
  bool designs_faulty = false;            ///< a sheet could not be read: a slab without a sheet may have had one
  std::span<const GaugeSettings> gauges;  ///< of the line; must outlive the station
  bool plc_memory_lasts = false;          ///< slabd is the client: the PLC's registers may hold values of any age
  Pose T_base_slab;
  const IdPattern* id_pattern = nullptr;     ///< form of a SLAB_ID; nullptr: any text. Must outlive the station
  const IdPattern* mould_from_id = nullptr;  ///< its group is the mould; nullptr: not in the id. Must outlive it
  bool second_chip_required = false;         ///< SLAB_BEGIN without SECOND_CHIP (HR 35) is refused
  std::int64_t check_interval_us = 0;        ///< interval of daily checks, 0: none are due
  FixedString<64> software;
  PathText spool_dir;
  CaptureGuard capture;
  std::uint16_t warn = 0;  ///< PlcWarn bits that are set for the whole run
  Code fault = Code::ok;   ///< a fault that FAULT_RESET does not clear: 504 config, or NotRecovered::fault
  bool simulation = false;
  std::int64_t heartbeat_lost_ns = 2'500'000'000;
  std::int64_t heartbeat_period_ns = 500'000'000;
};

// ---- events ----------------------------------------------------------------------------------------------------

/// The stored state. A station gets this event or NotRecovered, exactly once; until then it accepts no command.
struct Recovered {
  const RecoveredLine* line = nullptr;  ///< read during the step only
};
/// The stored state cannot be read. Every command is refused with `fault`.
struct NotRecovered {
  Code fault = Code::journal_write;
};
struct Tick {
  std::int64_t mono_ns = 0;
  std::int64_t utime_us = 0;
};
/// Links of one arm.
struct LinkStatus {
  bool scanner_online = false;
  bool scanner_hangs = false;  ///< its worker may be blocked for a long time
  std::uint64_t stray_files = 0;
  bool spool_hangs = false;     ///< the worker is blocked by the disk of the scans
  bool recipes_differ = false;  ///< between the recipe folder and the recipes in use
  std::uint8_t arm = 0;
};
/// Sent twice for a successful scan: when its points are in the buffer, and when it is durable. The first event may be
/// missing; a failed scan has only the second.
struct ScanDone {
  std::uint16_t cmd_seq = 0;
  std::uint8_t slot = 0;
  bool durable = false;  ///< the final event of this scan
  Code code = Code::ok;
  AcquiredScan scan;              ///< valid if code is ok
  std::uint64_t fingerprint = 0;  ///< of its points; 0: not computed
  /// CRC-32C of the scan's points. Set only in the final ScanDone; nullopt if it was not computed.
  std::optional<std::uint32_t> points_crc32c{};
  FixedString<limits::kErrorTextBytes> text;  ///< reason of the failure
  std::uint8_t arm = 0;                       ///< whose scanner this is
};
/// Identity of one scan of a slab, carried whole from its attempt through the measurement to the result.
struct ScanId {
  std::int64_t slab_key = 0;
  std::uint8_t station = 0;
  std::uint8_t attempt = 0;
  std::uint16_t cmd_seq = 0;  ///< of the SCAN that took it
  std::int64_t scan_utime_us = 0;
  /// True if both are the same attempt at the same station of the same slab.
  [[nodiscard]] bool is_attempt_of(const ScanId& other) const {
    return slab_key == other.slab_key && station == other.station && attempt == other.attempt;
  }
};
[[nodiscard]] inline ScanId id_of(const Attempt& attempt) {
  return {attempt.slab_key, attempt.station, attempt.number, attempt.cmd_seq, attempt.scan_utime_us};
}
struct BlockMeasured {
  ScanId id;  ///< of the cloud, when its measurement was ordered
  std::uint8_t slot = 0;
  BlockResult block;
  BlockMaps maps{};    ///< only passed on
  NoisePrint noise{};  ///< only passed on
  /// frame_incomplete if the points, their noise or the block's position belong to another exposure than the requested
  /// one; `block` is then "not measured". Otherwise ok.
  Code refused = Code::ok;
  FixedString<limits::kErrorTextBytes> refused_text;  ///< reason
};
struct SlabJudged {
  std::int64_t slab_key = 0;
  SlabResult slab;
};
inline constexpr std::uint32_t kNoJobTicket = 0;  ///< without a job: an error that the storage thread found while idle
struct StoreDone {
  std::uint32_t ticket = kNoJobTicket;
  Code code = Code::ok;
  double commit_ms = 0.0;                       ///< duration, for the status
  FixedString<limits::kErrorTextBytes> text{};  ///< reason of the failure, for the status
};
/// The calibration in force in the database has changed, or a check was added. An open slab keeps its own.
struct CalibrationChanged {
  const CellCalibration* calibration = nullptr;  ///< read during the step only
};
/// Quality decided about a slab that did not pass.
struct DispositionKept {
  std::int64_t slab_key = 0;
  Disposition decision = Disposition::none;
};
/// The newest samples of the instruments that slabd reads, and of UDP.
struct GaugesSampled {
  const GaugeSamples* samples = nullptr;  ///< read during the step only; [index of StationSettings::gauges]
};
/// Value that a person has entered.
struct GaugeEntered {
  std::size_t index = 0;  ///< of StationSettings::gauges; its link is `manual`
  double value = 0.0;     ///< before its scale
  std::uint32_t slab_no = 0;
  std::uint32_t uid = 0;
};
/// A master check was stored.
struct GaugeChecked {
  GaugeCheck check;
};
using CaptureName = FixedString<100>;
/// Request of an operator who calibrates. After the step its result is in Station::capture; `Capture::refusal` holds
/// the reason of a refusal.
struct CaptureRequest {
  enum class Action : std::uint8_t { begin, shoot, keep, release, end } action = Action::keep;
  CaptureName session;
  FixedString<60> operator_name;
  std::uint32_t uid = 0;
  std::int64_t lease_s = 0;
  bool take_over = false;
  PathText scan;   ///< release: the scan to release
  PartId scanner;  ///< begin: the scanner that is calibrated; empty: the only one
};
using Event = std::variant<Recovered, NotRecovered, Tick, LinkStatus, PlcInputs, PoseSample, ScanDone, BlockMeasured,
                           SlabJudged, StoreDone, CalibrationChanged, DispositionKept, GaugesSampled, GaugeEntered,
                           GaugeChecked, CaptureRequest>;

// ---- actions ---------------------------------------------------------------------------------------------------

struct AcquireScan {
  ScanRequest request;
  std::uint8_t slot = 0;  ///< buffer to fill
  std::uint8_t arm = 0;   ///< whose scanner takes the scan
};
struct CancelScan {
  std::uint8_t arm = 0;
};
struct MeasureBlock {
  ScanId id;
  std::uint8_t slot = 0;
  double read_ms = 0.0;
  bool reload = false;  ///< after a restart: read `scan_path` into the slot first
  PathText scan_path;
  std::optional<std::uint32_t> points_crc32c{};  ///< of the acquired points; a reload is checked against it
  ScanShape shape;
  SlabBasis basis;
  Pose T_base_scanner;              ///< spliced, with the station's correction if it holds
  double scanner_drift = kNoValue;  ///< as in Attempt
  std::uint8_t arm = 0;             ///< as in Attempt
};
/// Runs the slab fit over the stations of the open slab; answered at once.
struct JudgeSlab {
  std::int64_t slab_key = 0;
  SlabBasis basis;
};
/// Deletes a view's scan: the view failed, or the calibration session has copied it.
struct DropScan {
  PathText path;
};
/// Deletes views' scans that have been in `folder` for longer than a week.
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

/// State of the command interface: the commanding connection and the command in progress.
struct CommandState {
  std::uint16_t session = 0;       ///< shown to the PLC
  std::uint16_t session_next = 0;  ///< differs from `session` while a change of session is being stored
  std::uint32_t writer = 0;        ///< connection that owns HR 10..39; 0 = none yet
  std::uint16_t ack = 0;           ///< CMD_ACK
  std::uint16_t status = 0;        ///< CMD_STATUS
  std::uint16_t acq_seq = 0;
  std::uint16_t refused = 0;
  std::uint16_t refuse_code = 0;
  std::uint16_t refuse_seq = 0;
  std::uint16_t judged_seq = 0;  ///< last CMD_SEQ evaluated (with `judged_echo`); a repeated image is ignored
  std::uint16_t judged_echo = 0;
  std::uint32_t judged_writer = 0;
  std::uint32_t judged_writes = 0;
  std::uint16_t judged_ack = 0;      ///< CMD_ACK at that time
  RateLimit refusal_limit{kNsPerS};  ///< of the log lines that a repeating peer causes
  RateLimit session_limit{kNsPerS};  ///< the same for changes of session
  std::uint32_t sessions_unsaid = 0;
  bool pending = false;        ///< `pending_inputs` is being journalled
  bool pending_abort = false;  ///< ABORT was raised in the meantime
  PlcInputs pending_inputs;    ///< kept afterwards: the command of CMD_ACK, if its CMD_SEQ matches
  BeginSlabJob pending_begin;  ///< if it is SLAB_BEGIN
};

struct PlcLink {
  PlcInputs inputs;  ///< last image
  bool alive = false;
  bool was_lost = false;
  std::int64_t changed_ns = 0;  ///< time of the last change of the heartbeat
};

/// One request to the scanner and its answer: for a block (Acquisition), for a scan that is discarded first, or for a
/// view of a calibration (Capture). The owner's phase says whether the answer is awaited.
struct Exposure {
  std::uint8_t arm = 0;       ///< whose scanner got the request
  std::uint16_t cmd_seq = 0;  ///< of the request
  std::uint8_t slot = 0;      ///< buffer of the points
  bool slot_taken = false;    ///< the buffer belongs to this exposure
  bool abort = false;         ///< broken off; it ends with the answer of the scanner's worker
  bool looked_at = false;     ///< its points were compared with those of earlier scans
  bool repeats = false;       ///< its points are those of an earlier scan
  std::int64_t taken_ns = 0;  ///< end of the exposure
};

/// The current scan.
struct Acquisition {
  /// clearing: a scan is taken and discarded first, see Station::scan_unseen.
  enum class Phase : std::uint8_t { none, settling, clearing, scanning, checking, storing } phase = Phase::none;
  std::uint16_t cmd_seq = 0;
  std::uint16_t session = 0;
  std::uint8_t station = 0;
  Exposure exposure;
  std::int64_t started_ns = 0;
  std::int64_t clearing_since_ns = 0;
  std::int64_t cleared_in_ns = 0;  ///< duration of the discarded scan; 0: there was none
  std::int64_t settled_ns = 0;
  double read_ms = 0.0;
  Attempt attempt;
  std::uint64_t fingerprint = 0;  ///< of the points, if they are new
  /// State of measuring before the scan is recorded and, mostly, on the disk. From its start the buffer belongs to the
  /// measurement.
  enum class Ahead : std::uint8_t { no, measuring, measured } ahead = Ahead::no;
  std::int64_t ahead_ns = 0;  ///< start of measuring
  BlockMeasured block;        ///< result measured ahead, kept back
};

/// One view for a calibration, taken or refused.
struct CaptureShot {
  std::uint32_t number = 0;  ///< 1, 2, ... of the session; 0: none yet
  bool done = false;
  Code code = Code::ok;
  FixedString<limits::kErrorTextBytes> text;  ///< reason of the refusal
  // The rest is valid if done and ok.
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
  std::int64_t pose_age_us = 0;  ///< slabd's wall clock minus the sender's, at the last pose
};

/// Maintenance (STATE 8): the operator who calibrates, and the current view. Intentionally not kept over a restart.
struct Capture {
  enum class Phase : std::uint8_t { closed, ready, settling, scanning, checking } phase = Phase::closed;
  std::uint8_t arm = 0;  ///< whose scanner is calibrated
  CaptureName session;
  FixedString<60> operator_name;
  std::uint32_t uid = 0;
  std::int64_t since_utime_us = 0;
  std::int64_t lease_ns = 0;
  std::int64_t lease_until_ns = 0;
  bool ending = false;  ///< ended while the scanner's worker still writes into the buffer
  Exposure exposure;    ///< of the current view
  bool unseen = false;  ///< before its mark the scanner might have held an unseen scan
  /// kUnseenScan, which must be durable before the request, because views are not journalled.
  enum class Mark : std::uint8_t { none, storing, durable } mark = Mark::none;
  std::uint32_t mark_ticket = 0;
  std::int64_t started_ns = 0;
  CaptureShot shot;             ///< the last view
  Error refusal{Code::ok, {}};  ///< of the last request; ok: it was carried out
};

enum class SlabPhase : std::uint8_t { none, open, ending, storing_end };

struct OpenSlab {
  SlabPhase phase = SlabPhase::none;
  SlabHeader header;
  const Recipe* recipe = nullptr;
  SlabFacts facts;
  /// Calibrations of the slab, from its begin to its end. The header names those of the arms that could be used then.
  CellCalibration calibration;
  std::array<StationRecord, limits::kStationsMax> stations{};
  std::uint16_t end_seq = 0;  ///< CMD_SEQ of SLAB_END or SLAB_ABORT
  bool aborting = false;
  bool judging = false;  ///< the slab fit is in progress
  SlabResult result;     ///< while it is being stored
};

/// Results as shown to the PLC.
struct ResultState {
  FixedQueue<PlcResult, limits::kResultQueueMax> queue;  ///< the front is shown
  std::uint16_t last_seq = 0;
  std::uint16_t ack_before = 0;  ///< RES_ACK before the record with this number was shown; 0: another number
  std::array<PlcStationRow, limits::kStationsMax> table{};
  Verdict slab_verdict = Verdict::none;
  std::uint16_t slab_reason = 0;
  std::uint32_t slab_no = 0;
  std::uint8_t slab_emulated = 0;               ///< emulation bits of the slab whose verdict is shown
  PlcResult slab_record;                        ///< for REPORT
  Disposition disposition = Disposition::none;  ///< of the slab whose verdict is shown
  std::uint16_t disposition_seq = 0;            ///< counts its changes
};

/// A store job in progress, with the data needed to handle its answer.
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
  std::uint64_t fingerprint = 0;  ///< to be stored by the job; 0: none
  PlcResult record;
};

/// A request that was given up because the scanner's worker hangs in a call that cannot be interrupted. The worker can
/// only write to its own buffer, and it receives no other request until it returns.
struct AbandonedScan {
  bool waits = false;
  bool slot_taken = false;  ///< the worker may still write into the slot
  std::uint8_t slot = 0;
};

/// Gauges of the line (gauges.cpp), [index of StationSettings::gauges].
struct LineGauges {
  GaugeSamples samples{};
  GaugeSamples masters{};                               ///< sent without a slab, by a PLC or a hub
  std::array<GaugeCheck, limits::kGaugesMax> checks{};  ///< the newest one of each
  GaugeReadings used;                                   ///< of the last slab that was judged with gauges
  GaugeRuns runs;
  std::int64_t slab_begin_ns = 0;  ///< SLAB_BEGIN of the open slab; 0: it was open when slabd started
  bool end_before_start = false;   ///< its SLAB_END was given before slabd started, and the readings of then are lost
  std::uint16_t plc_seq = 0;       ///< GAUGE_SEQ of the last image
  bool plc_seen = false;           ///< an image was seen
};

/// State of an arm.
struct StationArm {
  StationArm(const PoseSettings& pose, const CaptureGuard& capture) : gate(pose), still(capture, pose) {}

  PoseGate gate;
  StillWatch still;  ///< for the current view
  LinkStatus links;
  AbandonedScan abandoned;
  /// The scanner may hold a scan whose points were not seen (kUnseenScan). Its next scan is remembered and discarded.
  bool scan_unseen = false;
  bool scan_emulated = false;               ///< the newest scan declared itself emulated
  double scanner_temperature_c = kNoValue;  ///< of the newest scan, of a block or a view; NaN: it declared none
};

/// Reason why the scans of an arm cannot be used.
struct ArmFault {
  CalibrationFault calibration = CalibrationFault::none;
  TieFault tie = TieFault::none;  ///< of arms after the first
  [[nodiscard]] bool any() const { return calibration != CalibrationFault::none || tie != TieFault::none; }
  friend bool operator==(const ArmFault&, const ArmFault&) = default;
};

struct Station {
  explicit Station(const StationSettings& settings_in) noexcept
      : settings(settings_in),
        arms{StationArm(settings_in.arm(0).pose, settings_in.capture),
             StationArm(settings_in.arm(1).pose, settings_in.capture)} {}

  StationSettings settings;
  bool recovered = false;
  bool without_store = false;  ///< the stored state could not be read: whether a slab is open is unknown
  std::int64_t now_ns = 0;
  std::int64_t utime_us = 0;
  std::uint16_t heartbeat = 0;
  std::int64_t heartbeat_ns = 0;
  std::uint16_t fault = 0;  ///< latched code; FAULT_RESET clears it unless settings.fault holds
  std::uint16_t warn = 0;
  NewestTime newest_time;                         ///< of any record
  std::array<StationArm, limits::kArmsMax> arms;  ///< as many count as settings.arms lists
  CellCalibration calibration;                    ///< in force: for the next slab
  CellCalibration calibration_next;               ///< replaces it once no SLAB_BEGIN is being stored
  bool calibration_waits = false;
  std::array<ArmFault, limits::kArmsMax> arm_fault_said{};

  CommandState command;
  PlcLink plc;
  Capture capture;
  Acquisition acquisition;
  LineGauges gauges;
  OpenSlab slab;       ///< with phase none: the last slab, until another begins
  Views views;         ///< block positions in the scans of this slab and the last one
  int stop_alike = 0;  ///< station of the last slab whose stop is like the next one's; 0: none
  ResultState results;
  std::array<std::uint64_t, kFingerprintsKept> fingerprints{};  ///< of the last scans; 0: none
  std::size_t fingerprint_next = 0;                             ///< the oldest
  /// Fingerprints that could not be stored: they are stored after the first job that succeeds.
  FixedVector<std::uint64_t, kFingerprintsKept> unsaved_fingerprints;
  /// Acknowledgements that could not be stored; stored the same way. If one more is lost, its record is only shown
  /// again after a restart.
  FixedVector<std::uint16_t, limits::kResultQueueMax> unsaved_acks;
  std::array<bool, limits::kScanSlotsMax> slot_busy{};  ///< as many count as limits::scan_slots() gives the arms
  std::uint16_t own_request = 0;  ///< see next_own_request(); starts at another number in each process
  std::array<bool, limits::kStationsMax> station_measuring{};       ///< until its result is stored
  std::array<std::uint8_t, limits::kStationsMax> measuring_slot{};  ///< the buffer whose answer is awaited
  std::uint32_t measuring = 0;                                      ///< number of stations being measured
  std::int64_t last_slab_key = 0;
  std::uint32_t last_ticket = 0;
  FixedVector<PendingStore, limits::kWorkerQueue> storing;
};

/// Processes one event and fills `actions`, which is cleared first.
void step(Station& station, const Event& event, Actions& actions);

/// The image that the PLC reads now.
[[nodiscard]] PlcOutputs plc_view(const Station& station);

}  // namespace slabd::daemon
