// SPDX-License-Identifier: Apache-2.0
#include "tests/sim/promises.h"

#include <sqlite3.h>

#include "tests/sim/allocation.h"

namespace slabd::sim {
namespace {

Verdict verdict_from(std::string_view word) {
  for (const Verdict v :
       {Verdict::pass, Verdict::fail, Verdict::not_measured, Verdict::aborted, Verdict::indeterminate})
    if (name(v) == word) return v;
  return Verdict::none;
}

/// A separate reader, so that slabd's storage is not checked by its own code.
class Rows {
 public:
  Rows(sqlite3* db, const char* sql) {
    if (sqlite3_prepare_v2(db, sql, -1, &statement_, nullptr) != SQLITE_OK) statement_ = nullptr;
  }
  ~Rows() { sqlite3_finalize(statement_); }
  Rows(const Rows&) = delete;
  Rows& operator=(const Rows&) = delete;
  [[nodiscard]] bool usable() const { return statement_ != nullptr; }
  [[nodiscard]] bool next() { return sqlite3_step(statement_) == SQLITE_ROW; }
  [[nodiscard]] std::int64_t number(int column) const { return sqlite3_column_int64(statement_, column); }
  [[nodiscard]] std::string text(int column) const {
    return reinterpret_cast<const char*>(sqlite3_column_text(statement_, column));
  }

