// SPDX-License-Identifier: Apache-2.0
//
// One request to the scanner, from its buffer to the answer of the scanner's worker. At most one is in progress: for a
// block, for a scan that is discarded first, or for a view of a calibration. With several arms each scanner has a
// worker of its own, so that one that hangs stops only its own arm.
#include <algorithm>
#include <utility>

#include "base/jobs.h"
#include "base/rules.h"
#include "daemon/station/parts.h"

namespace slabd::daemon {

int free_slot(const Station& s) {
  for (std::size_t slot = 0; slot < limits::scan_slots(arm_count(s)); ++slot)
    if (!s.slot_busy[slot] || !holds(Rule::buffer_kept_while_measured)) return static_cast<int>(slot);
  return -1;
}

std::uint16_t next_own_request(Station& s) {
  if (s.own_request == 0) s.own_request = static_cast<std::uint16_t>(s.utime_us / 1'000'000 % 60'000 + 1);
  return s.own_request = next_sequence(s.own_request);
}

void ask_scanner(Station& s, Exposure& e, std::uint8_t arm, int slot, const ScanRequest& request, Actions& actions) {
  e = {};
  e.arm = arm;
  e.cmd_seq = request.cmd_seq;
  e.slot = static_cast<std::uint8_t>(slot);
  e.slot_taken = true;
  s.slot_busy[e.slot] = true;
  emit(actions, AcquireScan{request, e.slot, e.arm});
}

void give_back(Station& s, Exposure& e) {
  if (e.slot_taken) s.slot_busy[e.slot] = false;
  e.slot_taken = false;
}

void break_off(Exposure& e, Actions& actions) {
  e.abort = true;
  emit(actions, CancelScan{e.arm});
}

// ---- a worker that hangs ----

bool give_up_when_worker_hangs(Station& s, Exposure& e, std::int64_t since_ns, std::int64_t patience_ns,
                               Actions& actions) {
  StationArm& arm = s.arms[e.arm];
  if (!arm.links.scanner_hangs || (!e.abort && s.now_ns - since_ns < patience_ns)) return false;
  arm.abandoned = {true, e.slot_taken, e.slot};
  e.slot_taken = false;
  emit(actions, CancelScan{e.arm});
  log(actions, LogLine::Level::error, code_of_hang(s, e.arm),
      "%s%s; no further scan is requested until it responds again", why_it_hangs(s, e.arm),
      arm_words(s, e.arm).c_str());
  return true;
}

Code code_of_hang(const Station& s, std::size_t arm) {
  return s.arms[arm].links.spool_hangs ? Code::journal_write : Code::scanner_offline;
}
const char* why_it_hangs(const Station& s, std::size_t arm) {
  return s.arms[arm].links.spool_hangs
             ? "the scanner's worker hangs while it stores a scan: look at the disk of the spool"
             : "the scanner's worker hangs, most likely in a network share or while it copies from there to the spool";
}

// ---- points that were received before ----

static bool is_known(const Station& s, std::uint64_t fingerprint) {
  return std::find(s.fingerprints.begin(), s.fingerprints.end(), fingerprint) != s.fingerprints.end();
}
static void remember(Station& s, std::uint64_t fingerprint) {
  s.fingerprints[s.fingerprint_next] = fingerprint;
  s.fingerprint_next = (s.fingerprint_next + 1) % s.fingerprints.size();
}
/// While a scan is unseen its mark stays the newest entry; other fingerprints are written to the disk afterwards.
static void hold_back(Station& s, std::uint64_t fingerprint) {
  auto& waiting = s.unsaved_fingerprints;
  if (std::find(waiting.begin(), waiting.end(), fingerprint) == waiting.end()) (void)waiting.push(fingerprint);
}
/// Makes a repeated fingerprint the newest, so that it is not forgotten as long as the scanner repeats it.
static void renew(Station& s, std::uint64_t fingerprint, Actions& actions) {
  auto& ring = s.fingerprints;
  const auto newest_first = [&](std::size_t back) -> std::uint64_t& {
    return ring[(s.fingerprint_next + ring.size() - 1 - back) % ring.size()];
  };
  std::uint64_t moved = fingerprint;
  for (std::size_t back = 0; back < ring.size(); ++back) {
    std::swap(newest_first(back), moved);
    if (moved == fingerprint) break;  // its former place
  }
  if (any_scan_unseen(s))
    hold_back(s, fingerprint);
  else
    store_fingerprint(s, fingerprint, actions);
}

bool is_repeated(Station& s, std::uint64_t fingerprint, Actions& actions) {
  if (fingerprint == 0) return false;
  if (holds(Rule::scan_new) && is_known(s, fingerprint)) {
    renew(s, fingerprint, actions);  // this is not the unseen scan
    return true;
  }
  remember(s, fingerprint);
  return false;
}

bool was_seen(Station& s, const ScanDone& done, Actions& actions) {
  if (done.code != Code::ok || done.fingerprint == 0) return false;
  if (is_repeated(s, done.fingerprint, actions)) return true;
  store_fingerprint(s, done.fingerprint, actions);
  return false;
}

void store_fingerprint(Station& s, std::uint64_t fingerprint, Actions& actions) {
  PendingStore pending;
  pending.kind = PendingStore::Kind::seen_scan;
  pending.fingerprint = fingerprint;
  submit(s, actions, SeenScanJob{fingerprint}, pending);
}

// ---- answers ----

/// The worker received no other request meanwhile, so its answer belongs to the scan that was given up.
static void on_abandoned(Station& s, const ScanDone& done, Actions& actions) {
  StationArm& arm = s.arms[done.arm];
  const bool repeated = was_seen(s, done, actions);
  if (done.code == Code::ok && done.fingerprint != 0 && !repeated) arm.scan_unseen = false;
  if (!done.durable) return;
  if (done.code == Code::ok) emit(actions, DropScan{done.scan.path});
  if (arm.abandoned.slot_taken) s.slot_busy[arm.abandoned.slot] = false;
  arm.abandoned = {};
  log(actions, LogLine::Level::info, Code::ok, "the scanner's worker responds again%s; the abandoned scan is discarded",
      arm_words(s, done.arm).c_str());
}

/// A scan that no exposure awaits: only its points are remembered.
static void on_stray(Station& s, const ScanDone& done, Actions& actions) {
  if (!any_scan_unseen(s)) {
    (void)was_seen(s, done, actions);
  } else if (done.code == Code::ok && done.fingerprint != 0) {
    if (!is_known(s, done.fingerprint)) remember(s, done.fingerprint);
    hold_back(s, done.fingerprint);
  }
}

void on_scan_done(Station& s, const ScanDone& done, Actions& actions) {
  // The buffer identifies the scan as well as the number, because numbers restart with each session.
  const auto answers = [&](const Exposure& e) {
    return done.arm == e.arm && done.cmd_seq == e.cmd_seq && done.slot == e.slot;
  };
  const Acquisition& a = s.acquisition;
  const Capture& c = s.capture;
  assert(done.arm < s.arms.size());
  if (s.arms[done.arm].abandoned.waits)
    on_abandoned(s, done, actions);
  else if (a.phase == Acquisition::Phase::clearing && answers(a.exposure))
    on_cleared(s, done, actions);
  else if (a.phase == Acquisition::Phase::scanning && answers(a.exposure))
    on_block_scanned(s, done, actions);
  else if (c.phase == Capture::Phase::scanning && answers(c.exposure))
    on_view_scanned(s, done, actions);
  else
    on_stray(s, done, actions);
}

}  // namespace slabd::daemon
