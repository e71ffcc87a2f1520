// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "base/base.h"
#include "base/jobs.h"
#include "base/record_fields.h"

/// SQLite storage of commands, scans, measurements and verdicts. The daemon has the only writer; slabctl reads.
namespace slabd::storage {

inline constexpr int kApplicationId = 0x534C4244;  // "SLBD"
inline constexpr int kSchemaVersion = 1;

/// Largest recipe file. The longest recipe of the line has 8 kB, including comments. All recipe files stay in memory.
inline constexpr std::size_t kRecipeTextBytes = 65'536;
/// A recipe's file, identified by a slab's recipe_sha256.
struct RecipeText {
  FixedString<64> sha256;  ///< SHA-256 of `text`, hex
  FixedString<32> name;
  std::string text;  ///< byte for byte; at most kRecipeTextBytes
  std::int64_t kept_utime_us = 0;
};

struct StoreSettings {
  std::string db_path;
  std::string spool_dir;
  /// Minimum free space on the spool disk for SLAB_BEGIN: two slabs of 18 x 60 MB.
  std::uint64_t spool_free_bytes_min = 2'300'000'000;
  /// Budget of the spool in bytes of scans. Beyond it the scans (never the records) of the oldest acknowledged slabs
  /// are deleted, passed ones first. 0: keep all scans.
  std::uint64_t spool_budget_bytes = 0;
  /// Number of slabs whose records are kept; a count, because an age would depend on the wall clock. Older ones are
  /// deleted after their scans are deleted and the PLC has all results. 0: keep all; else at least kKeepSlabsMin.
  std::int64_t keep_slabs = 0;
  /// Number of newest slabs that did not pass (failed, indeterminate, not measured, aborted) and are kept in any case,
  /// including those among the newest keep_slabs. 0: all of them. No effect without keep_slabs. At least kKeepSlabsMin.
  std::int64_t keep_failed_slabs = 0;
  /// Files of the recipes with which slabs may begin. A slab's recipe is stored in the slab's transaction, with its
  /// time; here the time is not set.
  bool second_person = false;  ///< [quality] second_person: a disposition needs two persons
  /// [plant]: retention keeps a slab until the plant's database has all documents about it.
  bool keep_unsent = false;
  std::vector<RecipeText> recipe_texts{};
  LineArms arms{};  ///< robots and scanners of the line: their calibrations are those in force
};
/// Minimum number of slabs kept: the PLC's table, repeats and counters are taken from the newest ones.
inline constexpr std::int64_t kKeepSlabsMin = 100;

// ---- calibrations ------------------------------------------------------------------------------------------------

/// One calibration with all its input data. Records are only added.
struct CalibrationRecord {
  std::string id;  ///< computed by storage from kind, numbers and parent (`calibration_id`)
  /// Alternatives in the order of CalibrationKind.
  std::variant<HandEyeNumbers, StationTable, ReferenceBlock, MonitorBall, ScannerNumbers, TieNumbers> numbers;
  /// stations: the hand-eye calibration they were solved with; tie: both (tie_parent()); empty if none
  std::string parent_id;
  std::string figures;       ///< quality figures as a JSON object, as printed by the solver
  std::string observations;  ///< the captured views in the neutral text form, sufficient to solve again
  std::string certificate;   ///< text of the artefact's certificate
  std::string operator_name;
  std::string robot_serial;
  std::string scanner_serial;
  std::string scanner = "1";  ///< id of the scanner it is of; a tie is stored with "1"
  double temperature_c = kNoValue;
  std::string software;
  std::int64_t created_utime_us = 0;
  std::int64_t expires_utime_us = 0;  ///< 0: never

