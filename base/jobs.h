// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <variant>
#include <vector>

#include "base/arm.h"
#include "base/calibration.h"
#include "base/design.h"
#include "base/noise_print.h"
#include "base/packed_map.h"
#include "base/plc.h"
#include "base/recipe.h"
#include "base/records.h"
#include "base/result.h"
#include "base/thermal.h"

/// Jobs issued by the station, and the state it recovers after a restart. The station assigns slab keys and attempt
/// numbers itself (keys count up and are never re-used), so it can continue without an answer.
namespace slabd {

// ---- scanner ---------------------------------------------------------------------------------------------------

struct ScanShape {
  std::size_t points = 0;
  std::size_t finite = 0;
  std::size_t width = 0;  ///< 0 if unorganised
  std::size_t height = 0;
  /// True if the file stores its points as fixed-length records, so that they can be read again in pieces, without
  /// memory for a whole scan. Independent of the measured content, and not stored.
  bool in_records = false;
  /// Number of missing points stored as exactly (0, 0, 0). Not kept in the database.
  std::size_t zeros = 0;
  bool emulated = false;                    ///< the file or the sender declares an emulated scanner. Not stored here.
  std::uint8_t emulated_block = 0;          ///< block that an emulated file declares as its source; 0 if not declared
  double scanner_temperature_c = kNoValue;  ///< of the scanner during the exposure, as it declares; NaN if it does not
};
/// Allowed temperatures of a scanner. No industrial sensor works outside; another value is in another unit, or damaged.
inline constexpr double kScannerTemperatureMin_c = -40.0;
inline constexpr double kScannerTemperatureMax_c = 125.0;

struct ScanRequest {
  std::uint16_t session = 0;
  std::uint16_t cmd_seq = 0;
  SlabId slab_id;
  std::uint8_t station = 0;
  /// Arm that scans; without names on a line with one arm, whose scanner does not see a name.
  Arm by{PartId{}, PartId{}};
  std::int64_t timeout_ns = 15 * kNsPerS;
  std::size_t points_min = limits::kScanPointsMin;  ///< minimum of finite points; fewer: too_few_points
  PathText spool_path;  ///< without extension; a durable scan must be here when it is acquired
};

struct AcquiredScan {
  ScanShape shape;
  PathText path;                   ///< in the spool, with extension; file and folder are synced
  std::int64_t taken_mono_ns = 0;  ///< when the finished file was first seen; the exposure has ended by then
  std::int64_t taken_utime_us = 0;
  double read_ms = 0.0;
};

// ---- storage ---------------------------------------------------------------------------------------------------

/// An arm after the first, as it was when a slab was begun.
struct SlabArm {
  Arm by;
  CalibrationId calibration_id;  ///< hand-eye calibration; empty if there was none
  CalibrationId stations_id;     ///< station corrections in force for the slab's type; empty if none
  CalibrationId scanner_id;      ///< the scanner's acceptance in force, expired or not; empty if none
  Pose T_flange_scanner;
};

struct SlabHeader {
  std::int64_t key = 0;  ///< 1, 2, 3, ... over the life of the database
  SlabId slab_id;
  std::uint32_t slab_no = 0;
  std::uint16_t slab_type = 0;
  std::uint8_t stations = 0;
  std::uint16_t temperature_dk = 0;
  std::uint16_t age_h = 0;
  std::uint16_t mould = 0;  ///< number of the mould that cast it; 0 if unknown
  FixedString<32> recipe;
  FixedString<64> recipe_sha256;
  FixedString<64> design_sha256;  ///< of design_text; empty: as the recipe says
  DesignText design_text;         ///< the design in force at SLAB_BEGIN
  std::uint16_t unconfirmed = 0;  ///< number of unconfirmed nominals and tolerances when the slab was begun
  double guard = kNoValue;        ///< guard band of its verdicts in units of U; 0: simple acceptance
  double cell_mm = kNoValue;      ///< flatness cell of the recipe
  CalibrationId calibration_id;   ///< hand-eye calibration; this and the next two are those of arm 0
  CalibrationId stations_id;      ///< station corrections in force for this slab type; empty if none
  CalibrationId scanner_id;       ///< the scanner's acceptance in force, expired or not; empty if none
  FixedString<64> software;
  Pose T_base_slab;  ///< pose of the slab in the cell, from the configuration
  Pose T_flange_scanner;
  std::int64_t began_utime_us = 0;
  std::uint8_t emulated =
      0;  ///< emulation bits (base/records.h) of the line at the slab's begin and of all its acquired attempts
  FixedVector<SlabArm, limits::kArmsMax - 1> more_arms;  ///< arms after the first: [arm - 1]
  CalibrationId tie_id;                                  ///< tie of the robots' bases in force; empty if none
};

/// Temperature and design of the slab. A design_text that cannot be read gives a design without numbers, with which
/// nothing is measured.
[[nodiscard]] SlabFacts facts_of(const SlabHeader& slab);
/// The same with the gauges of an ended slab, to judge it again.
[[nodiscard]] SlabFacts facts_of(const SlabHeader& slab, const SlabResult& ended);

/// Number of scans whose fingerprints are remembered: three whole slabs and some retries. A scanner that hangs repeats
/// its last scan; one that delivers old files could repeat a scan of one of the last slabs.
inline constexpr std::size_t kFingerprintsKept = 64;
/// Placeholder fingerprint of a scan that was requested but not read because the process ended. A scanner that hangs
/// could deliver that scan as the scan of another block. Fingerprints of points are odd, so this value cannot collide.
inline constexpr std::uint64_t kUnseenScan = 2;

/// One SCAN with durable point cloud and pose.
struct Attempt {
  std::int64_t slab_key = 0;
  std::uint8_t station = 0;
  std::uint8_t number = 0;  ///< 1, 2, ... of this station; see `asked`
  std::uint8_t arm = 0;     ///< arm that scanned: 0, or an index into SlabHeader::more_arms plus 1
  Arm by;                   ///< its names
  std::uint16_t session = 0;
  std::uint16_t cmd_seq = 0;
  Pose T_base_flange;  ///< mean over the exposure, in the base of the arm's own robot
  double pose_spread_mm = kNoValue;
  std::uint32_t pose_samples = 0;
  Splice splice;  ///< transformation of the scan into the base frame
  /// Half width of the relative error of a length by the scanner's temperature (base/calibration.h, scanner_drift);
  /// NaN: a temperature is not known. Stored, so that a replay does not depend on the configuration.
  double scanner_drift = kNoValue;
  PathText scan_path;
  ScanShape shape;
  std::int64_t scan_utime_us = 0;
  double settle_ms = 0.0;   ///< time from SCAN accepted until the robot stood still
  double acquire_ms = 0.0;  ///< time from SCAN accepted until durable
  /// CRC-32C of the points (hal::points_crc32c); nullopt if it was not computed.
  std::optional<std::uint32_t> points_crc32c{};
  /// True if the scan was requested from the scanner. If false, the SCAN failed before that, the attempt does not
  /// count, and the station's next SCAN reuses its number and row.
  bool asked = true;
  std::uint8_t emulated = 0;  ///< emulation bits during the attempt
  /// 64-bit fingerprint of the points (daemon::fingerprint_of), as a signed number. It must be unique in the whole
  /// history. nullopt if no points arrived.
  std::optional<std::int64_t> fingerprint{};
};

struct SessionJob {
  std::uint16_t session = 0;
};
/// Begins a slab. Rejected with store_full unless the spool disk has space for two slabs' scans.
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
  std::int64_t slab_key = 0;  ///< 0 if none
  std::int64_t utime_us = 0;
};
/// "acquired n": after this commit the robot may leave. If an earlier attempt had the same points, the answer is
/// frame_incomplete and this attempt is stored as failed with that code.
struct AcquiredJob {
  Attempt attempt;
  std::uint64_t fingerprint = 0;        ///< fingerprint of the scan's points, to be remembered; 0 if none
  std::int64_t measuring_since_ns = 0;  ///< as in MeasuringJob; 0 if its measurement has ended
  bool refuse_known = true;             ///< false: an emulated line without noise repeats its scans
  bool keeps_unseen = false;            ///< another scanner's kUnseenScan stays the newest entry
};
/// Marks an attempt whose measurement begins. A process that ends in order removes the mark. After a crash or a
/// watchdog stop the mark remains, and the next process does not measure this attempt automatically.
struct MeasuringJob {
  std::int64_t slab_key = 0;
  std::uint8_t station = 0;
  std::uint8_t attempt = 0;
  /// Monotonic time since boot; 0 removes the mark. A mark in the future is from before a reboot, and proves nothing
  /// against the scan.
  std::int64_t since_ns = 0;
};
/// A SCAN that failed (no pose, no scan, unreadable ...), kept as an attempt with its code.
struct FailedAttemptJob {
  Attempt attempt;  ///< the known part of it
  std::uint16_t code = 0;
  std::uint64_t fingerprint = 0;  ///< as in AcquiredJob
  bool keeps_unseen = false;      ///< as in AcquiredJob
};
/// A measured block and its record for the PLC, in one transaction. Closes the command.
struct BlockJob {
  std::int64_t slab_key = 0;
  std::uint8_t attempt = 0;
  BlockResult block;
  PlcResult record;
  BlockMaps maps{};    ///< empty if the block was not found
  NoisePrint noise{};  ///< noise print of the exposure; empty if the seat was not measured
};
/// End of the slab: items, verdict, final station verdicts and the record, in one transaction. Closes slab and command.
struct SlabJob {
  std::int64_t slab_key = 0;
  SlabResult slab;
  PlcResult record;
  std::int64_t ended_utime_us = 0;
};
/// The PLC has acknowledged this record only. A record that was not yet shown remains to be shown.
struct AckJob {
  std::uint16_t res_seq = 0;
};
/// A record shown again on REPORT, with a new RES_SEQ. Closes the command.
struct ReportJob {
  PlcResult record;
};

