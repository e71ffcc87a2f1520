// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "base/base.h"
#include "base/jobs.h"
#include "base/record_fields.h"

/// SQLite: what was commanded, acquired, measured and decided. The daemon holds the only writer; slabctl reads.
namespace slabd::storage {

inline constexpr int kApplicationId = 0x534C4244;  // "SLBD"
inline constexpr int kSchemaVersion = 1;

/// The longest recipe of the line has 8 kB, comments included. The files of all recipes stay in memory.
inline constexpr std::size_t kRecipeTextBytes = 65'536;
/// A recipe's file: what a slab's recipe_sha256 stands for.
struct RecipeText {
  FixedString<64> sha256;  ///< of `text`, hex
  FixedString<32> name;
  std::string text;  ///< byte for byte; at most kRecipeTextBytes
  std::int64_t kept_utime_us = 0;
};

struct StoreSettings {
  std::string db_path;
  std::string spool_dir;
  /// SLAB_BEGIN is refused below this much free space on the spool disk: two slabs of 18 x 60 MB.
  std::uint64_t spool_free_bytes_min = 2'300'000'000;
  /// Bytes of scans the spool may hold; beyond it the scans (never the records) of the oldest acknowledged slabs are
  /// deleted, passed ones first. 0 = keep everything.
  std::uint64_t spool_budget_bytes = 0;
  /// Slabs whose records are kept, by number and not by age, because a wall clock may be wrong; older ones go when
  /// their scans are gone and the PLC has every result. 0 = keep everything; else at least kKeepSlabsMin.
  std::int64_t keep_slabs = 0;
  /// Of slabs that did not pass (failed, indeterminate, not measured, aborted) so many of the newest are kept all the
  /// same, those among the newest keep_slabs counted in. 0 = every one; without keep_slabs it means nothing. At least
  /// kKeepSlabsMin.
  std::int64_t keep_failed_slabs = 0;
  /// Of the recipes that slabs may be begun with. A slab's one is kept with it, in the same transaction; here it has no
  /// time yet.
  std::vector<RecipeText> recipe_texts{};
};
/// So many slabs always stay: the PLC's table, repeats and counters come from the newest ones.
inline constexpr std::int64_t kKeepSlabsMin = 100;

// ---- calibrations ------------------------------------------------------------------------------------------------

/// One calibration with everything it was made from. Records are only ever added.
struct CalibrationRecord {
  std::string id;  ///< made by storage from kind, numbers and parent (`calibration_id`)
  /// In the order of CalibrationKind.
  std::variant<HandEyeNumbers, StationTable, ReferenceBlock, MonitorBall, ScannerNumbers> numbers;
  std::string parent_id;     ///< stations: the hand-eye calibration they were solved with. Empty: none
  std::string figures;       ///< quality figures as a JSON object, as the solver printed them
  std::string observations;  ///< the views as captured, in the neutral text form: enough to solve again
  std::string certificate;   ///< text of the artefact's certificate
  std::string operator_name;
  std::string robot_serial;
  std::string scanner_serial;
  double temperature_c = kNoValue;
  std::string software;
  std::int64_t created_utime_us = 0;
  std::int64_t expires_utime_us = 0;  ///< 0 = never