  [[nodiscard]] CalibrationKind kind() const { return static_cast<CalibrationKind>(numbers.index()); }
  /// Slab type of a station table; 0 for the other kinds, which are valid for every slab.
  [[nodiscard]] std::uint16_t slab_type() const;
};
/// Computes an id such as "he-3f2a91c07b5e": equal ids mean equal kind, numbers and parent.
[[nodiscard]] std::string calibration_id(const CalibrationRecord& record);

/// Author and reason of a change, as entered by a person; kept permanently.
struct ChangeNote {
  std::string who;
  std::string why;
  std::int64_t utime_us = 0;
};

/// Adds a record. A record equal to an existing one (numbers, certificate, expiry within a day) counts as added.
struct KeepCalibration {
  CalibrationRecord record;
};
/// Applies a record, replacing the one of its kind (and slab type) and scanner.
struct ApplyCalibration {
  std::string id;
  ChangeNote note;
  std::string scanner{};  ///< rejected if the record is of another scanner; empty: of any
};
/// Restores the previously applied record; repeated calls go back further. Rejected without an earlier one.
struct RollBackCalibration {
  CalibrationKind kind = CalibrationKind::hand_eye;
  std::uint16_t slab_type = 0;  ///< slab type of station tables; 0: that of the newest change of this kind
  ChangeNote note;
  std::string scanner = "1";
};
/// Adds a check to the trend.
struct KeepCheck {
  CalibrationCheck check;
};
/// A decision of quality about a slab that did not pass. The measured verdict never changes.
struct DispositionRecord {
  std::int64_t slab_key = 0;
  std::int64_t n = 0;  ///< 1, 2, ... of the slab; the last one is in force
  std::int64_t utime_us = 0;
  std::string who;  ///< entered it
  Disposition decision = Disposition::none;
  std::string reason;
  std::string authority;  ///< decided it
  std::string second;     ///< the second person; empty: none
};
/// Adds a decision. Rejected if the slab is open or passed, or without a reason and an authority.
struct KeepDisposition {
  DispositionRecord record;
  bool needs_second = false;  ///< set by the store: StoreSettings::second_person
};
/// Begins a new epoch of a mould: slabs cast from `from_utime_us` on have statistics of their own. Rejected if no
/// stored slab is from this mould, or if the time is before that of its last reset. A repeated one counts as added.
struct ResetMould {
  std::uint16_t mould = 0;
  std::int64_t from_utime_us = 0;
  ChangeNote note;
};
/// Adds a master check of a gauge. It passes if the deviation is within its limit, whatever `check.passed` is.
struct KeepGaugeCheck {
  GaugeCheck check;  ///< its time is that of the note
  ChangeNote note;   ///< `why` may be empty
};
/// Writes the pin of a slab's scans, the file pin.json next to them, for a person who may not write there.
struct KeepPin {
  std::int64_t slab_key = 0;
  std::string text;  ///< of the file; empty: the pin is removed
};
/// A change that a person makes while the daemon may run: of calibrations, of decisions about slabs, of moulds, of
/// gauges, of pins.
using CalibrationChange = std::variant<KeepCalibration, ApplyCalibration, RollBackCalibration, KeepCheck,
                                       KeepDisposition, ResetMould, KeepGaugeCheck, KeepPin>;

/// One entry of the history of applied calibrations. Entries are only added.
struct AppliedChange {
  std::int64_t seq = 0;
  CalibrationKind kind = CalibrationKind::hand_eye;
  std::uint16_t slab_type = 0;
  std::string scanner = "1";
  bool is_rollback = false;
  std::string calibration_id;  ///< in force from this entry on
  std::string replaced_id;     ///< in force until this entry; empty if none
  ChangeNote note;
};

// ---- maintenance of the database -----------------------------------------------------------------------------------

/// Copies the whole database to `path`, which must not exist.
struct BackupOrder {
  std::string path;
};
/// Deletes the records of slabs older than the newest `keep_slabs`, by the rules of StoreSettings::keep_slabs.
struct PruneOrder {
  std::int64_t keep_slabs = 0;
  std::optional<std::int64_t>
      keep_failed_slabs{};  ///< nullopt: the value of StoreSettings, or keep_slabs if it keeps all
};
/// The plant's database has all outbox rows of this epoch up to `seq` (storage/outbox.h).
struct SentOrder {
  std::string epoch;
  std::int64_t seq = 0;
};
using CareOrder = std::variant<BackupOrder, PruneOrder, SentOrder>;

/// How far the plant's database is behind.
struct Backlog {
  std::string epoch;                 ///< of new rows; empty: not read yet
  std::int64_t newest_seq = 0;       ///< of the outbox
  std::int64_t sent_seq = 0;         ///< acknowledged up to here
  std::int64_t oldest_utime_us = 0;  ///< of the oldest row after it; 0: there is none
};

/// A start of slabd, or a fault that began or ended, for the outbox.
struct LineEvent {
  enum class Kind : std::uint8_t { started, fault, cleared };
  Kind kind = Kind::started;
  std::uint16_t code = 0;
  std::string text;
  std::int64_t utime_us = 0;
};

/// State of the last orders.
struct CareState {
  enum class Phase : std::uint8_t { none, under_way, done, failed };
  Phase backup = Phase::none;
  std::string backup_path;
  std::int64_t backup_pages = 0;  ///< of backup_pages_all: pages copied, then again pages read
  std::int64_t backup_pages_all = 0;
  std::string backup_error;
  Phase prune = Phase::none;
  std::int64_t pruned_slabs = 0;
  std::string prune_error;
  Backlog backlog;
};

/// The writer. One object, one thread. Every apply() is one transaction, durable on return (synchronous=EXTRA, then
/// WAL). After a write error the file is closed and the next call reopens it first, with quick_check if the error
/// looked like damage. A job that is repeated after an error replaces the rows left by the first one.
class Store {
 public:
  virtual ~Store() = default;
  /// Reads the state required by a restarted daemon and marks interrupted commands (one transaction). Then it deletes
  /// scans of the newest slab that were spooled but never recorded. Call it once, before the first scan. If there are
  /// more unacknowledged results than RecoveredLine holds, the newest of them stay unacknowledged until the next
  /// restart.
  [[nodiscard]] virtual Result<std::unique_ptr<RecoveredLine>> recover() = 0;
  /// Executes a job. Errors: store_full (disk, or less than spool_free_bytes_min at a slab's begin); frame_incomplete
  /// (AcquiredJob, stored as a failed attempt); journal_write (anything else).
  [[nodiscard]] virtual Status apply(const StoreJob& job) = 0;
  /// Carries out one change of calibrations in one transaction; returns the id of the affected record. config: the
  /// change is impossible (unknown id, nothing to roll back to, invalid numbers), nothing was changed, and the text
  /// contains the remedy. store_full, journal_write as apply().
  [[nodiscard]] virtual Result<std::string> change(const CalibrationChange& change) = 0;
  /// Returns the calibrations in force.
  [[nodiscard]] virtual Result<std::unique_ptr<CellCalibration>> calibration() = 0;
  /// Called by the writer's thread about ten times per second while no job waits. After several calls in a row it
  /// moves the write-ahead log into the database, so that no commit has to.
  virtual void idle() {}
  /// Reason why old scans could not be deleted to keep the spool budget; empty if there is none. It never fails a job.
  [[nodiscard]] virtual std::string_view spool_trouble() const { return {}; }
  /// Keeps events of the line, in one transaction. Errors as apply(); nothing was kept then.
  [[nodiscard]] virtual Status keep_events(const std::vector<LineEvent>& /*events*/) { return success(); }
  /// Sets the recipes for new slabs (StoreSettings::recipe_texts). Callable from any thread.
  virtual void use_recipes(const std::vector<RecipeText>& /*texts*/) {}
  /// Reason why the next job would be rejected, as detected by idle(): the database was deleted or replaced while it is
  /// open. Empty if there is none. The open file can still be backed up.
  [[nodiscard]] virtual std::string_view trouble() const { return {}; }
  /// Accepts an order, which idle() carries out in pieces, so that jobs do not wait long. Callable from any thread.
  /// busy: an order of the same kind is in progress. config: the order is invalid (the text contains the reason).
  /// A SentOrder is never busy: the highest number counts.
  [[nodiscard]] virtual Status order(const CareOrder& order) = 0;
  /// State of the orders. Callable from any thread.
  [[nodiscard]] virtual CareState care() const = 0;
};

/// Opens or creates the database and its folders (mode 2750). A database of an older schema version is copied to
/// `<db>.v<version>-backup` and then upgraded in one transaction. journal_write if it cannot be opened, is open for
/// writing elsewhere, or is damaged. Also if it belongs to another application or to a test version before 1.0
/// (application_id), or is newer than this program (user_version). The text contains the file and the figures. A
/// damaged database is moved with its log to `<db>.quarantine-<time>`, and a note replaces it, so that no start begins
/// a new history by accident. For the same reason, no database is created if scans, backups or a log prove an earlier
/// one.
[[nodiscard]] Result<std::unique_ptr<Store>> open_store(const StoreSettings& settings);

// ---- reading (slabctl; short read-only transactions, never checkpoints) -------------------------------------------

struct SlabSummary {
  SlabHeader header;                ///< without `more_arms` in a list of slabs
  std::int64_t ended_utime_us = 0;  ///< 0: still open
  Verdict verdict = Verdict::none;
  std::uint16_t reason = 0;
  int stations_measured = 0;                    ///< stations whose valid attempt has a result other than `not_measured`
  Disposition disposition = Disposition::none;  ///< in force
  bool acknowledged = false;
};

/// Filter for slabs; all conditions that are set must be met.
struct SlabFilter {
  std::size_t limit = 20;
  std::optional<std::int64_t> since_utime_us = std::nullopt;  ///< began at or after
  std::optional<std::int64_t> until_utime_us = std::nullopt;  ///< began before
  int slab_type = 0;                                          ///< 0: all types
  int mould = 0;                                              ///< 0: all moulds, and slabs of an unknown one
  std::string id_part;                                        ///< part of the SLAB_ID; empty: all
  /// Verdict of the slab if neither item nor block is set. With a block, the verdict of that station after SLAB_END;
  /// with an item, of the item (at that block, if set). none: any verdict except pass.
  Verdict verdict = Verdict::none;
  int block = 0;  ///< 0: any
  std::optional<ItemId> item;
  Disposition disposition = Disposition::none;  ///< in force; none: any or none
};

/// Ended slab, for counts over many.
struct Inspection {
  std::int64_t slab_key = 0;
  std::int64_t began_utime_us = 0;
  std::uint16_t slab_type = 0;
  std::uint16_t mould = 0;
  Verdict verdict = Verdict::none;
  std::uint16_t reason = 0;
  std::uint8_t emulated = 0;
  bool again = false;  ///< an earlier slab with this SLAB_ID has ended and was not aborted; false without a SLAB_ID
};
struct InspectionFilter {
  std::optional<std::int64_t> since_utime_us = std::nullopt;  ///< began at or after
  std::optional<std::int64_t> until_utime_us = std::nullopt;  ///< began before
  int slab_type = 0;                                          ///< 0: all types
  bool of_both_kinds = false;                                 ///< emulated and real slabs
};
/// Emulated and real slabs are not counted together unless of_both_kinds; the newest slab of the database selects.
struct Inspections {
  std::vector<Inspection> list;  ///< oldest first
  std::uint8_t emulated = 0;     ///< emulation bits of the newest slab
  std::size_t others = 0;  ///< slabs that match the filter and are left out, because the newest is of the other kind
};

/// Filter for values of one item. Open and aborted slabs have no values, because their measurements are not final.
struct ItemFilter {
  ItemId item = ItemId::seat_slope;
  std::size_t slabs = 1'000;  ///< number of newest slabs
  std::optional<std::int64_t> since_utime_us = std::nullopt;
  std::optional<std::int64_t> until_utime_us = std::nullopt;
  int slab_type = 0;
  int mould = 0;  ///< 0: all moulds, and slabs of an unknown one
  int block = 0;  ///< 0: all; for a spacing or a pair: its first station
};
/// One value of an item, from the valid attempt, or from the slab if SLAB_END recomputed it. A block's item is
/// not_measured, without limits, if its station was never scanned or no scan of it had a result.
struct ItemValue {
  std::int64_t slab_key = 0;
  std::uint16_t slab_type = 0;
  SlabId slab_id;
  std::int64_t began_utime_us = 0;
  Item item;                  ///< budget and companion are not set
  std::uint8_t emulated = 0;  ///< emulation bits of its slab
};

/// Filter for the values of the moulds. Open and aborted slabs, and slabs of an unknown mould, have none.
struct MouldFilter {
  std::size_t castings = 100;                                 ///< number of newest slabs of each mould
  std::optional<std::int64_t> since_utime_us = std::nullopt;  ///< began at or after
  std::optional<std::int64_t> until_utime_us = std::nullopt;  ///< began before
  int slab_type = 0;                                          ///< 0: all types
};
struct MouldSlab {
  std::int64_t key = 0;
  std::int64_t cast_utime_us = 0;  ///< begin of the inspection minus AGE; without AGE the begin
  std::uint16_t mould = 0;
  std::uint16_t slab_type = 0;
  std::uint8_t emulated = 0;
};
/// A measured value of an item, as in ItemValue. The nominal is subtracted, if the item has one.
struct MouldValue {
  std::uint32_t slab = 0;  ///< index in MouldRecords::slabs
  ItemId item = ItemId::seat_slope;
  std::uint8_t station = 0;
  std::uint8_t station_to = 0;
  float deviation = 0.0F;
  float lower = 0.0F;  ///< limits, as deviations; NaN: none, or not given, as only the newest slab of a type has them
  float upper = 0.0F;
};
struct MouldReset {
  std::uint16_t mould = 0;
  std::int64_t from_utime_us = 0;
  ChangeNote note;
};
struct MouldRecords {
  std::vector<MouldSlab> slabs;    ///< oldest first
  std::vector<MouldValue> values;  ///< by slab
  std::vector<MouldReset> resets;  ///< of all moulds, by mould and time
  std::int64_t unknown = 0;        ///< stored slabs of an unknown mould
};

/// One stored master check of a gauge.
struct GaugeCheckRecord {
  std::int64_t seq = 0;
  GaugeCheck check;
  ChangeNote note;
};
/// Value of one gauge of an ended slab.
struct GaugeSlabValue {
  std::int64_t slab_key = 0;
  SlabId slab_id;
  std::int64_t began_utime_us = 0;
  std::uint8_t emulated = 0;
  GaugeReading reading;
};

struct SlabBlock {
  Attempt attempt;
  StationPhase phase = StationPhase::empty;
  std::uint16_t code = 0;
  BlockResult block;
  /// Verdict after SLAB_END, including slab items; never a pass if the slab was aborted.
  Verdict final_verdict = Verdict::none;
  std::uint16_t final_reason = 0;
};

struct SlabRecord {
  SlabSummary summary;
  SlabResult slab;                              ///< items are empty until SLAB_END
  std::vector<DispositionRecord> dispositions;  ///< oldest first
  std::vector<SlabBlock> blocks;  ///< all attempts, by station and number; a station's latest one is valid
};

/// A known gap in the history.
struct HistoryGap {
  enum class What : std::uint8_t {
    restored,    ///< from a backup: slabs measured after the backup are missing
    begun_anew,  ///< all earlier data is missing
    pruned,      ///< slabs up to `slab_key` were deleted by retention
  };
  What what = What::restored;
  std::int64_t slab_key = 0;  ///< keys up to this one may have been used before
  std::int64_t kept_key = 0;  ///< restored: the newest existing slab up to slab_key; 0 if there is none, or if unknown
  std::int64_t slabs = 0;     ///< pruned: number of deleted slabs
  ChangeNote note;            ///< entered by a person; empty for retention
  std::string source;         ///< restored: path of the backup
};

class Reader {
 public:
  virtual ~Reader() = default;
  /// Slabs that match the filter, newest first.
  [[nodiscard]] virtual Result<std::vector<SlabSummary>> slabs(const SlabFilter& filter) = 0;
  [[nodiscard]] Result<std::vector<SlabSummary>> slabs(std::size_t limit) {
    SlabFilter filter;
    filter.limit = limit;
    return slabs(filter);
  }
  [[nodiscard]] virtual Result<Inspections> inspections(const InspectionFilter& filter) = 0;
  /// Values that match the filter, oldest slab first, then by station.
  [[nodiscard]] virtual Result<std::vector<ItemValue>> values(const ItemFilter& filter) = 0;
  /// The values of several items, in their order, for little more than those of one. `filter.item` is not used.
  [[nodiscard]] virtual Result<std::vector<std::vector<ItemValue>>> values_of(const ItemFilter& filter,
                                                                              std::span<const ItemId> items) = 0;
  /// Values of the newest slabs of each mould, and all resets of moulds.
  [[nodiscard]] virtual Result<MouldRecords> mould_records(const MouldFilter& filter) = 0;
  [[nodiscard]] virtual Result<std::optional<SlabRecord>> slab(std::int64_t key) = 0;
  /// Keys of all slabs with this SLAB_ID, ignoring blanks around the stored text, or with this SLAB_NO; newest first.
  [[nodiscard]] virtual Result<std::vector<std::int64_t>> find_id(std::string_view slab_id) = 0;
  [[nodiscard]] virtual Result<std::vector<std::int64_t>> find_no(std::uint32_t slab_no) = 0;
  /// Stored maps of one attempt; empty if the block was not found.
  [[nodiscard]] virtual Result<std::unique_ptr<BlockMaps>> maps(std::int64_t key, int station, int attempt) = 0;