/// Points that belong to no attempt: from a calibration view or an abandoned scan. If the scanner delivers them again,
/// they are not accepted as the scan of a block.
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
  acquiring = 1,  ///< accepted; point cloud not durable yet
  acquired = 2,   ///< point cloud and pose durable; not measured yet
  measured = 3,   ///< result durable
  failed = 4,     ///< the last SCAN failed
};

/// Basis of every measurement of a slab, the same from its begin to its end.
struct SlabBasis {
  const Recipe* recipe = nullptr;  ///< nullptr if the slab's type is not known
  Pose T_base_slab;
  std::array<ScannerNumbers, limits::kArmsMax> verified;  ///< each arm's acceptance when the slab was begun
  SlabFacts slab;
  bool has_tie = false;  ///< true if `tie` contains the numbers of the tie when the slab was begun
  TieNumbers tie;
};

/// State of one station of the open slab.
struct StationRecord {
  StationPhase phase = StationPhase::empty;
  std::uint8_t attempts = 0;
  std::uint16_t code = 0;               ///< why the last SCAN failed
  Attempt attempt;                      ///< the latest acquired attempt
  BlockResult block;                    ///< valid if measured
  std::int64_t measuring_since_ns = 0;  ///< recovered: the mark that was left (MeasuringJob); 0 if none
};