  [[nodiscard]] CalibrationKind kind() const { return static_cast<CalibrationKind>(numbers.index()); }
  /// Of a station table; 0 for the other kinds, which hold for every slab.
  [[nodiscard]] std::uint16_t slab_type() const;
};
/// "he-3f2a91c07b5e": equal ids mean equal kind, numbers and parent.
[[nodiscard]] std::string calibration_id(const CalibrationRecord& record);

/// Who changed what is in force, and why; the words of a person, kept for ever.
struct ChangeNote {
  std::string who;
  std::string why;
  std::int64_t utime_us = 0;
};

/// Adds a record. One with the same numbers that is there already stays as it is and counts as added.
struct KeepCalibration {
  CalibrationRecord record;
};
/// Puts a record in force in place of the one of its kind (and slab type).
struct ApplyCalibration {
  std::string id;
  ChangeNote note;
};
/// Puts back what was in force before; doing it again goes back further. Refused when there is nothing before.
struct RollBackCalibration {
  CalibrationKind kind = CalibrationKind::hand_eye;
  std::uint16_t slab_type = 0;  ///< of station tables; 0: of the newest change of this kind
  ChangeNote note;
};
/// Adds a check to the trend.
struct KeepCheck {
  CalibrationCheck check;
};
using CalibrationChange = std::variant<KeepCalibration, ApplyCalibration, RollBackCalibration, KeepCheck>;

/// One line of the history of what was in force. Lines are only ever added.
struct AppliedChange {
  std::int64_t seq = 0;
  CalibrationKind kind = CalibrationKind::hand_eye;
  std::uint16_t slab_type = 0;
  bool is_rollback = false;
  std::string calibration_id;  ///< in force from here on
  std::string replaced_id;     ///< in force until here; empty: none
  ChangeNote note;
};

// ---- care of the database as a whole -------------------------------------------------------------------------------

/// Copies the whole database to `path`, which must not exist.
struct BackupOrder {
  std::string path;
};
/// Takes away the records of slabs older than the newest `keep_slabs`, as StoreSettings::keep_slabs does by itself.
struct PruneOrder {
  std::int64_t keep_slabs = 0;
  std::optional<std::int64_t>
      keep_failed_slabs{};  ///< none: StoreSettings', or as many as keep_slabs where it keeps all
};
using CareOrder = std::variant<BackupOrder, PruneOrder>;

/// What became of the last orders.
struct CareState {
  enum class Phase : std::uint8_t { none, under_way, done, failed };
  Phase backup = Phase::none;
  std::string backup_path;
  std::int64_t backup_pages = 0;  ///< of backup_pages_all
  std::int64_t backup_pages_all = 0;
  std::string backup_error;
  Phase prune = Phase::none;
  std::int64_t pruned_slabs = 0;
  std::string prune_error;
};

/// The writer. One object, one thread. Every apply() is one transaction, durable when it returns
/// (synchronous=EXTRA, then WAL). A write error closes the file; the next call opens it anew, with quick_check, before
/// it does anything. A job given again because its answer was an error replaces what the first one may have left.
class Store {
 public:
  virtual ~Store() = default;
  /// Reads what a restarted daemon must know and marks interrupted commands (one transaction); then deletes scans of
  /// the newest slab that were spooled and never recorded. Call it once, before the first scan. More unacknowledged
  /// results than RecoveredLine holds stay unacknowledged, the newest of them, until the next restart.
  [[nodiscard]] virtual Result<std::unique_ptr<RecoveredLine>> recover() = 0;
  /// Codes: store_full (disk, or less than spool_free_bytes_min at a slab's begin), frame_incomplete (AcquiredJob; it
  /// is written, as a failed attempt), journal_write (anything else).
  [[nodiscard]] virtual Status apply(const StoreJob& job) = 0;
  /// Carries out one change of calibrations, in one transaction; returns the id of the record that it was about.
  /// config: it cannot be (no such id, nothing to roll back to, numbers that make no sense), nothing was changed and
  /// the text says what to do. store_full, journal_write as apply().
  [[nodiscard]] virtual Result<std::string> change(const CalibrationChange& change) = 0;
  /// What is in force now.
  [[nodiscard]] virtual Result<std::unique_ptr<LineCalibration>> calibration() = 0;
  /// Called by the writer's thread about ten times a second while there is no job: after some calls in a row the
  /// write-ahead log is moved into the database, so that no commit has to.
  virtual void idle() {}
  /// Why old scans could not be deleted to keep the spool budget; empty when all is well. Never fails a job.
  [[nodiscard]] virtual std::string_view spool_trouble() const { return {}; }
  /// The recipes that slabs may be begun with from now on (StoreSettings::recipe_texts). Callable from any thread.
  virtual void use_recipes(const std::vector<RecipeText>& /*texts*/) {}
  /// Why the next job would be refused, as far as idle() has seen: the database was deleted or replaced while it is
  /// open. Empty when all is well. The open file can still be backed up.
  [[nodiscard]] virtual std::string_view trouble() const { return {}; }
  /// Callable from any thread. Takes an order, which idle() then carries out piece by piece, so that no job waits for
  /// long. busy: one of its kind is under way. config: it makes no sense (the text says why).
  [[nodiscard]] virtual Status order(const CareOrder& order) = 0;
  /// Callable from any thread.
  [[nodiscard]] virtual CareState care() const = 0;
};

/// Opens or creates the database (folders too, mode 2750). One of an older schema version is copied to
/// `<db>.v<version>-backup` and then brought up to date in one transaction. journal_write when it cannot be opened, is
/// open for writing elsewhere, is damaged, another application's or of a test version before 1.0 (application_id), or
/// newer than this program (user_version); the text names the file and the figures. A damaged one is moved, with its
/// log, to `<db>.quarantine-<time>`, and a note takes its place, so that no start begins a new history by accident. For
/// the same reason none is created where scans, backups or a log show that there has been one.
[[nodiscard]] Result<std::unique_ptr<Store>> open_store(const StoreSettings& settings);

// ---- reading (slabctl; short read-only transactions, never checkpoints) -------------------------------------------

struct SlabSummary {
  SlabHeader header;
  std::int64_t ended_utime_us = 0;  ///< 0 = still open
  Verdict verdict = Verdict::none;
  std::uint16_t reason = 0;
  int stations_measured = 0;  ///< stations whose valid attempt came to a result, which `not_measured` is not
  bool acknowledged = false;
};

/// Which slabs; everything that is set must hold.
struct SlabFilter {
  std::size_t limit = 20;
  std::optional<std::int64_t> since_utime_us = std::nullopt;  ///< began at or after
  std::optional<std::int64_t> until_utime_us = std::nullopt;  ///< began before
  int slab_type = 0;                                          ///< 0: all
  std::string id_part;                                        ///< somewhere in the SLAB_ID; empty: all
  /// Without item and block: of the slab. With a block: of that station after SLAB_END. With an item: of the item (at
  /// that block, when there is one); none: any verdict but pass.
  Verdict verdict = Verdict::none;
  int block = 0;  ///< 0: none
  std::optional<ItemId> item;
};

/// Which values of one item. Slabs that are still open or were aborted have none: nobody stands behind what was seen of
/// them until then.
struct ItemFilter {
  ItemId item = ItemId::seat_slope;
  std::size_t slabs = 1'000;  ///< the newest ones
  std::optional<std::int64_t> since_utime_us = std::nullopt;
  std::optional<std::int64_t> until_utime_us = std::nullopt;
  int slab_type = 0;
  int block = 0;  ///< 0: all; of a spacing or a pair: its first station
};
/// One value of an item, of the valid attempt; the slab's own one where SLAB_END computed it anew. A block's item is
/// not_measured, without limits, where its station was never scanned or no scan of it came to a result.
struct ItemValue {
  std::int64_t slab_key = 0;
  std::uint16_t slab_type = 0;
  SlabId slab_id;
  std::int64_t began_utime_us = 0;
  Item item;                  ///< budget and companion are not read
  std::uint8_t emulated = 0;  ///< emulation bits of its slab
};

struct SlabBlock {
  Attempt attempt;
  StationPhase phase = StationPhase::empty;
  std::uint16_t code = 0;
  BlockResult block;
  /// After SLAB_END, slab items included; of a slab that was aborted never a pass.
  Verdict final_verdict = Verdict::none;
  std::uint16_t final_reason = 0;
};

struct SlabRecord {
  SlabSummary summary;
  SlabResult slab;                ///< items empty until SLAB_END
  std::vector<SlabBlock> blocks;  ///< every attempt, by station and number; the latest of a station is the valid one
};

/// What is known to be missing from the history.
struct HistoryGap {
  enum class What : std::uint8_t {
    restored,    ///< from a backup: slabs measured after it was made are not there
    begun_anew,  ///< nothing from before is there
    pruned,      ///< slabs up to `slab_key` were taken away by retention
  };
  What what = What::restored;
  std::int64_t slab_key = 0;  ///< keys up to here may have been used before
  std::int64_t kept_key = 0;  ///< restored: the newest of them that is there; 0: none, or nobody knows any more
  std::int64_t slabs = 0;     ///< pruned: how many
  ChangeNote note;            ///< of a person; empty for retention
  std::string source;         ///< restored: the backup
};

class Reader {
 public:
  virtual ~Reader() = default;
  /// Newest first.
  [[nodiscard]] virtual Result<std::vector<SlabSummary>> slabs(const SlabFilter& filter) = 0;
  [[nodiscard]] Result<std::vector<SlabSummary>> slabs(std::size_t limit) {
    SlabFilter filter;
    filter.limit = limit;
    return slabs(filter);
  }
  /// Oldest first; of one slab by station.
  [[nodiscard]] virtual Result<std::vector<ItemValue>> values(const ItemFilter& filter) = 0;
  [[nodiscard]] virtual Result<std::optional<SlabRecord>> slab(std::int64_t key) = 0;
  /// Keys of all slabs with this SLAB_ID, also where it was stored with blanks around it, or with this SLAB_NO; the
  /// newest first.
  [[nodiscard]] virtual Result<std::vector<std::int64_t>> find_id(std::string_view slab_id) = 0;
  [[nodiscard]] virtual Result<std::vector<std::int64_t>> find_no(std::uint32_t slab_no) = 0;
  /// What was kept of one attempt to draw it; empty maps if the block was not found.
  [[nodiscard]] virtual Result<std::unique_ptr<BlockMaps>> maps(std::int64_t key, int station, int attempt) = 0;