 private:
  sqlite3_stmt* statement_ = nullptr;
};

}  // namespace

Promises::Record Promises::record_of(std::int64_t slab_key, const PlcResult& record) {
  return {slab_key, record.kind, record.station, record.cmd_seq, record.slab_no, record.verdict, false};
}

// ---- the database ------------------------------------------------------------------------------------------------

void Promises::committed(const StoreJob& job) {
  const heap::Aside aside;
  ++world_.totals.commits;
  if (const auto* session = std::get_if<SessionJob>(&job.what)) {
    session_stored_ = session->session;
  } else if (const auto* begin = std::get_if<BeginSlabJob>(&job.what)) {
    slab_nos_[begin->slab.key] = begin->slab.slab_no;
    if (line_.slab.slab_no == begin->slab.slab_no) placements_[begin->slab.key] = line_.slab.serial;
    ++world_.totals.slabs_begun;
  } else if (const auto* command = std::get_if<CommandJob>(&job.what)) {
    if (command->command == static_cast<std::uint16_t>(PlcCommand::scan))
      asked_[{command->slab_key, command->station}] = command->cmd_seq;
  } else if (const auto* acquired = std::get_if<AcquiredJob>(&job.what)) {
    const Attempt& a = acquired->attempt;
    acquired_[{a.slab_key, a.station, a.number}] = std::string(a.scan_path.view());
    if (const auto at = asked_.find({a.slab_key, a.station}); at != asked_.end() && at->second == a.cmd_seq)
      asked_.erase(at);
    acquired_commands_.insert(a.cmd_seq);
  } else if (const auto* block = std::get_if<BlockJob>(&job.what)) {
    records_[block->record.res_seq] = record_of(block->slab_key, block->record);
    if (block->record.verdict != Verdict::not_measured &&
        line_.refused.contains({block->slab_key, block->block.station, block->attempt}))
      world_.violated("block %d of slab %u has a result from a scan that was refused", block->block.station,
                      block->record.slab_no);
    if (block->record.verdict == Verdict::pass) check_block(*block);
  } else if (const auto* slab = std::get_if<SlabJob>(&job.what)) {
    if (const auto known = slabs_.find(slab->slab_key); known != slabs_.end() && known->second != slab->slab.verdict)
      world_.violated("slab %lld has had two verdicts", static_cast<long long>(slab->slab_key));
    records_[slab->record.res_seq] = record_of(slab->slab_key, slab->record);
    slabs_[slab->slab_key] = slab->slab.verdict;
    ++world_.totals.slabs_judged;
    world_.trace.line(world_.now_ns, "database: slab %u ends with %s, reason %u", slab->record.slab_no,
                      name(slab->slab.verdict).data(), slab->slab.reason);
    if (slab->slab.verdict == Verdict::pass) {
      ++world_.totals.passes;
      int station = 0;
      if (const char* why = why_no_pass(slab->slab_key, station)) {
        ++world_.totals.wrong_passes;
        world_.violated("slab %u passes, but station %d %s", slab->record.slab_no, station, why);
      }
    }
  } else if (const auto* ack = std::get_if<AckJob>(&job.what)) {
    const auto at = records_.find(ack->res_seq);
    if (at != records_.end()) at->second.acknowledged = true;
  } else if (const auto* report = std::get_if<ReportJob>(&job.what)) {
    records_[report->record.res_seq] = record_of(0, report->record);
  }
}

void Promises::doubtful(const StoreJob& job) {
  const heap::Aside aside;
  // A job repeated after an error answer replaces its first result: the record that is shown is the second one.
  if (const auto* block = std::get_if<BlockJob>(&job.what)) {
    records_.erase(block->record.res_seq);
    doubtful_records_[block->record.res_seq] = record_of(block->slab_key, block->record);
  }
  if (const auto* slab = std::get_if<SlabJob>(&job.what)) {
    records_.erase(slab->record.res_seq);
    doubtful_records_[slab->record.res_seq] = record_of(slab->slab_key, slab->record);
  }
  if (const auto* acquired = std::get_if<AcquiredJob>(&job.what)) {
    const Attempt& a = acquired->attempt;
    doubtful_scans_[a.cmd_seq] = {{a.slab_key, a.station, a.number}, std::string(a.scan_path.view())};
  }
}

const char* Promises::why_no_scan(const std::string& path, std::uint32_t serial, int station) const {
  const ScanTruth shown = line_.in_spool(path);
  if (shown.take == 0) return "has no scan in the spool";
  if (shown.serial != serial) return "was scanned on another slab";
  if (shown.block != station) return "was not what the scanner saw";
  if (shown.smeared) return "was scanned by a moving robot";
  if (shown.mostly_nan) return "was hardly seen";
  return nullptr;
}

/// Checks a block long before its slab passes, whether or not the slab's other blocks are good.
void Promises::check_block(const BlockJob& job) {
  const auto placement = placements_.find(job.slab_key);
  const auto scan = acquired_.find({job.slab_key, job.block.station, job.attempt});
  if (placement == placements_.end() || scan == acquired_.end()) return;  // committed, but answered with an error
  ++world_.totals.blocks_passed;
  if (const char* why = why_no_scan(scan->second, placement->second, job.block.station))
    world_.violated("block %d of slab %u passes, but it %s", job.block.station, job.record.slab_no, why);
}

const char* Promises::why_no_pass(std::int64_t slab_key, int& station) const {
  const SlabTruth& slab = line_.slab;
  const auto no = slab_nos_.find(slab_key);
  if (slab.serial == 0 || no == slab_nos_.end() || no->second != slab.slab_no) return "0: another slab lies there";
  for (station = 1; station <= slab.recipe->stations(); ++station) {
    if (asked_.contains({slab_key, station})) return "was to be scanned again, which came to nothing";
    // The last durable attempt counts.
    const auto after = acquired_.upper_bound({slab_key, station, 255});
    if (after == acquired_.begin()) return "was never scanned";
    const auto& [key, path] = *std::prev(after);
    if (std::get<0>(key) != slab_key || std::get<1>(key) != station) return "was never scanned";
    if (const char* why = why_no_scan(path, slab.serial, station)) return why;
    if (line_.in_spool(path).exposed_ns < slab.placed_ns) return "was scanned before the slab was laid down";
    if (!is_good(slab.blocks[static_cast<std::size_t>(station - 1)])) return "is not good";
  }
  return nullptr;
}

void Promises::check_rows(const char* db_path) {
  const heap::Aside aside;
  sqlite3* db = nullptr;
  if (sqlite3_open_v2(db_path, &db, SQLITE_OPEN_READONLY, nullptr) != SQLITE_OK) {
    sqlite3_close(db);
    return;  // the disk fails at the moment: the next start checks again
  }
  std::map<std::uint16_t, Record> there;
  std::map<std::int64_t, Verdict> ended;
  std::map<std::int64_t, std::uint32_t> numbers;
  std::set<AttemptKey> attempts;
  bool whole = true;
  {
    Rows slabs(db, "SELECT slab_key, slab_no FROM slab");
    while (slabs.usable() && slabs.next()) numbers[slabs.number(0)] = static_cast<std::uint32_t>(slabs.number(1));
    Rows rows(
        db, "SELECT res_seq, slab_key, kind, station, cmd_seq, slab_no, verdict, acknowledged, is_repeat FROM result");
    while (rows.usable() && rows.next()) {
      Record r;
      r.slab_key = rows.number(8) != 0 ? 0 : rows.number(1);
      r.kind = static_cast<std::uint16_t>(rows.number(2));
      r.station = static_cast<std::uint16_t>(rows.number(3));
      r.cmd_seq = static_cast<std::uint16_t>(rows.number(4));
      r.slab_no = static_cast<std::uint32_t>(rows.number(5));
      r.verdict = verdict_from(rows.text(6));
      r.acknowledged = rows.number(7) != 0;
      there[static_cast<std::uint16_t>(rows.number(0))] = r;
    }
    Rows ends(db, "SELECT slab_key, verdict FROM slab_result");
    while (ends.usable() && ends.next()) ended[ends.number(0)] = verdict_from(ends.text(1));
    Rows scans(db, "SELECT slab_key, station, attempt, scan_path, cmd_seq FROM attempt WHERE phase <> 'failed'");
    while (scans.usable() && scans.next()) {
      const AttemptKey key{scans.number(0), static_cast<int>(scans.number(1)), static_cast<int>(scans.number(2))};
      attempts.insert(key);
      const auto command = static_cast<std::uint16_t>(scans.number(4));
      acquired_commands_.insert(command);
      // A scan whose commit was answered with an error becomes a failed one, unless a start finds it before.
      const auto doubtful = doubtful_scans_.find(command);
      if (doubtful == doubtful_scans_.end() || doubtful->second.first != key) acquired_.try_emplace(key, scans.text(3));
    }
    // A failing disk may end any of these queries early.
    whole = slabs.usable() && rows.usable() && ends.usable() && scans.usable() && sqlite3_errcode(db) == SQLITE_DONE;
    whole = whole || sqlite3_errcode(db) == SQLITE_OK;
  }
  sqlite3_close(db);
  if (!whole || world_.faulty(Fault::disk_eio)) return;
  world_.totals.rows_checked += records_.size() + acquired_.size() + slabs_.size();
  for (const auto& [seq, record] : records_) {
    const auto at = there.find(seq);
    Record found = at == there.end() ? Record{} : at->second;
    const bool forgot_ack = record.acknowledged && !found.acknowledged;
    found.acknowledged = record.acknowledged;
    if (found == record && !forgot_ack) continue;
    ++world_.totals.lost_rows;
    world_.violated("record %u (slab %u, station %u, %s) was committed and is %s", seq, record.slab_no, record.station,
                    name(record.verdict).data(), forgot_ack ? "not acknowledged any more" : "not there");
  }
  for (const auto& [key, verdict] : slabs_)
    if (!ended.contains(key) || ended[key] != verdict) {
      ++world_.totals.lost_rows;
      world_.violated("the end of slab %lld was committed and is not there", static_cast<long long>(key));
    }
  for (const auto& [key, path] : acquired_)
    if (!attempts.contains(key)) {
      ++world_.totals.lost_rows;
      world_.violated("scan %d of station %d was committed and is not there", std::get<2>(key), std::get<1>(key));
    }
  records_ = there;
  slabs_ = ended;
  slab_nos_ = numbers;
}

void Promises::recovered(const RecoveredLine& line) {
  const heap::Aside aside;
  // A commit that was answered with an error, or not at all, may still be in the database; the disk may hide it from
  // check_rows().
  if (const auto at = doubtful_scans_.find(line.acq_seq); at != doubtful_scans_.end()) {
    acquired_commands_.insert(at->first);
    acquired_.insert(at->second);
    const auto& [slab_key, station, number] = at->second.first;
    if (const auto asked = asked_.find({slab_key, station}); asked != asked_.end() && asked->second == at->first)
      asked_.erase(asked);
  }
  doubtful_scans_.clear();
  for (auto found = line.unacknowledged; !found.empty(); found.pop())
    if (const auto at = doubtful_records_.find(found.front().res_seq); at != doubtful_records_.end())
      records_.insert(*at);
  doubtful_records_.clear();
  if (line.slab_open) slab_nos_[line.slab.key] = line.slab.slab_no;
  if (line.session != session_stored_ && sessions_.contains(line.session) && session_stored_ != 0 &&
      static_cast<std::int16_t>(line.session - session_stored_) < 0)
    world_.violated("session %u was committed, and %u was found", session_stored_, line.session);
  session_stored_ = line.session;
  has_store_ = true;
}

// ---- the wire ----------------------------------------------------------------------------------------------------

void Promises::shown(const PlcOutputs& out) {
  if (!has_store_ || out.state == PlcState::recover) {
    if (out.slab_verdict != Verdict::none || out.record.res_seq != 0)
      world_.violated("something is shown that no database holds");
    fresh_process_ = true;
    return;
  }
  // Commands refused on their content are counted and not stored: a new process may start with a lower number.
  if (fresh_process_) last_.cmd_ack = out.cmd_ack;
  if (out.session != last_.session && out.session != 0) {
    if (!sessions_.insert(out.session).second) world_.violated("session %u was used before", out.session);
    if (out.session != session_stored_) world_.violated("session %u is shown and not stored", out.session);
  }
  if (out.cmd_ack != last_.cmd_ack && out.cmd_ack != next_sequence(last_.cmd_ack))
    world_.violated("CMD_ACK went from %u to %u", last_.cmd_ack, out.cmd_ack);
  if (out.acq_seq != last_.acq_seq && out.acq_seq != 0 && !acquired_commands_.contains(out.acq_seq))
    world_.violated("ACQ_SEQ %u is shown and not committed", out.acq_seq);
  const PlcResult& r = out.record;
  if (r.res_seq != 0 && (r.res_seq != last_.record.res_seq || r.verdict != last_.record.verdict)) {
    const auto stored = records_.find(r.res_seq);
    if (stored == records_.end() || stored->second.verdict != r.verdict || stored->second.slab_no != r.slab_no ||
        stored->second.station != r.station)
      world_.violated("record %u (slab %u, station %u, %s) is shown and not committed", r.res_seq, r.slab_no, r.station,
                      name(r.verdict).data());
    Record as_shown = record_of(0, r);
    const auto [at, added] = shown_records_.try_emplace(r.res_seq, as_shown);
    if (!added && !(at->second == as_shown)) world_.violated("record %u has changed since it was shown", r.res_seq);
  }
  if (out.slab_verdict == Verdict::pass) {
    if (out.slab_open) world_.violated("SLAB_VERDICT is pass while slab %u is open", out.slab_no);
    const auto end = slabs_.empty() ? slabs_.end() : std::prev(slabs_.end());
    if (end == slabs_.end() || end->second != Verdict::pass || slab_nos_[end->first] != out.table_slab_no)
      world_.violated("SLAB_VERDICT is pass, and the last slab that ended did not");
  }
  fresh_process_ = false;
  last_ = out;
}

void Promises::decided(const Decision& decision) {
  world_.trace.line(world_.now_ns, "PLC: slab %u leaves as %s", decision.slab_no, name(decision.verdict).data());
  if (decision.verdict != Verdict::pass) return;
  ++world_.totals.passes_taken;
  std::int64_t key = 0;
  for (const auto& [slab_key, no] : slab_nos_)
    if (no == decision.slab_no) key = slab_key;
  int station = 0;
  const char* why = why_no_pass(key, station);
  if (why == nullptr && (!slabs_.contains(key) || slabs_[key] != Verdict::pass))
    why = "of the newest inspection did not pass";
  if (why == nullptr) return;
  ++world_.totals.wrong_passes;
  world_.violated("slab %u leaves as passed, but station %d %s", decision.slab_no, station, why);
}

// ---- observing the store -------------------------------------------------------------------------------------

Result<std::unique_ptr<RecoveredLine>> OverheardStore::recover() {
  auto line = store_->recover();
  if (!process_.dead() && line.ok()) {
    promises_.recovered(*line.value());
    promises_.check_rows(db_path_);
  }
  return line;
}

Status OverheardStore::apply(const StoreJob& job) {
  Status status = store_->apply(job);
  if (!process_.dead() && status.ok())
    promises_.committed(job);
  else
    promises_.doubtful(job);
  return status;
}

}  // namespace slabd::sim