/// Pose of a block in a scan, and the pose of the scanner.
struct SeenBlock {
  bool seen = false;
  Pose T_base_scanner;
  Pose T_scanner_block;
};

/// State that a restarted daemon requires. An accepted command that was not finished is already marked as interrupted.
struct RecoveredLine {
  std::uint16_t session = 0;  ///< last one used; 0: new database
  std::uint16_t cmd_ack = 0;
  std::uint16_t cmd_status = 0;
  std::uint16_t acq_seq = 0;
  std::uint16_t res_seq = 0;  ///< last one used
  std::int64_t last_slab_key = 0;
  std::int64_t newest_utime_us = 0;

  CellCalibration calibration;       ///< in force; source `missing` without trouble: none was ever applied
  CellCalibration slab_calibration;  ///< at the begin of the open slab; the same rule

  bool slab_open = false;
  /// CMD_SEQ of a SLAB_ABORT that was accepted for the open slab and not finished; 0 if none. It is the slab's newest
  /// command and is carried out after the restart.
  std::uint16_t abort_seq = 0;
  bool end_was_given = false;  ///< a SLAB_END of the open slab was accepted before the restart
  SlabHeader slab;             ///< the open slab, else the last ended one (key 0: there is none)
  std::array<StationRecord, limits::kStationsMax> stations{};  ///< stations of `slab`
  SlabHeader last_slab;                                        ///< the last ended slab (key 0: there is none)
  SlabResult last_result;                                      ///< result of the last ended slab
  std::array<SeenBlock, limits::kStationsMax> last_blocks{};   ///< blocks of the last ended slab, [station - 1]
  /// The last ended slab as shown to the PLC (station table, verdict, reason).
  std::array<PlcStationRow, limits::kStationsMax> table{};
  Verdict slab_verdict = Verdict::none;
  std::uint16_t slab_reason = 0;
  std::uint32_t table_slab_no = 0;
  Disposition disposition = Disposition::none;  ///< of the last ended slab
  std::uint8_t slab_emulated = 0;               ///< emulation bits of the last ended slab
  PlcResult slab_record;                        ///< record of the last ended slab, for REPORT

  /// Fingerprints of the last scans, oldest first; unused entries after the newest are 0.
  std::array<std::uint64_t, kFingerprintsKept> fingerprints{};

  std::vector<GaugeCheck> gauge_checks;  ///< the newest of each gauge
  GaugeRuns gauge_runs;
  GaugeReadings gauges_used;  ///< of the newest slab that has gauge values

  /// Noise prints of the last measured exposures, oldest first, at most limits::kNoisePrintsKept.
  std::vector<KeptNoise> noise;

  FixedQueue<PlcResult, limits::kResultQueueMax> unacknowledged;  ///< oldest first
};

/// Pose of the scanner on the flange of one arm of a slab. An arm that the slab does not have gives a pose without
/// numbers, with which nothing is measured.
[[nodiscard]] Pose T_flange_scanner_of(const SlabHeader& slab, std::size_t arm);

/// Pose of the scanner when a stored scan was taken, in the line's base frame. It is computed from the stored flange
/// pose, the hand-eye of its arm, the station's correction if it was applied, and the robot's base. Equal records give
/// equal bits, in later versions too.
[[nodiscard]] Pose stored_T_base_scanner(const SlabHeader& slab, const Attempt& attempt);

}  // namespace slabd
