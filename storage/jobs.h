// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <utility>

#include "base/calibration.h"
#include "storage/load.h"
#include "storage/rows.h"
#include "storage/seals.h"
#include "storage/storage.h"

namespace slabd::storage {

/// A job that contradicts the stored data. Thrown inside a transaction, which is then rolled back; the connection
/// remains usable.
struct Refusal {
  Error error;
};

/// Executes each StoreJob as row changes. Every call must be inside one transaction of the caller and throws SqlFailure
/// or Refusal.
///
/// A commit that returned an error may still have reached the disk. Some jobs are then repeated: the session when the
/// PLC resets the fault, a block when it is measured again, an acknowledgement by the station. Ends and reports are
/// repeated when the PLC repeats its command. Therefore a job may find its own rows: it replaces them, or leaves them
/// if nothing would change. Blocks, ends and reports may also not be repeated, because the PLC may order a new scan
/// instead, but a restart would show their records. The next job that can be written therefore reverts them. An
/// acquired scan becomes a failed one, as already reported to the PLC.
class Jobs {
 public:
  /// `settings` and `held_back` belong to the caller; `held_back` may change between jobs.
  Jobs(Connection& db, const StoreSettings& settings, const HeldBack& held_back);

  /// Keeps the statements of the chain between slabs, which saves their preparation and needs some 200 kB. It is for a
  /// writer of many slabs.
  void keep_seals() { kept_seals_.emplace(db_, SealStatements::keep); }

  void operator()(const SessionJob& job);
  void operator()(const BeginSlabJob& job);
  void operator()(const CommandJob& job);
  void operator()(const AcquiredJob& job);
  void operator()(const FailedAttemptJob& job);
  void operator()(const BlockJob& job);
  void operator()(const SlabJob& job);
  void operator()(const AckJob& job);
  void operator()(const ReportJob& job);
  void operator()(const SeenScanJob& job);
  void operator()(const MeasuringJob& job);

  /// Error of the last job if it was written although its answer is an error; cleared by this call. frame_incomplete if
  /// an earlier attempt had the same scan.
  [[nodiscard]] std::optional<Error> take_answer() { return std::exchange(answer_, std::nullopt); }

  /// Marks every accepted but unfinished command as "interrupted"; a SCAN also leaves a failed attempt. Exception: a
  /// SLAB_ABORT that is the newest command of the open slab stays accepted, and the station finishes it.
  void interrupt_unfinished();

  /// Begins the chain of results if there is none.
  void begin_chain();

  /// Revert results that were never shown. A block stays acquired, to be measured again. The command of an end or a
  /// report stays accepted, and counts as interrupted if the process ends.
  void undo_end(std::int64_t slab_key);
  void undo_block(const BlockKey& key);
  void undo_report(std::uint16_t res_seq);

 private:
  void note_time(std::int64_t utime_us);
  void close_command(std::uint16_t session, std::uint16_t cmd_seq, std::uint16_t status, bool acquired);
  void insert_command(const CommandJob& command, std::uint16_t status);
  void insert_result(std::int64_t slab_key, bool is_repeat, const PlcResult& record);
  void delete_unseen_result(std::int64_t slab_key, std::uint16_t kind, std::uint16_t station, std::uint16_t cmd_seq);
  void insert_failed_scan(std::int64_t slab_key, std::uint8_t station, std::uint16_t session, std::uint16_t cmd_seq);
  void insert_block(const BlockKey& key, const BlockResult& block);
  void insert_maps(const BlockKey& key, const BlockMaps& maps);
  void insert_items(const BlockKey& key, const Item* begin, const Item* end);
  void keep_recipe(const SlabHeader& slab);
  void remember_scan(std::uint64_t fingerprint);
  void remember_noise(const BlockKey& key, const NoisePrint& noise);
  /// True if an earlier attempt had these points; `answer_` then contains that attempt.
  [[nodiscard]] bool is_known(const Attempt& attempt);
  [[nodiscard]] AttemptState state_of(const Attempt& attempt, StationPhase phase, std::uint16_t code) const;

  template <typename Work>
  void with_seals(const Work& work) {
    if (kept_seals_) return work(*kept_seals_);
    Seals seals(db_);
    work(seals);
  }
  /// Seals an ended slab again after a late change.
  void seal_if_ended(std::int64_t slab_key);

  Connection& db_;
  const StoreSettings& settings_;
  const HeldBack& held_back_;
  std::optional<Error> answer_;
  Statement set_session_;
  Statement newest_;
  Statement set_newest_;
  NewestTime newest_time_;
  Statement newest_slab_;
  Statement slab_attempts_;
  Statement upsert_slab_;
  Statement delete_arms_;
  Statement insert_arm_;
  Statement has_recipe_;
  Statement insert_recipe_;
  Statement newest_command_;
  Statement insert_command_;
  Statement close_command_;
  Statement close_newest_;
  Statement attempt_phase_;
  Statement upsert_attempt_;
  Statement same_fingerprint_;
  Statement remember_scan_;
  Statement forget_scans_;
  Statement remember_noise_;
  Statement forget_noise_;
  Statement set_emulated_;
  Statement set_measured_;
  Statement set_measuring_;
  Statement attempt_command_;
  Statement delete_block_;
  Statement insert_block_;
  Statement insert_plane_;
  Statement insert_casing_;
  Statement insert_finding_;
  Statement insert_edge_;
  Statement delete_items_;
  Statement insert_item_;
  Statement insert_map_;
  Statement delete_gauges_;
  Statement insert_gauge_;
  Statement upsert_slab_result_;
  Statement upsert_station_result_;
  Statement delete_unseen_result_;
  Statement insert_result_;
  Statement acknowledge_;
  Statement delete_slab_result_;
  Statement delete_station_results_;
  Statement delete_slab_record_;
  Statement reopen_end_;
  Statement reopen_report_;
  Statement set_acquired_;
  Statement delete_report_;
  Statement last_ended_;
  Statement unfinished_;
  Statement scan_recorded_;
  Statement is_ended_;
  std::optional<Seals> kept_seals_;
};

}  // namespace slabd::storage
