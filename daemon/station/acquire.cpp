// SPDX-License-Identifier: Apache-2.0
//
// One SCAN: settle -> request the scan -> the robot must not have moved -> cloud and pose durable -> "robot may leave"
// -> measure -> commit -> result. Up to "durable" there is one acquisition at a time. After that the block only
// occupies a buffer while the next acquisition may begin.
//
// Measuring starts as soon as points and pose are available, usually while the scan is still being written to the disk.
// A durable scan waits up to half a second for its measurement. So a scan that measuring refuses ends as a failed SCAN
// while the robot is still at the station. The result of a longer measurement comes after "acquired". If the scan
// fails, its measurement is dropped, and its answer only releases the buffer.
#include <algorithm>
#include <cmath>
#include <utility>

#include "base/jobs.h"
#include "base/rules.h"
#include "daemon/station/parts.h"

namespace slabd::daemon {
namespace {

/// Time that a durable scan waits for its measurement, counted from the start of the measurement. A scan that measuring
/// refuses then fails while the robot is still at the station. Measuring takes 20 to 50 ms and the disk mostly longer,
/// so usually this costs no time. After that time the scan is acquired, and a refusal becomes the block's result.
constexpr std::int64_t kRefusalWait_ns = kNsPerS / 2;

/// Not a buffer: for a result without a measurement.
constexpr std::uint8_t kNoSlot = 0xFF;

/// The PLC waits 20 s for "acquired". After this time a scanner's worker that hangs is given up.
constexpr std::int64_t kHangTimeout_ns = 19 * kNsPerS + kNsPerS / 2;

StationRecord& record_of(Station& s, std::uint8_t station) {
  return s.slab.stations[station - 1U];
}

/// Checks that the block's nominal centre is near the scanner's axis and in front of it. Detects a wrong station, a
/// wrong robot program and a slab that is not at its configured place.
Code looks_at_station(const Station& s, std::size_t arm, const Pose& T_base_flange, double& off_axis_mm) {
  const Pose T_base_scanner = in_base_frame(s, arm, T_base_flange) * T_flange_scanner_of(s.slab.header, arm);
  const Pose T_base_block =
      s.slab.header.T_base_slab * T_slab_block(*s.slab.recipe, s.slab.facts.design, s.acquisition.station);
  const Vec3 p_scanner = T_base_scanner.inverse() * T_base_block.translation_mm;
  off_axis_mm = std::hypot(p_scanner.x(), p_scanner.y());
  return off_axis_mm <= s.settings.arm(arm).pose.look_mm && p_scanner.z() > 0.0 ? Code::ok : Code::outside_window;
}

/// The arm that scans the station. Of several that may, it is the one whose robot looks at the block now, because the
/// PLC decides by the robot that it moves there. If both or none do, it is the usual one.
std::uint8_t arm_to_scan(const Station& s) {
  const ArmChoice& choice = s.settings.arms.of_station[s.acquisition.station - 1U];
  const auto looks = [&s](std::uint8_t arm) {
    double off_axis_mm = 0.0;
    const PoseGate& gate = s.arms[arm].gate;
    return can_scan(s, arm) && gate.link(s.now_ns) == Code::ok &&
           looks_at_station(s, arm, gate.newest()->T_base_flange, off_axis_mm) == Code::ok;
  };
  if (choice.size() > 1) {
    for (const std::uint8_t arm : choice)
      if (looks(arm)) return arm;
    for (const std::uint8_t arm : choice)
      if (can_scan(s, arm)) return arm;
  }
  return choice.empty() ? std::uint8_t{0} : choice[0];
}

void use_arm(Station& s, std::uint8_t arm) {
  s.acquisition.attempt.arm = arm;
  s.acquisition.attempt.by = s.settings.arms.list[arm];
}

StationArm& arm_of(Station& s) {
  return s.arms[s.acquisition.attempt.arm];
}

const StationArmSettings& settings_of_arm(const Station& s) {
  return s.settings.arm(s.acquisition.attempt.arm);
}

std::int64_t time_left_ns(const Station& s) {
  return s.acquisition.started_ns + kHangTimeout_ns - s.now_ns;
}

ScanRequest scan_to_ask(const Station& s) {
  const Acquisition& a = s.acquisition;
  ScanRequest request;
  request.session = a.session;
  request.cmd_seq = a.cmd_seq;
  request.slab_id = s.slab.header.slab_id;
  request.station = a.station;
  // Less than the allowed time only if another scan was taken first.
  request.timeout_ns = std::clamp(time_left_ns(s), kNsPerMs, settings_of_arm(s).scan_timeout_ns);
  if (s.settings.arms.several()) request.by = a.attempt.by;
  request.spool_path.printf("%s/%lld/%02u-%u", s.settings.spool_dir.c_str(), static_cast<long long>(s.slab.header.key),
                            a.station, a.attempt.number);
  return request;
}

/// After a discarded scan: true if there is time for one that takes as long, plus half a second. A request without time
/// would also end in a discarded scan, and a slow scanner would never reach the block's own.
bool time_for_another(const Station& s) {
  const std::int64_t took_ns = s.acquisition.cleared_in_ns;
  return took_ns == 0 || time_left_ns(s) >= std::min(settings_of_arm(s).scan_timeout_ns, took_ns + kNsPerS / 2);
}

/// Requests a scan that is discarded; after it the scanner cannot hold an unknown scan.
void clear_scanner(Station& s, int slot, Actions& actions) {
  s.acquisition.phase = Acquisition::Phase::clearing;
  s.acquisition.clearing_since_ns = s.now_ns;
  ScanRequest request = scan_to_ask(s);
  request.session = 0;
  request.cmd_seq = next_own_request(s);
  request.spool_path.append("-unseen");
  ask_scanner(s, s.acquisition.exposure, s.acquisition.attempt.arm, slot, request, actions);
  log(actions, LogLine::Level::info, Code::ok,
      "station %u%s: a scan was requested before, and its points were not received; one more scan is taken first and "
      "discarded, so that the old one cannot be delivered for this block",
      s.acquisition.station, arm_words(s, s.acquisition.attempt.arm).c_str());
}

void try_to_trigger(Station& s, Actions& actions) {
  Acquisition& a = s.acquisition;
  use_arm(s, arm_to_scan(s));
  StationArm& arm = arm_of(s);
  PoseMean mean;
  double off_axis_mm = 0.0;
  Code code = arm.gate.settled(s.now_ns, mean);
  // A SCAN may come before the robot has left the last station, so a wrong position is not yet an error.
  if (code == Code::ok) code = looks_at_station(s, a.attempt.arm, mean.T_base_flange, off_axis_mm);
  const int slot = free_slot(s);
  if (code == Code::ok && (arm.abandoned.waits || arm.links.scanner_hangs)) code = code_of_hang(s, a.attempt.arm);
  if (code == Code::ok && slot < 0) code = Code::deadline;
  if (code != Code::ok) {
    // The time of the discarded scan does not count as the robot's.
    const std::int64_t settling_ns = s.now_ns - a.started_ns - a.cleared_in_ns;
    if (settling_ns <= settings_of_arm(s).settle_timeout_ns && time_for_another(s)) return;
    if (code == Code::outside_window)
      log(actions, LogLine::Level::warning, code,
          "station %u%s: its centre is %.0f mm off the scanner's axis, allowed %.0f mm", a.station,
          arm_words(s, a.attempt.arm).c_str(), off_axis_mm, settings_of_arm(s).pose.look_mm);
    if (code == Code::not_settled && arm.gate.lacks_stopped())
      log(actions, LogLine::Level::warning, code,
          "station %u: the robot set the stopped flag (bit 1) at an earlier station and does not set it now; slabd "
          "requires it until no pose arrives for 1 s",
          a.station);
    fail_acquisition(s, code, actions);
    return;
  }
  if (holds(Rule::unseen_scan_discarded) && arm.scan_unseen && !s.settings.simulation) {
    clear_scanner(s, slot, actions);
    return;
  }
  if (!time_for_another(s)) {
    log(actions, LogLine::Level::warning, Code::trigger_timeout,
        "station %u: the discarded scan took %.1f s, too long for another one while the PLC waits; the next SCAN "
        "requests its own at once",
        a.station, static_cast<double>(a.cleared_in_ns) / 1e9);
    fail_acquisition(s, Code::trigger_timeout, actions);
    return;
  }
  a.phase = Acquisition::Phase::scanning;
  a.attempt.asked = true;
  record_of(s, a.station).attempts = a.attempt.number;
  a.settled_ns = s.now_ns;
  a.attempt.emulated = emulation_of_arm(s, a.attempt.arm);
  a.attempt.settle_ms = ms_from_ns(s.now_ns - a.started_ns);
  arm.gate.begin_exposure(mean.T_base_flange);
  ask_scanner(s, a.exposure, a.attempt.arm, slot, scan_to_ask(s), actions);
}

void note_pose(Station& s, const PoseMean& mean, Actions& actions) {
  Acquisition& a = s.acquisition;
  a.attempt.T_base_flange = mean.T_base_flange;
  a.attempt.splice = splice_now(s, a.attempt.arm, a.station, mean.T_base_flange, actions);
  a.attempt.pose_spread_mm = mean.spread_mm;
  a.attempt.pose_samples = mean.samples;
  const unsigned emulated =
      a.attempt.emulated | emulation_of_arm(s, a.attempt.arm) | (a.attempt.shape.emulated ? kEmulatedScan : 0U);
  a.attempt.emulated = static_cast<std::uint8_t>(emulated);
}

/// A slab with one emulated scan is an emulated slab, even if a later scan of that station was a real one.
void note_emulation(Station& s, std::uint8_t bits, Actions& actions) {
  SlabHeader& slab = s.slab.header;
  const auto all = static_cast<std::uint8_t>(slab.emulated | bits);
  if (all == slab.emulated) return;
  slab.emulated = all;
  log(actions, LogLine::Level::warning, Code::ok,
      "slab %u \"%s\" is emulated (%s): its results are not a verdict on concrete, and every record of it is marked as "
      "emulated",
      slab.slab_no, slab.slab_id.c_str(), emulation_words(all).c_str());
}

MeasureBlock block_to_measure(const Station& s, const Attempt& attempt, std::uint8_t slot) {
  MeasureBlock action;
  action.id = id_of(attempt);
  action.slot = slot;
  action.scan_path = attempt.scan_path;
  action.points_crc32c = attempt.points_crc32c;
  action.shape = attempt.shape;
  action.basis = slab_basis(s);
  action.T_base_scanner = stored_T_base_scanner(s.slab.header, attempt);
  action.scanner_drift = attempt.scanner_drift;
  action.arm = attempt.arm;
  return action;
}

/// Starts measuring once the robot is known to have stood still over the whole exposure. If it has not,
/// check_stillness() reports that when the scan is durable.
void measure_ahead(Station& s, const PoseMean& mean, Actions& actions) {
  Acquisition& a = s.acquisition;
  note_pose(s, mean, actions);
  a.ahead = Acquisition::Ahead::measuring;
  a.ahead_ns = s.now_ns;
  a.exposure.slot_taken = false;
  MeasureBlock action = block_to_measure(s, a.attempt, a.exposure.slot);
  action.read_ms = a.read_ms;
  emit(actions, action);
}

void try_to_measure_ahead(Station& s, Actions& actions) {
  const Acquisition& a = s.acquisition;
  const Exposure& e = a.exposure;
  PoseMean mean;
  if (e.looked_at && !e.repeats && !e.abort && a.ahead == Acquisition::Ahead::no &&
      arm_of(s).gate.held_still(e.taken_ns, mean) == Code::ok)
    measure_ahead(s, mean, actions);
}

void check_stillness(Station& s, Actions& actions) {
  Acquisition& a = s.acquisition;
  if (a.ahead == Acquisition::Ahead::no) {
    PoseMean mean;
    const Code code = arm_of(s).gate.held_still(a.exposure.taken_ns, mean);
    if (code == Code::pose_stale && s.now_ns - a.exposure.taken_ns < kCheckTimeout_ns) return;
    if (code != Code::ok) {
      fail_acquisition(s, code, actions);
      return;
    }
    measure_ahead(s, mean, actions);
  }
  if (a.ahead == Acquisition::Ahead::measuring && s.now_ns - a.ahead_ns < kRefusalWait_ns) return;
  if (a.ahead == Acquisition::Ahead::measured && a.block.refused != Code::ok) {
    fail_acquisition(s, a.block.refused, actions);
    return;
  }
  a.phase = Acquisition::Phase::storing;
  if (!holds(Rule::acquired_after_commit)) s.command.acq_seq = a.cmd_seq;
  a.attempt.acquire_ms = ms_from_ns(s.now_ns - a.started_ns);
  PendingStore pending;
  pending.kind = PendingStore::Kind::acquired;
  pending.station = a.station;
  pending.attempt = a.attempt.number;
  pending.slot = a.exposure.slot;
  pending.value = a.cmd_seq;
  pending.slab_key = a.attempt.slab_key;
  pending.fingerprint = a.fingerprint;
  const std::int64_t measuring_since_ns = a.ahead == Acquisition::Ahead::measured ? 0 : s.now_ns;
  // The scans of an emulated line may have no noise.
  const bool refuse_known = !s.settings.simulation;
  submit(s, actions, AcquiredJob{a.attempt, a.fingerprint, measuring_since_ns, refuse_known, any_scan_unseen(s)},
         pending);
}

/// ABORT takes effect at any time, and a waiting PLC gets its answer.
void give_up_when_scanner_hangs(Station& s, Actions& actions) {
  Acquisition& a = s.acquisition;
  if (give_up_when_worker_hangs(s, a.exposure, a.started_ns, kHangTimeout_ns, actions))
    fail_acquisition(s, a.exposure.abort ? Code::interrupted : code_of_hang(s, a.exposure.arm), actions);
}

void release(Station& s) {
  give_back(s, s.acquisition.exposure);
  s.acquisition = {};
}

/// Marks that a result will come; a place for its record is reserved.
void expect_result(Station& s, std::uint8_t station, std::uint8_t slot) {
  ++s.measuring;
  s.station_measuring[station - 1U] = true;
  s.measuring_slot[station - 1U] = slot;
}
void expect_no_result(Station& s, std::uint8_t station) {
  --s.measuring;
  s.station_measuring[station - 1U] = false;
}

/// True for a measurement of the current acquisition's points.
bool is_ahead(const Station& s, const BlockMeasured& measured) {
  const Acquisition& a = s.acquisition;
  return a.ahead == Acquisition::Ahead::measuring && measured.id.is_attempt_of(id_of(a.attempt));
}

/// True for a measurement of a durable cloud. A dropped measurement answers from another buffer.
bool is_expected(const Station& s, const BlockMeasured& measured) {
  const std::size_t index = measured.id.station - 1U;
  return measured.id.slab_key == s.slab.header.key && s.station_measuring[index] &&
         s.measuring_slot[index] == measured.slot && s.slab.stations[index].attempt.number == measured.id.attempt;
}

/// The result of a scan during whose measurement a process ended: not measured.
BlockMeasured given_up(const Attempt& attempt) {
  BlockMeasured measured;
  measured.id = id_of(attempt);
  measured.block.station = attempt.station;
  measured.block.verdict = Verdict::not_measured;
  measured.block.reason = static_cast<std::uint16_t>(Code::deadline);
  return measured;
}

/// Result of a scan that measuring refused: the number of points and the block's position are kept as evidence. No
/// other data of it can influence a verdict.
BlockResult refused_block(const BlockMeasured& measured) {
  BlockResult block;
  block.station = measured.block.station;
  block.verdict = Verdict::not_measured;
  block.reason = static_cast<std::uint16_t>(measured.refused);
  block.scan = measured.block.scan;
  block.registration = measured.block.registration;
  block.times = measured.block.times;
  return block;
}

/// Refuses a scan whose block is at a position that another stop would see (station_views.h).
void hold_against_pose(Station& s, const Attempt& attempt, BlockMeasured& measured) {
  const RegistrationReport& registration = measured.block.registration;
  if (registration.status != RegistrationStatus::converged || s.slab.recipe == nullptr) return;
  View view;
  view.seen = true;
  view.T_base_scanner = stored_T_base_scanner(s.slab.header, attempt);
  view.T_base_block = s.slab.header.T_base_slab * T_slab_block(*s.slab.recipe, s.slab.facts.design, attempt.station);
  view.T_scanner_block = registration.T_scanner_block;
  // Another exposure may also show what looks like the end of another slab type.
  if (measured.refused == Code::ok || measured.refused == Code::unknown_type) {
    const ViewFinding finding = compare_view(s.views, attempt.station, view);
    if (finding.is_refused) {
      measured.refused = Code::frame_incomplete;
      measured.refused_text = text_of(finding, attempt.station);
    }
  }
  s.views.keep(attempt.station, view, measured.refused != Code::ok);
}

void commit_block(Station& s, const BlockMeasured& measured, Actions& actions) {
  const bool is_refused = measured.refused != Code::ok;
  const BlockResult block = is_refused ? refused_block(measured) : measured.block;
  StationRecord& record = record_of(s, block.station);
  if (record.phase == StationPhase::acquired) record.block = block;

  PendingStore pending;
  pending.kind = PendingStore::Kind::block;
  pending.station = block.station;
  pending.attempt = measured.id.attempt;
  pending.slab_key = measured.id.slab_key;
  pending.record = station_record(block);
  pending.record.cmd_seq = measured.id.cmd_seq;
  pending.record.slab_no = s.slab.header.slab_no;
  pending.record.scan_utime_us = measured.id.scan_utime_us;
  pending.record.emulated = s.slab.header.emulated;
  pending.value = measured.id.cmd_seq;
  number_record(s, pending.record);
  log(actions, LogLine::Level::info, Code::ok, "station %u: %s (reason %u) after %.0f ms", block.station,
      name(block.verdict).data(), block.reason, block.times.total_ms);
  submit(s, actions,
         BlockJob{measured.id.slab_key, measured.id.attempt, block, pending.record,
                  is_refused ? BlockMaps{} : measured.maps, is_refused ? NoisePrint{} : measured.noise},
         pending);
}

}  // namespace

void begin_acquisition(Station& s, const PlcInputs& in, Actions& actions) {
  StationRecord& record = record_of(s, static_cast<std::uint8_t>(in.station));
  record.phase = StationPhase::acquiring;
  record.code = 0;

  Acquisition& a = s.acquisition;
  a = {};
  a.phase = Acquisition::Phase::settling;
  a.cmd_seq = in.cmd_seq;
  a.session = s.command.session;
  a.station = static_cast<std::uint8_t>(in.station);
  a.started_ns = s.now_ns;
  a.attempt.slab_key = s.slab.header.key;
  a.attempt.station = a.station;
  // The number is used up only by a request to the scanner: a PLC may repeat SCAN all night while robot or scanner are
  // off.
  a.attempt.number = static_cast<std::uint8_t>(record.attempts + 1);
  a.attempt.asked = false;
  use_arm(s, arm_to_scan(s));
  a.attempt.session = a.session;
  a.attempt.cmd_seq = a.cmd_seq;
  set_status(s, a.cmd_seq, CommandStatus::acquiring);
  log(actions, LogLine::Level::info, Code::ok, "station %u: scan %u begins", a.station, a.attempt.number);
  if (s.plc.inputs.abort || s.command.pending_abort) fail_acquisition(s, Code::interrupted, actions);
}

void advance_acquisition(Station& s, Actions& actions) {
  switch (s.acquisition.phase) {
    case Acquisition::Phase::settling: try_to_trigger(s, actions); break;
    case Acquisition::Phase::clearing: give_up_when_scanner_hangs(s, actions); break;
    case Acquisition::Phase::scanning:
      try_to_measure_ahead(s, actions);
      give_up_when_scanner_hangs(s, actions);
      break;
    case Acquisition::Phase::checking: check_stillness(s, actions); break;
    case Acquisition::Phase::none:
    case Acquisition::Phase::storing: break;
  }
}

/// The block's own scan is requested next, or the command ends with the code of the discarded one.
void on_cleared(Station& s, const ScanDone& done, Actions& actions) {
  Acquisition& a = s.acquisition;
  Exposure& e = a.exposure;
  if (done.code == Code::ok && !e.looked_at) {
    e.looked_at = true;
    e.repeats = was_seen(s, done, actions);
  }
  if (!done.durable) return;
  give_back(s, e);
  if (done.code == Code::ok) emit(actions, DropScan{done.scan.path});
  // A known scan is not the unseen one, which may still come.
  const Code code = done.code == Code::ok && e.repeats ? Code::frame_incomplete : done.code;
  if (e.abort || code != Code::ok) {
    fail_acquisition(s, e.abort ? Code::interrupted : code, actions);
    return;
  }
  arm_of(s).scan_unseen = false;
  a.cleared_in_ns = s.now_ns - a.clearing_since_ns;
  a.phase = Acquisition::Phase::settling;
}

void on_block_scanned(Station& s, const ScanDone& done, Actions& actions) {
  Acquisition& a = s.acquisition;
  Exposure& e = a.exposure;
  a.attempt.scan_path = done.scan.path;
  a.attempt.shape = done.scan.shape;
  a.attempt.scan_utime_us = done.scan.taken_utime_us;
  a.attempt.points_crc32c = done.points_crc32c;
  if (done.fingerprint != 0) a.attempt.fingerprint = static_cast<std::int64_t>(done.fingerprint);
  e.taken_ns = done.scan.taken_mono_ns;
  a.attempt.scanner_drift =
      scanner_drift(settings_of_arm(s).scanner_drift, s.slab.calibration.arm[a.attempt.arm].scanner.numbers,
                    done.scan.shape.scanner_temperature_c);
  if (done.code == Code::ok) {
    arm_of(s).scan_emulated = done.scan.shape.emulated;
    note_scanner_temperature(s, a.attempt.arm, done.scan.shape.scanner_temperature_c, actions);
  }
  a.read_ms = done.scan.read_ms;
  if (done.code == Code::ok && !e.looked_at) {
    e.looked_at = true;
    if (!is_repeated(s, done.fingerprint, actions)) {
      // Stored with the job that records the attempt, so that a restart in between does not lose it.
      a.fingerprint = done.fingerprint;
    } else {
      // The scans of an emulated line may have no noise.
      e.repeats = !s.settings.simulation;
      log(actions, LogLine::Level::error, Code::frame_incomplete,
          "station %u%s: the scanner gave the points of an earlier scan again%s", a.station,
          arm_words(s, a.attempt.arm).c_str(),
          e.repeats ? "; restart the scanner program" : "; accepted, because the line is emulated");
    }
  }
  if (!done.durable) return;
  const bool no_answer = done.code == Code::scanner_offline || done.code == Code::trigger_timeout;
  if (no_answer && a.fingerprint == 0) {
    // The scanner did not answer at all, so it is offline and the attempt does not count.
    a.attempt.asked = false;
    record_of(s, a.station).attempts = static_cast<std::uint8_t>(a.attempt.number - 1);
  }
  if (e.abort || done.code != Code::ok || e.repeats) {
    const Code code = done.code != Code::ok ? done.code : Code::frame_incomplete;
    fail_acquisition(s, e.abort ? Code::interrupted : code, actions);
    return;
  }
  a.phase = Acquisition::Phase::checking;
}

void on_acquired_stored(Station& s, const PendingStore& pending, Code code, Actions& actions) {
  Acquisition& a = s.acquisition;
  if (code != Code::ok) {
    // The points are in the stored history; the storage thread has logged the scan. The disk is not at fault.
    if (code == Code::frame_incomplete)
      s.views.slab[pending.station - 1U] = {};
    else
      raise_fault(s, actions, code, "recording a scan");
    StationRecord& record = record_of(s, pending.station);
    record.phase = StationPhase::failed;
    record.code = static_cast<std::uint16_t>(code);
    set_failed(s, pending.value, code);
    release(s);
    return;
  }
  StationRecord& record = record_of(s, pending.station);
  record.phase = StationPhase::acquired;
  record.attempt = a.attempt;
  note_emulation(s, a.attempt.emulated, actions);
  s.newest_time.note(a.attempt.scan_utime_us);
  s.command.acq_seq = pending.value;
  set_status(s, pending.value, CommandStatus::acquired);
  log(actions, LogLine::Level::info, Code::ok, "station %u%s: %zu points durable after %.0f ms, the robot may leave",
      pending.station, arm_words(s, a.attempt.arm).c_str(), a.attempt.shape.finite, a.attempt.acquire_ms);
  const Acquisition was = a;
  a = {};  // the buffer stays in use until the block is measured
  if (s.slab.aborting) return;
  expect_result(s, pending.station, was.exposure.slot);
  if (was.ahead == Acquisition::Ahead::measured) commit_block(s, was.block, actions);
}

void fail_acquisition(Station& s, Code code, Actions& actions) {
  Acquisition& a = s.acquisition;
  const bool asked = a.phase == Acquisition::Phase::clearing || a.phase == Acquisition::Phase::scanning;
  // The scan of a request without new points may arrive later, as the scan of another block. The mark is stored in one
  // transaction with the end of the command: a restart finds a SCAN in progress, or the mark.
  const bool unseen = asked && a.fingerprint == 0;
  if (unseen) arm_of(s).scan_unseen = true;
  const std::uint64_t fingerprint = unseen ? kUnseenScan : a.fingerprint;
  StationRecord& record = record_of(s, a.station);
  record.phase = StationPhase::failed;
  record.code = static_cast<std::uint16_t>(code);
  set_failed(s, a.cmd_seq, code);
  log(actions, LogLine::Level::warning, code, "station %u%s: scan %u failed: %.*s; %.*s", a.station,
      arm_words(s, a.attempt.arm).c_str(), a.attempt.number, static_cast<int>(describe(code).size()),
      describe(code).data(), static_cast<int>(cure(code).size()), cure(code).data());
  PendingStore pending;
  pending.kind = PendingStore::Kind::failed_attempt;
  pending.station = a.station;
  pending.fingerprint = fingerprint;
  submit(s, actions, FailedAttemptJob{a.attempt, static_cast<std::uint16_t>(code), fingerprint, any_scan_unseen(s)},
         pending);
  release(s);
}

void abort_acquisition(Station& s, Actions& actions) {
  Acquisition& a = s.acquisition;
  switch (a.phase) {
    case Acquisition::Phase::settling:
    case Acquisition::Phase::checking: fail_acquisition(s, Code::interrupted, actions); break;
    case Acquisition::Phase::clearing:
    case Acquisition::Phase::scanning: break_off(a.exposure, actions); break;
    case Acquisition::Phase::none:
      s.command.pending_abort = s.command.pending;  // a SCAN may be on its way to the journal
      break;
    case Acquisition::Phase::storing: break;  // too late: the cloud is about to be durable
  }
}

void on_block_measured(Station& s, const BlockMeasured& measured, Actions& actions) {
  assert(measured.slot < s.slot_busy.size());
  s.slot_busy[measured.slot] = false;
  const bool ahead = is_ahead(s, measured);
  if (!ahead && !is_expected(s, measured)) return;
  BlockMeasured held = measured;
  hold_against_pose(s, ahead ? s.acquisition.attempt : record_of(s, measured.block.station).attempt, held);
  if (held.refused != Code::ok)
    log(actions, LogLine::Level::error, held.refused, "station %u: %s", held.block.station, held.refused_text.c_str());
  if (ahead) {
    s.acquisition.ahead = Acquisition::Ahead::measured;
    s.acquisition.block = held;
  } else {
    commit_block(s, held, actions);
  }
}

void remeasure(Station& s, Actions& actions) {
  const bool quiet = s.slab.phase == SlabPhase::open || s.slab.phase == SlabPhase::ending;
  if (!quiet || s.now_ns == 0 || s.slab.aborting || s.slab.recipe == nullptr || s.fault != 0 || s.measuring != 0 ||
      s.command.pending || s.acquisition.phase != Acquisition::Phase::none || !room_for_records(s, 2))
    return;
  for (std::size_t i = 0; i < s.slab.stations.size(); ++i) {
    if (s.slab.stations[i].phase != StationPhase::acquired || s.station_measuring[i]) continue;
    StationRecord& record = s.slab.stations[i];
    const auto station = static_cast<std::uint8_t>(i + 1);
    // A mark with a future time is from before a restart of the computer: the power failed, not the measurement.
    if (const std::int64_t since_ns = std::exchange(record.measuring_since_ns, 0);
        since_ns != 0 && since_ns <= s.now_ns) {
      log(actions, LogLine::Level::error, Code::deadline,
          "station %u: slabd ended while it measured this scan, which is not measured again automatically: scan the "
          "station again, or look at %s with `slabctl inspect`",
          station, record.attempt.scan_path.c_str());
      expect_result(s, station, kNoSlot);
      commit_block(s, given_up(record.attempt), actions);
      return;
    }
    const int slot = free_slot(s);
    if (slot < 0) return;
    s.slot_busy[static_cast<std::size_t>(slot)] = true;
    expect_result(s, station, static_cast<std::uint8_t>(slot));
    PendingStore pending;
    pending.kind = PendingStore::Kind::measuring;
    pending.station = station;
    pending.attempt = record.attempt.number;
    pending.slot = static_cast<std::uint8_t>(slot);
    pending.slab_key = s.slab.header.key;
    submit(s, actions, MeasuringJob{s.slab.header.key, station, record.attempt.number, s.now_ns}, pending);
    return;
  }
}

void on_measuring_stored(Station& s, const PendingStore& pending, Code code, Actions& actions) {
  const std::size_t index = pending.station - 1U;
  const bool wanted =
      s.station_measuring[index] && s.measuring_slot[index] == pending.slot && s.slab.header.key == pending.slab_key;
  if (!wanted || code != Code::ok) {
    s.slot_busy[pending.slot] = false;
    if (!wanted) return;
    expect_no_result(s, pending.station);
    raise_fault(s, actions, code, "recording that a measurement begins");
    return;
  }
  MeasureBlock action = block_to_measure(s, s.slab.stations[index].attempt, pending.slot);
  action.reload = true;
  emit(actions, action);
}

void drop_measurements(Station& s) {
  for (std::size_t i = 0; i < s.station_measuring.size(); ++i) {
    const auto station = static_cast<std::uint8_t>(i + 1);
    const bool on_its_way = std::any_of(s.storing.begin(), s.storing.end(), [&](const PendingStore& pending) {
      return pending.kind == PendingStore::Kind::block && pending.station == station;
    });
    if (s.station_measuring[i] && !on_its_way) expect_no_result(s, station);
  }
}

}  // namespace slabd::daemon
