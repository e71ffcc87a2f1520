// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <variant>
#include <vector>

#include "base/calibration.h"
#include "base/noise_print.h"
#include "base/packed_map.h"
#include "base/plc.h"
#include "base/recipe.h"
#include "base/records.h"
#include "base/result.h"

/// Work the station hands out, and what it recovers after a restart. The station names slabs and attempts itself
/// (keys count up and are never re-used), so no answer is needed to go on.
namespace slabd {

// ---- scanner ---------------------------------------------------------------------------------------------------

struct ScanShape {
  std::size_t points = 0;
  std::size_t finite = 0;
  std::size_t width = 0;  ///< 0 = unorganised
  std::size_t height = 0;
  /// The file holds its points as records of one length: they can be read again piece by piece, without memory for a
  /// scan. Says nothing of what was measured and is not stored.
  bool in_records = false;
  /// Of the missing points, those that the file holds as exactly (0, 0, 0). Not stored.
  std::size_t zeros = 0;
  bool emulated = false;  ///< the file or the sender declares that there was no real scanner. Not stored here.
  std::uint8_t emulated_block = 0;  ///< of which block it is drawn, as an emulated file declares; 0: not said
};

struct ScanRequest {
  std::uint16_t session = 0;
  std::uint16_t cmd_seq = 0;
  SlabId slab_id;
  std::uint8_t station = 0;
  std::int64_t timeout_ns = 15 * kNsPerS;
  std::size_t points_min = limits::kScanPointsMin;  ///< finite ones; fewer: too_few_points
  PathText spool_path;  ///< without extension; where the scan must lie, durable, when it is acquired
};

struct AcquiredScan {
  ScanShape shape;
  PathText path;                   ///< in the spool, with extension; synced, its folder too
  std::int64_t taken_mono_ns = 0;  ///< when the finished file was first seen: the exposure is over
  std::int64_t taken_utime_us = 0;
  double read_ms = 0.0;
};

// ---- storage ---------------------------------------------------------------------------------------------------

struct SlabHeader {
  std::int64_t key = 0;  ///< 1, 2, 3, ... over the life of the database
  SlabId slab_id;
  std::uint32_t slab_no = 0;
  std::uint16_t slab_type = 0;
  std::uint8_t stations = 0;
  std::uint16_t temperature_dk = 0;
  std::uint16_t age_h = 0;
  FixedString<32> recipe;
  FixedString<64> recipe_sha256;
  std::uint16_t unconfirmed = 0;  ///< nominals and tolerances nobody had confirmed when the slab was begun
  double guard = kNoValue;        ///< guard band of its verdicts in units of U; 0 = simple acceptance
  double cell_mm = kNoValue;      ///< flatness cell of the recipe
  CalibrationId calibration_id;   ///< hand-eye
  CalibrationId stations_id;      ///< the station corrections in force for this slab type; empty: none
  CalibrationId scanner_id;       ///< the scanner's acceptance in force, expired or not; empty: none
  FixedString<64> software;
  Pose T_base_slab;  ///< of the cell, as configured
  Pose T_flange_scanner;
  std::int64_t began_utime_us = 0;
  std::uint8_t emulated =
      0;  ///< emulation bits (base/records.h): of the line at its begin, and of each of its acquired attempts
};

/// Scans whose fingerprints are remembered: three whole slabs and some attempts. A scanner that hangs gives its last
/// scan again; one that hands out old files perhaps one of the last slabs'.
inline constexpr std::size_t kFingerprintsKept = 64;
/// Stands among them, in its place, for a scan that was asked for and whose points nobody saw because the process
/// ended: a scanner that hangs could give it as the scan of another block. The fingerprints of points are odd.
inline constexpr std::uint64_t kUnseenScan = 2;

/// One SCAN whose cloud and pose are durable.
struct Attempt {
  std::int64_t slab_key = 0;
  std::uint8_t station = 0;
  std::uint8_t number = 0;  ///< 1, 2, ... of this station; see `asked`
  std::uint16_t session = 0;
  std::uint16_t cmd_seq = 0;
  Pose T_base_flange;  ///< mean over the exposure
  double pose_spread_mm = kNoValue;
  std::uint32_t pose_samples = 0;
  Splice splice;  ///< how the scan comes into the base frame
  PathText scan_path;
  ScanShape shape;
  std::int64_t scan_utime_us = 0;
  double settle_ms = 0.0;   ///< SCAN accepted until the robot stood still
  double acquire_ms = 0.0;  ///< SCAN accepted until durable
  /// CRC-32C of the points (hal::points_crc32c); none: not taken.
  std::optional<std::uint32_t> points_crc32c{};
  /// The scanner was asked for this scan. False: the SCAN failed before that, the attempt does not count, and the next
  /// SCAN of the station uses its number and takes its row.
  bool asked = true;
  std::uint8_t emulated = 0;  ///< Emulation bits while it was taken
  /// 64 bits of the points (daemon::fingerprint_of), as a signed number. No other attempt of the whole history may have
  /// it. nullopt if no points came.
  std::optional<std::int64_t> fingerprint{};
};

struct SessionJob {
  std::uint16_t session = 0;
};
/// Refuses with store_full unless two slabs' scans fit on the spool disk.
struct BeginSlabJob {
  SlabHeader slab;
  std::uint16_t session = 0;
  std::uint16_t cmd_seq = 0;
};
struct CommandJob {
  std::uint16_t session = 0;
  std::uint16_t cmd_seq = 0;
  std::uint16_t command = 0;
  std::uint8_t station = 0;
  std::int64_t slab_key = 0;  ///< 0 = none
  std::int64_t utime_us = 0;
};
/// "acquired n": after this commit the robot may leave. frame_incomplete: an earlier attempt had the same points; then
/// this one is stored as a failed one with that code.
struct AcquiredJob {
  Attempt attempt;
  std::uint64_t fingerprint = 0;        ///< of the scan's points, to be remembered; 0: none
  std::int64_t measuring_since_ns = 0;  ///< as in MeasuringJob; 0: its measurement has ended
  bool refuse_known = true;             ///< false: an emulated line without noise repeats its scans
};
/// Marks an attempt: its measurement begins. A process that ends in order takes the mark away; one that crashes, or
/// that the watchdog ends, leaves it, and the next process does not measure this attempt by itself.
struct MeasuringJob {
  std::int64_t slab_key = 0;
  std::uint8_t station = 0;
  std::uint8_t attempt = 0;
  /// Monotonic time since the computer's start; 0: the mark is taken away. A mark from the future is from before a
  /// restart of the computer, which proves nothing against the scan.
  std::int64_t since_ns = 0;
};
/// A SCAN that came to nothing (no pose, no scan, unreadable ...): kept as an attempt with its code.
struct FailedAttemptJob {
  Attempt attempt;  ///< what is known of it
  std::uint16_t code = 0;
  std::uint64_t fingerprint = 0;  ///< as in AcquiredJob
};
/// A measured block and the record the PLC will be shown, one transaction. Closes the command.
struct BlockJob {
  std::int64_t slab_key = 0;
  std::uint8_t attempt = 0;
  BlockResult block;
  PlcResult record;
  BlockMaps maps{};    ///< empty when the block was not found
  NoisePrint noise{};  ///< of the exposure; empty when the seat was not measured
};
/// The slab's end: items, verdict, final station verdicts and the record, one transaction. Closes slab and command.
struct SlabJob {
  std::int64_t slab_key = 0;
  SlabResult slab;
  PlcResult record;
  std::int64_t ended_utime_us = 0;
};
/// The PLC has taken this record, and no other: one that was never shown stays to be shown.
struct AckJob {
  std::uint16_t res_seq = 0;
};
/// A record shown again on REPORT, under a new RES_SEQ. Closes the command.
struct ReportJob {
  PlcResult record;
};

/// Points that became no attempt, of a calibration's view or a scan that was given up: if the scanner gives them again,
/// they are no scan of any block.
struct SeenScanJob {
  std::uint64_t fingerprint = 0;
};

struct StoreJob {
  std::uint32_t ticket = 0;  ///< returned with the answer
  std::variant<SessionJob, BeginSlabJob, CommandJob, AcquiredJob, FailedAttemptJob, BlockJob, SlabJob, AckJob,
               ReportJob, SeenScanJob, MeasuringJob>
      what;
};

// ---- recovery --------------------------------------------------------------------------------------------------

enum class StationPhase : std::uint8_t {
  empty = 0,      ///< not scanned yet
  acquiring = 1,  ///< accepted, cloud not durable yet
  acquired = 2,   ///< cloud and pose durable, not measured yet
  measured = 3,   ///< result durable
  failed = 4,     ///< the last SCAN came to nothing
};

/// One station of the open slab.
struct StationRecord {
  StationPhase phase = StationPhase::empty;
  std::uint8_t attempts = 0;
  std::uint16_t code = 0;               ///< why the last SCAN came to nothing
  Attempt attempt;                      ///< the latest acquired one
  BlockResult block;                    ///< valid when measured
  std::int64_t measuring_since_ns = 0;  ///< recovered: the mark that was left (MeasuringJob); 0: none
};

/// Where a scan showed its block, and from where.
struct SeenBlock {
  bool seen = false;
  Pose T_base_scanner;
  Pose T_scanner_block;
};

/// What a restarted daemon must know. A command that was accepted and not finished has been marked interrupted.
struct RecoveredLine {
  std::uint16_t session = 0;  ///< last one used; 0 = fresh database
  std::uint16_t cmd_ack = 0;
  std::uint16_t cmd_status = 0;
  std::uint16_t acq_seq = 0;
  std::uint16_t res_seq = 0;  ///< last one used
  std::int64_t last_slab_key = 0;
  std::int64_t newest_utime_us = 0;

