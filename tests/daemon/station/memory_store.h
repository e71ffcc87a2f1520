// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <tuple>
#include <utility>
#include <vector>

#include "base/jobs.h"
#include "base/plc.h"

/// Stores in memory what a database would store for each job, and handles the end of a process like storage/jobs.cpp.
/// Every command that was begun and not ended is closed as interrupted, and each SCAN among them leaves the mark of an
/// unseen scan. SLAB_ABORT stays, to be finished. A commit may be done although its answer is an error; the station
/// cannot know its result then.
namespace slabd::daemon {

struct MemoryStore {
  RecoveredLine line;
  std::optional<Code> fail_next;
  std::function<bool(const StoreJob&)> fail_when;  ///< jobs for which the disk fails
  std::vector<StoreJob> applied;
  int slabs_ended = 0;
  int refused = 0;                  ///< jobs that a station must not submit
  std::vector<std::uint64_t> seen;  ///< fingerprints, oldest first

  /// `answer_lost`: the job is carried out, but the answer is an error.
  Code apply(const StoreJob& job, bool answer_lost = false) {
    if (fail_next) {
      const Code code = *fail_next;
      fail_next.reset();
      return failed(job, code);
    }
    if (fail_when && fail_when(job)) return failed(job, Code::journal_write);
    undo_unseen();
    if (const auto told = std::exchange(unwritten_, {})) keep(*told);
    if (is_refused(job)) {
      ++refused;
      return Code::journal_write;
    }
    closed_last_.reset();
    if (const auto* scan = std::get_if<AcquiredJob>(&job.what); scan != nullptr && scan->refuse_known && !answer_lost)
      if (is_in_history(scan->attempt)) {
        const FailedAttemptJob known{scan->attempt, static_cast<std::uint16_t>(Code::frame_incomplete),
                                     scan->fingerprint};
        applied.push_back(StoreJob{job.ticket, known});
        keep(known);
        forget_unseen();
        return Code::frame_incomplete;
      }
    if (answer_lost && std::holds_alternative<SlabJob>(job.what)) before_unseen_end_ = line;
    if (const auto* block = std::get_if<BlockJob>(&job.what); answer_lost && block != nullptr)
      unseen_blocks_[block->block.station] = *block;
    if (const auto* report = std::get_if<ReportJob>(&job.what); answer_lost && report != nullptr)
      unseen_report_ = report->record.res_seq;
    applied.push_back(job);
    std::visit([this](const auto& what) { keep(what); }, job.what);
    if (answer_lost) return failed(job, Code::journal_write);
    forget_unseen();
    return Code::ok;
  }
  /// The monotonic clock restarts: marks of measurements have future times and do not count against a scan.
  void restart_computer() {
    for (StationRecord& record : line.stations)
      if (record.measuring_since_ns != 0) record.measuring_since_ns += 86'400 * kNsPerS;
  }
  /// The state that a restarted daemon would find.
  RecoveredLine recover() {
    line.abort_seq = 0;
    for (const CommandJob& command : std::exchange(unfinished_, {})) {
      if (is_abort_to_finish(command)) {
        line.abort_seq = command.cmd_seq;
        unfinished_.push_back(command);
      } else {
        interrupt(command);
      }
    }
    forget_unseen();
    unwritten_.reset();
    return line;
  }
  /// True if a process that starts now would accept the scanner's first scan.
  [[nodiscard]] bool trusts_scanner() const {
    const auto is_scan = [](const CommandJob& command) { return is(command, PlcCommand::scan); };
    const bool scan_under_way = std::any_of(unfinished_.begin(), unfinished_.end(), is_scan);
    return !scan_under_way && (seen.empty() || seen.back() != kUnseenScan);
  }

 private:
  // ---- commands ----
  [[nodiscard]] static bool is(const CommandJob& command, PlcCommand what) {
    return command.command == static_cast<std::uint16_t>(what);
  }
  /// True for SLAB_ABORT of the open slab without a later command.
  [[nodiscard]] bool is_abort_to_finish(const CommandJob& command) const {
    return is(command, PlcCommand::slab_abort) && line.slab_open && command.slab_key == line.slab.key &&
           newest_order_.session == command.session && newest_order_.cmd_seq == command.cmd_seq;
  }
  void begin_command(const CommandJob& job, CommandStatus status) {
    newest_ = job;
    line.cmd_ack = job.cmd_seq;
    line.cmd_status = static_cast<std::uint16_t>(status);
  }
  void close(std::uint16_t session, std::uint16_t cmd_seq, std::uint16_t status) {
    std::erase_if(unfinished_,
                  [&](const CommandJob& command) { return command.session == session && command.cmd_seq == cmd_seq; });
    if (newest_.session == session && newest_.cmd_seq == cmd_seq) line.cmd_status = status;
  }
  /// Closes the newest such command, as the station's jobs do that do not name a command.
  template <typename... Commands>
  void close_newest(Commands... which) {
    const auto found = std::find_if(unfinished_.rbegin(), unfinished_.rend(),
                                    [&](const CommandJob& command) { return (is(command, which) || ...); });
    if (found == unfinished_.rend()) return;
    closed_last_ = *found;
    close(closed_last_->session, closed_last_->cmd_seq, static_cast<std::uint16_t>(CommandStatus::done));
  }
  /// Reopens the command whose job was taken back.
  void reopen_last() {
    if (!closed_last_) return;
    unfinished_.push_back(*closed_last_);
    if (newest_.session == closed_last_->session && newest_.cmd_seq == closed_last_->cmd_seq)
      line.cmd_status = static_cast<std::uint16_t>(CommandStatus::accepted);
    closed_last_.reset();
  }
  void interrupt(const CommandJob& command) {
    constexpr std::uint16_t kInterrupted = static_cast<std::uint16_t>(Code::interrupted);
    if (newest_.session == command.session && newest_.cmd_seq == command.cmd_seq)
      line.cmd_status = static_cast<std::uint16_t>(kCommandFailed + kInterrupted);
    if (!is(command, PlcCommand::scan)) return;
    remember(kUnseenScan);
    const CommandJob& newest = newest_scan_[command.station];
    const bool newest_of_station = newest.session == command.session && newest.cmd_seq == command.cmd_seq;
    if (!newest_of_station || !line.slab_open || command.slab_key != line.slab.key) return;
    StationRecord& record = line.stations[command.station - 1U];
    record.phase = StationPhase::failed;
    record.code = kInterrupted;
    ++record.attempts;
  }