  /// The recipe's file by its SHA-256, or by the first characters of one when only one begins so. nullopt if no slab
  /// was begun with it.
  [[nodiscard]] virtual Result<std::optional<RecipeText>> recipe_text(std::string_view sha256) = 0;

  /// Oldest first; empty: the history is complete.
  [[nodiscard]] virtual Result<std::vector<HistoryGap>> gaps() = 0;

  /// Every record, newest first.
  [[nodiscard]] virtual Result<std::vector<CalibrationRecord>> calibrations() = 0;
  /// By id, or by the first characters of one when only one begins so.
  [[nodiscard]] virtual Result<std::optional<CalibrationRecord>> calibration(std::string_view id) = 0;
  /// The record in force; station tables by slab type.
  [[nodiscard]] virtual Result<std::optional<CalibrationRecord>> current(CalibrationKind kind,
                                                                         std::uint16_t slab_type = 0) = 0;
  /// What the daemon would work with now.
  [[nodiscard]] virtual Result<std::unique_ptr<LineCalibration>> line_calibration() = 0;
  /// Newest first.
  [[nodiscard]] virtual Result<std::vector<AppliedChange>> applied(std::size_t limit) = 0;
  /// Newest first.
  [[nodiscard]] virtual Result<std::vector<CalibrationCheck>> checks(std::size_t limit) = 0;
};
/// Who reads the texts of a database, which may come from elsewhere.
enum class TextFor : std::uint8_t {
  people,   ///< control characters are replaced (base/plain_text.h); documents keep their lines
  programs  ///< as stored: for JSON, which escapes them, and for raw tables
};
/// config when the file does not exist, is no slabd database, or is one of an older or newer schema version (a reader
/// changes nothing; the daemon's start brings an older one up to date).
[[nodiscard]] Result<std::unique_ptr<Reader>> open_reader(const std::string& db_path, TextFor text = TextFor::people);
/// Nobody has kept anything there yet: no file, or one whose creation was stopped before its first transaction. The
/// next writer makes it whole. Never true of a file that holds anything, ours or not.
[[nodiscard]] bool is_unused(const std::string& db_path);
/// A writer was stopped while it made the log of the one before durable: readers wait, the next writer finishes it.
[[nodiscard]] bool is_unfinished(const std::string& db_path);

// ---- looking after the file (slabctl) ------------------------------------------------------------------------------

struct DatabaseReport {
  std::string trouble;  ///< what is damaged or contradicts itself; empty: whole
  int version = 0;
  std::int64_t slabs = 0;
  std::int64_t oldest_key = 0;
  std::int64_t newest_key = 0;
  std::int64_t newest_utime_us = 0;  ///< newest wall clock of any record
  std::int64_t bytes = 0;
  std::int64_t log_bytes = 0;  ///< of the write-ahead log beside it
  /// The file is byte for byte the backup that was written (storage/files/file_checksum.h). False without `trouble`: a
  /// live database, or a copy that another program made, of which that cannot be proven.
  bool has_checksum = false;
};
/// Reads a whole database or backup and says whether it can be trusted: a backup's checksum and length, SQLite's own
/// check (`full`: indices against tables as well), references, and that what is called measured and ended is there.
/// Writes nothing. config: there is no such file, or it is none of ours.
[[nodiscard]] Result<DatabaseReport> check_database(const std::string& path, bool full);

/// The newest slab that a database of any schema version knows, 0: none. What says how new a backup is. As
/// check_database(), without looking whether it is whole.
[[nodiscard]] Result<std::int64_t> newest_slab_key(const std::string& path);

/// Copies a database that no daemon has open to `to` (which must not exist), synced. For a running daemon:
/// Store::order.
[[nodiscard]] Status back_up_database(const std::string& db_path, const std::string& to);
/// `<folder of the database>/backups`; made for the group when it is not there.
[[nodiscard]] Result<std::string> backup_folder(const std::string& db_path);
/// `slabd-20261121T154530.123Z.db` in there; names sort by time.
[[nodiscard]] Result<std::string> backup_path(const std::string& db_path, std::int64_t utime_us);

/// Who keeps a writer out of this database now, and is no slabd: "sqlite3 (process 1234)"; empty: no such process. A
/// slabd that writes at this moment is not one.
[[nodiscard]] std::string foreign_lock(const std::string& db_path);
/// Another process has this database open for writing now.
[[nodiscard]] bool is_written_elsewhere(const std::string& db_path);

struct RestoreOrder {
  std::string from;  ///< a backup; empty: begin with an empty history
  ChangeNote note;
  std::uint16_t session = 0;  ///< drawn by chance: no old command, nor RES_ACK, may fit the next session and record
  /// Calibrations that were put in force, and checks of them, since the backup are given up.
  bool lose_calibrations = false;
  /// A backup without a checksum (another program's copy), or one that was altered before it was made, is restored as
  /// well.
  bool accept_unproven = false;
};
/// Puts a backup, checked in full and brought up to date, in the place of the database; what lies there now goes to
/// quarantine. The history says from then on that it has a gap; slab keys that may have been used are not used again;
/// a slab that was open in the backup ends aborted; the first SCAN throws a scan away, as none of the last is known.
/// config: what lies there knows of calibrations or checks that the backup does not, or the backup has no checksum.
/// journal_write: a daemon runs, the backup is not whole, or a file could not be written; then nothing was changed, or
/// the daemon refuses to start until restoring succeeds.
[[nodiscard]] Status restore_database(const StoreSettings& settings, const RestoreOrder& order);

// Field lists of records that storage defines; see base/fields.h.

SLABD_FIELDS(ChangeNote, who, why, utime_us);

/// What a record has beside its id and its numbers.
template <typename V, RecordOf<CalibrationRecord> R>
void fields(V& v, R& r) {
  SLABD_EACH(r, parent_id, figures, observations, certificate)
  v("operator", r.operator_name);
  SLABD_EACH(r, robot_serial, scanner_serial, temperature_c, software, created_utime_us, expires_utime_us)
}

}  // namespace slabd::storage