  LineCalibration calibration;       ///< in force; source `missing` without trouble: nothing was ever applied
  LineCalibration slab_calibration;  ///< what the open slab was begun with; the same rule

  bool slab_open = false;
  /// CMD_SEQ of a SLAB_ABORT that was accepted for the open slab and not finished: it is the slab's newest command, and
  /// it is carried out after the restart. 0: none.
  std::uint16_t abort_seq = 0;
  SlabHeader slab;  ///< the open slab, else the last ended one (key 0 = none ever)
  std::array<StationRecord, limits::kStationsMax> stations{};  ///< of `slab`
  SlabHeader last_slab;                                        ///< the last ended one (key 0 = none ever)
  SlabResult last_result;                                      ///< its end
  std::array<SeenBlock, limits::kStationsMax> last_blocks{};   ///< its blocks, [station - 1]
  /// The last ended slab as the PLC was shown it (station table, verdict, reason).
  std::array<PlcStationRow, limits::kStationsMax> table{};
  Verdict slab_verdict = Verdict::none;
  std::uint16_t slab_reason = 0;
  std::uint32_t table_slab_no = 0;
  std::uint8_t slab_emulated = 0;  ///< Emulation bits of the last ended slab
  PlcResult slab_record;           ///< of the last ended slab, for REPORT

  /// Of the points of the last scans, oldest first; 0 behind the newest.
  std::array<std::uint64_t, kFingerprintsKept> fingerprints{};

  /// Of the last exposures that were measured, oldest first, at most limits::kNoisePrintsKept.
  std::vector<KeptNoise> noise;

  FixedQueue<PlcResult, limits::kResultQueueMax> unacknowledged;  ///< oldest first
};

/// Where the scanner stood when a stored scan was taken: the pose as stored, the hand-eye of its slab, and the
/// station's correction where it held. Equal records give equal bits, today and in ten years.
[[nodiscard]] inline Pose stored_T_base_scanner(const SlabHeader& slab, const Attempt& attempt) {
  const Pose T_base_scanner = attempt.T_base_flange * slab.T_flange_scanner;
  return attempt.splice.source == SpliceSource::corrected ? attempt.splice.T_base_reported * T_base_scanner
                                                          : T_base_scanner;
}

}  // namespace slabd