  // ---- jobs ----
  /// True if an earlier attempt had the same points.
  [[nodiscard]] bool is_in_history(const Attempt& attempt) const {
    if (!attempt.fingerprint) return false;
    const auto known = history_.find(*attempt.fingerprint);
    return known != history_.end() && known->second != std::tuple{attempt.slab_key, attempt.station, attempt.number};
  }
  /// The PLC reads that the scan failed, so the failure is written with the next job.
  Code failed(const StoreJob& job, Code code) {
    if (const auto* scan = std::get_if<AcquiredJob>(&job.what))
      unwritten_ = {scan->attempt, static_cast<std::uint16_t>(code), scan->fingerprint};
    if (const auto* attempt = std::get_if<FailedAttemptJob>(&job.what)) unwritten_ = *attempt;
    return code;
  }
  [[nodiscard]] bool is_refused(const StoreJob& job) const {
    if (const auto* begin = std::get_if<BeginSlabJob>(&job.what)) {
      const bool again = line.slab_open && begin->slab.key == line.slab.key;
      return !again && (line.slab_open || begin->slab.key <= line.last_slab_key);
    }
    if (const auto* block = std::get_if<BlockJob>(&job.what))
      return !attempts_.contains({block->slab_key, block->block.station, block->attempt});
    return false;
  }
  /// Takes back jobs that were answered with an error, because the station continues as if they had not been done.
  void undo_unseen() {
    for (const auto& [station, block] : unseen_blocks_) {
      StationRecord& record = line.stations[station - 1U];
      if (line.slab.key == block.slab_key && record.attempt.number == block.attempt &&
          record.phase == StationPhase::measured)
        record.phase = StationPhase::acquired;
      forget_record(block.record.res_seq);
    }
    if (unseen_report_ != 0) {
      forget_record(unseen_report_);
      reopen_last();
    }
    undo_unseen_end();
  }
  void forget_unseen() {
    unseen_blocks_.clear();
    unseen_report_ = 0;
    before_unseen_end_.reset();
  }
  void undo_unseen_end() {
    if (!before_unseen_end_ || line.slab_open) return;
    forget_record(line.slab_record.res_seq);
    reopen_last();
    line.slab_open = true;
    line.slab_verdict = before_unseen_end_->slab_verdict;
    line.slab_record = before_unseen_end_->slab_record;
    --slabs_ended;
  }
  void keep(const SessionJob& job) { line.session = job.session; }
  void keep(const BeginSlabJob& job) {
    line.slab_open = true;
    line.end_was_given = false;
    line.slab = job.slab;
    line.stations = {};
    line.last_slab_key = job.slab.key;
    CommandJob command;
    command.session = job.session;
    command.cmd_seq = job.cmd_seq;
    begin_command(command, CommandStatus::done);
  }
  void keep(const CommandJob& job) {
    begin_command(job, CommandStatus::accepted);
    unfinished_.push_back(job);
    line.end_was_given = line.end_was_given || is(job, PlcCommand::slab_end);
    if (is(job, PlcCommand::scan)) newest_scan_[job.station] = job;
    if (!is(job, PlcCommand::report)) newest_order_ = job;
  }
  StationRecord& attempted(const Attempt& attempt) {
    attempts_.insert({attempt.slab_key, attempt.station, attempt.number});
    if (attempt.fingerprint)
      history_.try_emplace(*attempt.fingerprint, attempt.slab_key, attempt.station, attempt.number);
    StationRecord& record = line.stations[attempt.station - 1U];
    if (attempt.asked) record.attempts = std::max(record.attempts, attempt.number);
    return record;
  }
  void keep(const AcquiredJob& job) {
    StationRecord& record = attempted(job.attempt);
    record.phase = StationPhase::acquired;
    record.attempt = job.attempt;
    record.measuring_since_ns = job.measuring_since_ns;
    if (line.slab.key == job.attempt.slab_key)
      line.slab.emulated = static_cast<std::uint8_t>(line.slab.emulated | job.attempt.emulated);
    remember(job.fingerprint);
    acq_before_ = std::exchange(line.acq_seq, job.attempt.cmd_seq);
    close(job.attempt.session, job.attempt.cmd_seq, static_cast<std::uint16_t>(CommandStatus::acquired));
  }
  void keep(const FailedAttemptJob& job) {
    StationRecord& record = attempted(job.attempt);
    record.phase = StationPhase::failed;
    record.code = job.code;
    remember(job.fingerprint);
    // The job was answered with an error but is durable: the scan has not been acquired.
    if (line.acq_seq == job.attempt.cmd_seq) line.acq_seq = acq_before_;
    close(job.attempt.session, job.attempt.cmd_seq, static_cast<std::uint16_t>(kCommandFailed + job.code));
  }
  void remember(std::uint64_t fingerprint) {
    if (fingerprint == 0) return;
    std::erase(seen, fingerprint);
    seen.push_back(fingerprint);
    if (seen.size() > kFingerprintsKept) seen.erase(seen.begin());
    line.fingerprints = {};
    std::copy(seen.begin(), seen.end(), line.fingerprints.begin());  // oldest first
  }
  void keep(const BlockJob& job) {
    StationRecord& record = line.stations[job.block.station - 1U];
    // A later attempt replaces an earlier one, even if it failed.
    if (record.attempt.number == job.attempt && record.phase != StationPhase::failed) {
      record.phase = StationPhase::measured;
      record.block = job.block;
      record.measuring_since_ns = 0;
      close(record.attempt.session, record.attempt.cmd_seq, static_cast<std::uint16_t>(CommandStatus::done));
    }
    // Measured before, but its answer was lost: one record is enough.
    forget_records([&](const PlcResult& r) {
      return r.kind == job.record.kind && r.station == job.record.station && r.cmd_seq == job.record.cmd_seq;
    });
    queue(job.record);
  }
  void keep(const SlabJob& job) {
    line.slab_open = false;
    line.last_slab = line.slab;
    line.last_result = job.slab;
    if (!job.slab.gauges.empty()) line.gauges_used = job.slab.gauges;
    add_slab(line.gauge_runs, job.slab.gauges);
    for (std::size_t i = 0; i < line.stations.size(); ++i) {
      const StationRecord& record = line.stations[i];
      line.last_blocks[i] = {
          record.phase == StationPhase::measured && record.block.registration.status == RegistrationStatus::converged,
          stored_T_base_scanner(line.slab, record.attempt), record.block.registration.T_scanner_block};
    }
    line.table_slab_no = line.slab.slab_no;
    line.slab_verdict = job.slab.verdict;
    line.slab_emulated = line.slab.emulated;
    line.slab_record = job.record;
    close_newest(PlcCommand::slab_end, PlcCommand::slab_abort);
    ++slabs_ended;
    queue(job.record);
  }
  void keep(const AckJob& job) { forget_record(job.res_seq); }
  void keep(const ReportJob& job) {
    close_newest(PlcCommand::report);
    queue(job.record);
  }
  void keep(const SeenScanJob& job) { remember(job.fingerprint); }
  void keep(const MeasuringJob& job) {
    StationRecord& record = line.stations[job.station - 1U];
    const bool is_it = line.slab.key == job.slab_key && record.attempt.number == job.attempt;
    if (is_it && record.phase == StationPhase::acquired) record.measuring_since_ns = job.since_ns;
  }

