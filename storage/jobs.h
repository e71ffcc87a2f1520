// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <utility>

#include "base/calibration.h"
#include "storage/load.h"
#include "storage/rows.h"
#include "storage/storage.h"

namespace slabd::storage {

/// A job that contradicts what is stored. Thrown inside a transaction, which is then rolled back; the connection
/// stays good.
struct Refusal {
  Error error;
};

/// What each StoreJob means in rows. Every call runs inside one transaction of the caller and throws SqlFailure or
/// Refusal.
///
/// A commit whose answer was an error may have reached the disk all the same. Some jobs then come again: the session
/// when the PLC resets the fault, a block because it is measured once more, the slab's end and a report because the PLC
/// commands them anew; an acknowledgement is given again by the station. So every job may find rows of its own: it
/// replaces them, or leaves them when nothing would change. Nor do blocks, ends and reports come again for certain: the
/// PLC may have the station scanned anew instead, and theirs are records that a restart would show. So these are taken
/// back by the next job that can be written, and an acquired scan is a failed one then, as the PLC was told.
class Jobs {
 public:
  /// `settings` and `held_back` belong to the caller; `held_back` may change between jobs.
  Jobs(Connection& db, const StoreSettings& settings, const HeldBack& held_back);

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

  /// What the last job came to when it is written and its answer is an error all the same; taken once. A scan that an
  /// earlier attempt already had: frame_incomplete.
  [[nodiscard]] std::optional<Error> take_answer() { return std::exchange(answer_, std::nullopt); }

  /// Every command that was accepted and not finished becomes "interrupted"; a SCAN among them leaves a failed attempt.
  /// But SLAB_ABORT of the open slab, its newest command, stays accepted: the station finishes it.
  void interrupt_unfinished();

  /// Begins the chain of results where there is none.
  void begin_chain();

  /// Take back what nobody was shown. A block stays acquired, to be measured again; the command for an end or a report
  /// stays accepted, and is one that was interrupted should the process end.
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
  /// Did an earlier attempt have these points? Then it is named in `answer_`.
  [[nodiscard]] bool is_known(const Attempt& attempt);
  [[nodiscard]] AttemptState state_of(const Attempt& attempt, StationPhase phase, std::uint16_t code) const;

  /// A late change of an ended slab is sealed anew.
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
};

}  // namespace slabd::storage