  /// The recipe's file by its SHA-256, or by a unique prefix of it. nullopt if no slab was begun with it.
  [[nodiscard]] virtual Result<std::optional<RecipeText>> recipe_text(std::string_view sha256) = 0;

  /// Gaps, oldest first; empty if the history is complete.
  [[nodiscard]] virtual Result<std::vector<HistoryGap>> gaps() = 0;

  /// All records, newest first.
  [[nodiscard]] virtual Result<std::vector<CalibrationRecord>> calibrations() = 0;
  /// A record by its id, or by a unique prefix of it.
  [[nodiscard]] virtual Result<std::optional<CalibrationRecord>> calibration(std::string_view id) = 0;
  /// The record in force; station tables by slab type.
  [[nodiscard]] virtual Result<std::optional<CalibrationRecord>> current(CalibrationKind kind,
                                                                         std::uint16_t slab_type = 0,
                                                                         std::string_view scanner = "1") = 0;
  /// The calibrations of one scanner that the daemon would use now.
  [[nodiscard]] virtual Result<std::unique_ptr<LineCalibration>> line_calibration(std::string_view scanner = "1") = 0;
  /// The same for all scanners of a line, with the tie.
  [[nodiscard]] virtual Result<std::unique_ptr<CellCalibration>> cell_calibration(const LineArms& arms) = 0;
  /// Applied changes, newest first.
  [[nodiscard]] virtual Result<std::vector<AppliedChange>> applied(std::size_t limit) = 0;
  /// Checks, newest first.
  [[nodiscard]] virtual Result<std::vector<CalibrationCheck>> checks(std::size_t limit) = 0;
  /// Master checks of a gauge, or of all gauges if the name is empty; newest first.
  [[nodiscard]] virtual Result<std::vector<GaugeCheckRecord>> gauge_checks(std::string_view gauge,
                                                                           std::size_t limit) = 0;
  /// Values of a gauge, of the newest slab first.
  [[nodiscard]] virtual Result<std::vector<GaugeSlabValue>> gauge_values(std::string_view gauge, std::size_t limit) = 0;
};
/// Recipient of texts read from a database, which may contain control characters.
enum class TextFor : std::uint8_t {
  people,   ///< control characters are replaced (base/plain_text.h); documents keep their lines
  programs  ///< as stored: for JSON, which escapes them, and for raw tables
};
/// Opens a database for reading. config: the file does not exist, is not a slabd database, or has an older or newer
/// schema version. A reader changes nothing; the daemon upgrades an older one at its start.
[[nodiscard]] Result<std::unique_ptr<Reader>> open_reader(const std::string& db_path, TextFor text = TextFor::people);
/// True if the database was never used: the file does not exist, or its creation was stopped before or within the first
/// transaction. The next writer completes it. Never true for a file with other content, of slabd or not.
[[nodiscard]] bool is_unused(const std::string& db_path);
/// True if a writer was stopped while it made an earlier log durable, or before its first commit to a new or restored
/// file: readers fail, and the next writer completes or undoes it.
[[nodiscard]] bool is_unfinished(const std::string& db_path);

// ---- maintenance of the file (slabctl) -----------------------------------------------------------------------------

struct DatabaseReport {
  std::string trouble;  ///< the damage or contradiction found; empty if the database is intact
  int version = 0;
  std::int64_t slabs = 0;
  std::int64_t oldest_key = 0;
  std::int64_t newest_key = 0;
  std::int64_t newest_utime_us = 0;  ///< newest wall clock of any record
  std::int64_t bytes = 0;
  std::int64_t log_bytes = 0;  ///< size of its write-ahead log
  /// True if the file is byte for byte the backup that was written (storage/files/file_checksum.h). False without
  /// `trouble`: a live database, or a copy made by another program, which cannot be verified.
  bool has_checksum = false;
};
/// Checks a whole database or backup: a backup's checksum and length, SQLite's own check (`full`: also indices against
/// tables) and references. It also checks that measured attempts and ended slabs have their results. Writes nothing.
/// config: the file does not exist, or is not a slabd database.
[[nodiscard]] Result<DatabaseReport> check_database(const std::string& path, bool full);

/// Newest slab key in a database of any schema version; 0 if it has none. Shows how recent a backup is. Errors as
/// check_database(), without its checks.
[[nodiscard]] Result<std::int64_t> newest_slab_key(const std::string& path);

/// Copies a database that no daemon has open to `to`, which must not exist; the copy is synced. For a running daemon
/// use Store::order.
[[nodiscard]] Status back_up_database(const std::string& db_path, const std::string& to);
/// Returns `<folder of the database>/backups`; created for the group if it does not exist.
[[nodiscard]] Result<std::string> backup_folder(const std::string& db_path);
/// Returns `slabd-20261121T154530.123Z.db` in that folder; the names sort by time.
[[nodiscard]] Result<std::string> backup_path(const std::string& db_path, std::int64_t utime_us);

/// Process other than slabd that blocks the writer of this database now: "sqlite3 (process 1234)"; empty if none. A
/// slabd that is writing is not reported.
[[nodiscard]] std::string foreign_lock(const std::string& db_path);
/// True if another process has this database open for writing.
[[nodiscard]] bool is_written_elsewhere(const std::string& db_path);

struct RestoreOrder {
  std::string from;  ///< path of a backup; empty: begin with an empty history
  ChangeNote note;
  std::uint16_t session = 0;  ///< random, so that no old command or RES_ACK matches the next session and record
  /// Accepts the loss of calibrations applied, of checks, of dispositions and of resets of moulds after the backup.
  bool lose_calibrations = false;
  /// Accepts a backup without a checksum (another program's copy), or one that was altered before it was made.
  bool accept_unproven = false;
};
/// Replaces the database with a backup, which is fully checked and upgraded; the current files are moved to quarantine.
/// The history gets an entry about the gap, and slab keys that may have been used are not used again. A slab that was
/// open in the backup ends aborted. The first SCAN discards a scan, because the last scans are unknown. config: the
/// current database has calibrations or checks that the backup lacks, or the backup has no checksum. journal_write: a
/// daemon is running, the backup is not intact, or a file could not be written. Then nothing was changed, or the daemon
/// does not start until a restore succeeds.
[[nodiscard]] Status restore_database(const StoreSettings& settings, const RestoreOrder& order);

// Field lists of records that storage defines; see base/fields.h.

SLABD_FIELDS(ChangeNote, who, why, utime_us);
SLABD_FIELDS(DispositionRecord, slab_key, utime_us, who, decision, reason, authority, second);

/// Fields of a record in addition to its id and its numbers.
template <typename V, RecordOf<CalibrationRecord> R>
void fields(V& v, R& r) {
  SLABD_EACH(r, parent_id, figures, observations, certificate)
  v("operator", r.operator_name);
  SLABD_EACH(r, robot_serial, scanner_serial, temperature_c, software, created_utime_us, expires_utime_us)
}

}  // namespace slabd::storage