  // ---- records ----
  void queue(const PlcResult& record) {
    line.res_seq = record.res_seq;
    (void)line.unacknowledged.push(record);
  }
  void forget_record(std::uint16_t res_seq) {
    forget_records([&](const PlcResult& record) { return record.res_seq == res_seq; });
  }
  void forget_records(const std::function<bool(const PlcResult&)>& which) {
    auto waiting = line.unacknowledged;
    line.unacknowledged.clear();
    for (; !waiting.empty(); waiting.pop())
      if (!which(waiting.front())) (void)line.unacknowledged.push(waiting.front());
  }

  CommandJob newest_;
  CommandJob newest_order_;             ///< for the open slab
  std::vector<CommandJob> unfinished_;  ///< oldest first
  std::map<std::uint8_t, CommandJob> newest_scan_;
  std::set<std::tuple<std::int64_t, std::uint8_t, std::uint8_t>> attempts_;
  std::map<std::int64_t, std::tuple<std::int64_t, std::uint8_t, std::uint8_t>> history_;  ///< by fingerprint
  std::optional<RecoveredLine> before_unseen_end_;
  std::map<std::uint8_t, BlockJob> unseen_blocks_;
  std::uint16_t unseen_report_ = 0;
  std::optional<FailedAttemptJob> unwritten_;
  std::uint16_t acq_before_ = 0;
  std::optional<CommandJob> closed_last_;  ///< by the preceding job
};

}  // namespace slabd::daemon
