// SPDX-License-Identifier: Apache-2.0
//
// Handles the answer to each store job. Ok: the record is durable and may be shown. Otherwise it is not shown and the
// fault is raised; the cloud on the disk preserves the work.
#include <algorithm>
#include <utility>

#include "base/rules.h"
#include "daemon/station/parts.h"

namespace slabd::daemon {
namespace {

/// Queues a durable record. RES_ACK may have reached its number while it was stored: that does not acknowledge it,
/// because it was not shown yet.
bool present(Station& s, const PlcResult& record, Actions& actions) {
  if (!s.results.queue.push(record)) return false;
  if (record.res_seq != s.plc.inputs.res_ack) return true;
  s.results.ack_before = record.res_seq;
  log(actions, LogLine::Level::warning, Code::bad_sequence,
      "RES_ACK was %u before record %u was shown: the record waits until RES_ACK has had another value; the PLC "
      "must copy RES_SEQ, not count",
      record.res_seq, record.res_seq);
  return true;
}

void on_session(Station& s, const PendingStore& pending, Code code, Actions& actions) {
  if (code != Code::ok) {
    raise_fault(s, actions, code, "recording the session");
    return;
  }
  if (pending.value == s.command.session_next) s.command.session = s.command.session_next;
}

void on_command(Station& s, const PendingStore& pending, Code code, Actions& actions) {
  s.command.pending = false;
  if (code == Code::ok) {
    if (pending.kind == PendingStore::Kind::begin_slab) s.warn &= static_cast<std::uint16_t>(~kWarnDiskLow);
    begin_command(s, actions);
    return;
  }
  // Refused after all: the number is used up, so that the PLC reads the answer.
  s.command.ack = pending.value;
  set_failed(s, pending.value, code);
  s.command.refuse_code = static_cast<std::uint16_t>(code);
  s.command.refuse_seq = pending.value;
  ++s.command.refused;
  if (static_cast<PlcCommand>(s.command.pending_inputs.command) == PlcCommand::slab_end) freeze_gauges(s, actions);
  if (code == Code::store_full) {
    s.warn |= kWarnDiskLow;
    log(actions, LogLine::Level::error, code, "command refused: %.*s; %.*s", static_cast<int>(describe(code).size()),
        describe(code).data(), static_cast<int>(cure(code).size()), cure(code).data());
  } else {
    raise_fault(s, actions, code, "recording a command");
  }
}

void on_block(Station& s, const PendingStore& pending, Code code, Actions& actions) {
  StationRecord& record = s.slab.stations[pending.station - 1U];
  s.station_measuring[pending.station - 1U] = false;
  --s.measuring;
  if (code != Code::ok) {
    // The cloud is durable: the block stays "acquired" and is measured again after FAULT_RESET or a restart.
    raise_fault(s, actions, code, "recording a block");
    return;
  }
  if (record.phase == StationPhase::acquired && record.attempt.number == pending.attempt) {
    record.phase = StationPhase::measured;
    set_status(s, pending.value, CommandStatus::done);
  }
  const bool queued = present(s, pending.record, actions);
  assert(queued);  // check_scan() kept room
  (void)queued;
}

/// Logs stops that look alike when this first occurs: it depends on the robot's program and does not change between
/// slabs.
void warn_of_alike_stops(Station& s, Actions& actions) {
  const int station = stop_like_the_next(s.views.slab);
  if (std::exchange(s.stop_alike, station) != 0 || station == 0) return;
  log(actions, LogLine::Level::warning, Code::ok,
      "the robot views the block of station %d from the same pose as the next one: their scans could be mistaken for "
      "each "
      "other and the pose would not show it; slabctl stations plans stops that differ (docs/SCAN_CHECKS.md)",
      station);
}

void on_slab(Station& s, const PendingStore& pending, Code code, Actions& actions) {
  if (holds(Rule::result_after_commit) && code != Code::ok) {
    raise_fault(s, actions, code, "recording the slab");
    set_failed(s, pending.value, code);
    s.slab.phase = SlabPhase::open;  // SLAB_END or SLAB_ABORT may be given again
    s.slab.aborting = false;
    return;
  }
  const SlabResult& result = s.slab.result;
  ResultState& shown = s.results;
  for (std::size_t i = 0; i < shown.table.size(); ++i) {
    const StationRecord& record = s.slab.stations[i];
    PlcStationRow& row = shown.table[i];
    row = {};
    row.attempts = record.attempts;
    row.verdict = result.station_verdict[i];
    row.reason = result.station_reason[i];
  }
  shown.slab_verdict = result.verdict;
  shown.slab_reason = result.reason;
  shown.slab_no = s.slab.header.slab_no;
  shown.slab_emulated = s.slab.header.emulated;
  shown.slab_record = pending.record;
  const bool queued = present(s, pending.record, actions);
  assert(queued);
  (void)queued;
  log(actions, LogLine::Level::info, Code::ok, "slab %u \"%s\": %s (reason %u)", s.slab.header.slab_no,
      s.slab.header.slab_id.c_str(), name(result.verdict).data(), result.reason);
  s.newest_time.note(s.utime_us);
  warn_of_alike_stops(s, actions);
  note_used_gauges(s, result, actions);
  s.slab.phase = SlabPhase::none;
  set_status(s, pending.value, CommandStatus::done);
}

void on_report(Station& s, const PendingStore& pending, Code code, Actions& actions) {
  if (code != Code::ok) {
    raise_fault(s, actions, code, "recording a repeated result");
    set_failed(s, pending.value, code);
    return;
  }
  if (!present(s, pending.record, actions)) {
    set_failed(s, pending.value, Code::busy);
    return;
  }
  set_status(s, pending.value, CommandStatus::done);
}

}  // namespace

void store_acknowledgement(Station& s, std::uint16_t res_seq, Actions& actions) {
  PendingStore pending;
  pending.kind = PendingStore::Kind::ack;
  pending.value = res_seq;
  submit(s, actions, AckJob{res_seq}, pending);
}

/// Stores fingerprints and acknowledgements that a disk failure prevented. After a restart all scans of the scanner
/// must be known. A record without a durable acknowledgement would keep its slab's scans permanently.
static void settle_unsaved(Station& s, const PendingStore& pending, Code code, Actions& actions) {
  auto& fingerprints = s.unsaved_fingerprints;
  auto& acks = s.unsaved_acks;
  if (code != Code::ok) {
    const bool known = std::find(fingerprints.begin(), fingerprints.end(), pending.fingerprint) != fingerprints.end();
    if (pending.fingerprint != 0 && !known) (void)fingerprints.push(pending.fingerprint);
    if (pending.kind == PendingStore::Kind::ack) (void)acks.push(pending.value);
    return;
  }
  // One for each success, so that there is always room for it.
  // While a scan is unseen its mark must be the newest, because a restart finds it that way; the others wait.
  // Afterwards the newest is stored first, which is the one that replaced the mark.
  const auto last = fingerprints.empty() ? fingerprints.end() : fingerprints.end() - 1;
  const auto next = any_scan_unseen(s) ? std::find(fingerprints.begin(), fingerprints.end(), kUnseenScan) : last;
  if (next != fingerprints.end()) {
    const std::uint64_t fingerprint = *next;
    fingerprints.erase(static_cast<std::size_t>(next - fingerprints.begin()));
    store_fingerprint(s, fingerprint, actions);
  } else if (!acks.empty()) {
    const std::uint16_t res_seq = acks[0];
    acks.erase(0);
    store_acknowledgement(s, res_seq, actions);
  }
}

void on_stored(Station& s, const StoreDone& done, Actions& actions) {
  if (done.ticket == kNoJobTicket) {
    if (done.code != Code::ok && s.fault == 0) raise_fault(s, actions, done.code, "looking after the database");
    return;
  }
  const PendingStore* const found = std::find_if(
      s.storing.begin(), s.storing.end(), [&](const PendingStore& pending) { return pending.ticket == done.ticket; });
  if (found == s.storing.end()) return;
  const PendingStore pending = *found;
  s.storing.erase(static_cast<std::size_t>(found - s.storing.begin()));

  // A scan found in the history is recorded as a failed one: the disk works.
  const bool is_known_scan = pending.kind == PendingStore::Kind::acquired && done.code == Code::frame_incomplete;
  settle_unsaved(s, pending, is_known_scan ? Code::ok : done.code, actions);
  switch (pending.kind) {
    case PendingStore::Kind::session: on_session(s, pending, done.code, actions); break;
    case PendingStore::Kind::begin_slab:
    case PendingStore::Kind::command: on_command(s, pending, done.code, actions); break;
    case PendingStore::Kind::acquired: on_acquired_stored(s, pending, done.code, actions); break;
    case PendingStore::Kind::block: on_block(s, pending, done.code, actions); break;
    case PendingStore::Kind::slab: on_slab(s, pending, done.code, actions); break;
    case PendingStore::Kind::measuring: on_measuring_stored(s, pending, done.code, actions); break;
    case PendingStore::Kind::report: on_report(s, pending, done.code, actions); break;
    case PendingStore::Kind::failed_attempt:
      if (done.code != Code::ok) raise_fault(s, actions, done.code, "recording a failed scan");
      break;
    case PendingStore::Kind::seen_scan:
      on_view_marked(s, done.ticket, done.code, actions);
      if (done.code != Code::ok) raise_fault(s, actions, done.code, "remembering what the scanner gave");
      break;
    case PendingStore::Kind::ack:
      // If slabd ends before it is durable, the PLC sees this record again and recognises it.
      if (done.code != Code::ok) raise_fault(s, actions, done.code, "recording an acknowledgement");
      break;
  }
}

}  // namespace slabd::daemon
