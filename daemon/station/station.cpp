// SPDX-License-Identifier: Apache-2.0
#include "daemon/station/station.h"

#include <algorithm>
#include <cstdarg>

#include "base/jobs.h"
#include "base/rules.h"
#include "daemon/station/parts.h"
#include "daemon/station/pose_gate.h"

namespace slabd::daemon {

void log(Actions& actions, LogLine::Level level, Code code, const char* format, ...) {
  // A log line is dropped if actions run short, so that it never displaces work.
  if (actions.size() + 8 > Actions::capacity()) return;
  std::array<char, limits::kErrorTextBytes + 1> text{};
  va_list args;
  va_start(args, format);
  std::vsnprintf(text.data(), text.size(), format, args);
  va_end(args);
  emit(actions, LogLine{level, static_cast<std::uint16_t>(code), std::string_view(text.data())});
}

Code current_fault(const Station& s) {
  if (s.settings.fault != Code::ok) return s.settings.fault;
  if (s.fault != 0) return static_cast<Code>(s.fault);
  return calibration_fault(s) == CalibrationFault::none ? Code::ok : Code::calibration_missing;
}

void raise_fault(Station& s, Actions& actions, Code code, const char* doing) {
  s.fault = static_cast<std::uint16_t>(code);
  log(actions, LogLine::Level::error, code, "fault %u while %s: %.*s; %.*s", static_cast<unsigned>(code), doing,
      static_cast<int>(describe(code).size()), describe(code).data(), static_cast<int>(cure(code).size()),
      cure(code).data());
}

const Recipe* recipe_for(const Station& s, std::uint16_t slab_type) {
  for (const Recipe& recipe : s.settings.recipes)
    if (recipe.slab_type == slab_type) return &recipe;
  return nullptr;
}

namespace {

View view_of(const SlabHeader& slab, const Recipe& recipe, int station, const Pose& T_base_scanner,
             const Pose& T_scanner_block) {
  const SlabDesign design = facts_of(slab).design;
  return {true, T_base_scanner, slab.T_base_slab * T_slab_block(recipe, design, station), T_scanner_block};
}

/// Restores the views of the last slab, and of the open slab's measured blocks.
void recover_views(Station& s, const RecoveredLine& line) {
  const Recipe* recipe = recipe_for(s, line.last_slab.slab_type);
  for (std::size_t i = 0; recipe != nullptr && i < line.last_blocks.size() && i < recipe->stations(); ++i) {
    const SeenBlock& block = line.last_blocks[i];
    if (block.seen)
      s.views.last[i] =
          view_of(line.last_slab, *recipe, static_cast<int>(i) + 1, block.T_base_scanner, block.T_scanner_block);
  }
  recipe = line.slab_open ? recipe_for(s, line.slab.slab_type) : nullptr;
  for (std::size_t i = 0; recipe != nullptr && i < line.stations.size() && i < recipe->stations(); ++i) {
    const StationRecord& record = line.stations[i];
    const bool seen = record.phase == StationPhase::measured &&
                      record.block.registration.status == RegistrationStatus::converged &&
                      record.block.reason != static_cast<std::uint16_t>(Code::frame_incomplete);
    if (seen)
      s.views.slab[i] =
          view_of(line.slab, *recipe, static_cast<int>(i) + 1, stored_T_base_scanner(line.slab, record.attempt),
                  record.block.registration.T_scanner_block);
  }
}

/// Continues after the previous process. The session always changes, so that this process cannot carry out a command
/// meant for the previous one; no scan is repeated on slabd's own initiative.
void on_recovered(Station& s, const Recovered& event, Actions& actions) {
  const RecoveredLine& line = *event.line;
  if (holds(Rule::sessions_continue)) s.command.session_next = line.session;
  s.command.ack = line.cmd_ack;
  s.command.status = line.cmd_status;
  s.command.acq_seq = line.acq_seq;
  if (holds(Rule::record_numbers_continue)) s.results.last_seq = line.res_seq;
  if (holds(Rule::record_kept_over_restarts)) s.results.queue = line.unacknowledged;
  s.results.table = line.table;
  s.results.slab_verdict = line.slab_verdict;
  s.results.slab_reason = line.slab_reason;
  s.results.slab_no = line.table_slab_no;
  s.results.slab_record = line.slab_record;
  if (!line.slab_open) show_disposition(s, line.disposition);
  s.results.slab_emulated = line.slab_emulated;
  if (holds(Rule::slab_keys_continue)) s.last_slab_key = line.last_slab_key;
  s.newest_time = NewestTime(line.newest_utime_us);
  if (holds(Rule::scan_new_over_restarts)) s.fingerprints = line.fingerprints;
  s.fingerprint_next = static_cast<std::size_t>(std::count_if(line.fingerprints.begin(), line.fingerprints.end(),
                                                              [](std::uint64_t f) { return f != 0; })) %
                       s.fingerprints.size();
  // The mark is the newest entry; scans by another scanner store it again. It does not name the scanner, and with
  // several of them older entries count, too.
  bool is_unseen = false;
  for (const std::uint64_t fingerprint : line.fingerprints)
    if (fingerprint != 0) is_unseen = fingerprint == kUnseenScan || (is_unseen && s.settings.arms.several());
  for (std::size_t arm = 0; arm < arm_count(s); ++arm) s.arms[arm].scan_unseen = is_unseen;
  recover_views(s, line);
  recover_gauges(s, line);
  s.slab.header = line.slab;
  s.slab.facts = facts_of(line.slab);
  if (holds(Rule::open_slab_restored)) s.slab.stations = line.stations;
  if (!line.slab_open) {
    s.slab.result = line.last_result;
  } else {
    s.slab.phase = SlabPhase::open;
    const Recipe* recipe = recipe_for(s, line.slab.slab_type);
    const bool same = recipe != nullptr && recipe->sha256 == line.slab.recipe_sha256;
    s.slab.recipe = same ? recipe : nullptr;
    if (same) {
      log(actions, LogLine::Level::info, Code::ok, "slab %u \"%s\" is still open; the line can continue it",
          line.slab.slab_no, line.slab.slab_id.c_str());
    } else {
      log(actions, LogLine::Level::error, Code::unknown_type,
          "open slab %u was begun with recipe %s (%.12s), which is not loaded now: only SLAB_ABORT is possible",
          line.slab.slab_no, line.slab.recipe.c_str(), line.slab.recipe_sha256.c_str());
    }
  }
  start_calibration(s, line.calibration, actions);
  if (line.slab_open) recover_slab_calibration(s, line, actions);
  if (line.slab_open && line.abort_seq != 0) {
    log(actions, LogLine::Level::info, Code::ok,
        "slab %u: SLAB_ABORT was accepted before the restart; it is finished now", line.slab.slab_no);
    begin_end(s, line.abort_seq, true, actions);
  }
  s.recovered = true;
  increment_session(s, actions, "start");
}

/// The session is far from that of a new database. A command that is refused here remains in the registers and must not
/// match when the database is opened.
void on_not_recovered(Station& s, const NotRecovered& event, Actions& actions) {
  constexpr std::uint16_t kSessionWithoutStore = 0x8000;
  s.settings.fault = event.fault;
  s.command.session_next = kSessionWithoutStore;
  start_calibration(s, {}, actions);
  s.recovered = true;
  s.without_store = true;
  increment_session(s, actions, "start");
}

void on_tick(Station& s, const Tick& tick, Actions& actions) {
  s.now_ns = tick.mono_ns;
  s.utime_us = tick.utime_us;
  if (s.now_ns - s.heartbeat_ns >= s.settings.heartbeat_period_ns) {
    s.heartbeat_ns = s.now_ns;
    ++s.heartbeat;
  }
  const bool backwards = s.utime_us < s.newest_time.utime_us();
  if (backwards && (s.warn & kWarnClockBackwards) == 0)
    log(actions, LogLine::Level::warning, Code::ok,
        "the wall clock is older than the newest record; records stay ordered by number");
  s.warn = static_cast<std::uint16_t>(backwards ? (s.warn | kWarnClockBackwards) : (s.warn & ~kWarnClockBackwards));
  watch_heartbeat(s, actions);
}

struct Dispatch {
  Station& s;
  Actions& actions;
  void operator()(const Recovered& e) const { on_recovered(s, e, actions); }
  void operator()(const NotRecovered& e) const { on_not_recovered(s, e, actions); }
  void operator()(const Tick& e) const { on_tick(s, e, actions); }
  void operator()(const LinkStatus& e) const {
    assert(e.arm < s.arms.size());
    LinkStatus& links = s.arms[e.arm].links;
    if (e.stray_files > links.stray_files) s.warn |= kWarnStrayFiles;
    links = e;
  }
  void operator()(const PlcInputs& e) const { on_plc(s, e, actions); }
  void operator()(const PoseSample& e) const {
    assert(e.arm < s.arms.size());
    StationArm& arm = s.arms[e.arm];
    arm.gate.add(e);
    if (in_maintenance(s) && s.capture.arm == e.arm) arm.still.add(e);
  }
  void operator()(const ScanDone& e) const { on_scan_done(s, e, actions); }
  void operator()(const BlockMeasured& e) const { on_block_measured(s, e, actions); }
  void operator()(const SlabJudged& e) const { on_slab_judged(s, e, actions); }
  void operator()(const StoreDone& e) const { on_stored(s, e, actions); }
  void operator()(const CalibrationChanged& e) const { on_calibration_changed(s, *e.calibration); }
  void operator()(const DispositionKept& e) const {
    if (s.slab.phase == SlabPhase::none && s.slab.header.key == e.slab_key) show_disposition(s, e.decision);
  }
  void operator()(const GaugesSampled& e) const { on_gauges_sampled(s, e); }
  void operator()(const GaugeEntered& e) const { on_gauge_entered(s, e, actions); }
  void operator()(const GaugeChecked& e) const { on_gauge_checked(s, e.check); }
  void operator()(const CaptureRequest& e) const { on_capture_request(s, e, actions); }
};

}  // namespace

void step(Station& station, const Event& event, Actions& actions) {
  actions.clear();
  std::visit(Dispatch{station, actions}, event);
  if (!station.recovered) return;
  // Any event may be the one that these functions wait for; each does nothing in other phases.
  advance_acquisition(station, actions);
  advance_capture(station, actions);
  advance_end(station, actions);
  remeasure(station, actions);
  advance_calibration(station, actions);
}

// The image for the PLC, derived from the state alone. A result appears here only after its commit.

namespace {

bool acquired_or_measured(const StationRecord& record) {
  return record.phase == StationPhase::acquired || record.phase == StationPhase::measured;
}

/// True if a scan of this row became durable: its verdict is not the code of a failed acquisition.
bool row_has_scan(const PlcStationRow& row) {
  const bool code = row.verdict == Verdict::not_measured && row.reason != 0 && row.reason < kReasonItemBase;
  const bool measuring_code = row.reason > 401 && row.reason < 500;
  return row.attempts != 0 && row.verdict != Verdict::none && (!code || measuring_code);
}

void count_station(PlcOutputs& out, std::size_t index, bool has_scan) {
  if (!has_scan) return;
  ++out.stations_done;
  out.station_mask |= 1U << index;
}

PlcStationRow provisional_row(const StationRecord& record) {
  PlcStationRow row;
  row.attempts = record.attempts;
  if (record.phase == StationPhase::measured) {
    row.verdict = record.block.verdict;
    row.reason = record.block.reason;
  } else if (record.phase == StationPhase::failed) {
    row.verdict = Verdict::not_measured;
    row.reason = record.code;
  }
  return row;
}

PlcState state_of(const Station& s) {
  if (!s.recovered) return PlcState::recover;
  if (in_maintenance(s)) return PlcState::maintenance;
  if (current_fault(s) != Code::ok) return PlcState::fault;
  switch (s.acquisition.phase) {
    case Acquisition::Phase::settling: return PlcState::settling;
    case Acquisition::Phase::clearing:
    case Acquisition::Phase::scanning:
    case Acquisition::Phase::checking:
    case Acquisition::Phase::storing: return PlcState::scanning;
    case Acquisition::Phase::none: break;
  }
  if (s.slab.phase != SlabPhase::none) return PlcState::slab_open;
  return s.results.queue.empty() ? PlcState::idle : PlcState::waiting_for_plc;
}

}  // namespace

FixedString<64> arm_words(const Station& s, std::size_t arm) {
  FixedString<64> words;
  if (!s.settings.arms.several() || arm >= arm_count(s)) return words;
  const Arm& by = s.settings.arms.list[arm];
  words.printf(" (robot %s, scanner %s)", by.robot.c_str(), by.scanner.c_str());
  return words;
}

std::uint8_t emulation_of_arm(const Station& s, std::size_t arm) {
  unsigned bits = s.settings.simulation ? kEmulatedLine : 0U;
  // A silent robot is neither real nor emulated.
  const PoseSample* pose = s.arms[arm].gate.newest();
  if (pose != nullptr && s.now_ns - pose->arrival_ns < PoseGate::kForget_ns)
    bits |= (pose->emulated ? kEmulatedRobot : 0U) | (pose->commanded ? kCommandedPoses : 0U);
  return static_cast<std::uint8_t>(bits);
}

std::uint8_t emulation_of_line(const Station& s) {
  unsigned bits = 0;
  for (std::size_t arm = 0; arm < arm_count(s); ++arm) bits |= emulation_of_arm(s, arm);
  return static_cast<std::uint8_t>(bits);
}

std::uint8_t emulation_of_scans(const Station& s) {
  const bool any = std::any_of(s.arms.begin(), s.arms.end(), [](const StationArm& arm) { return arm.scan_emulated; });
  return any ? kEmulatedScan : 0U;
}

std::size_t best_arm(const Station& s) {
  for (std::size_t arm = 0; arm < arm_count(s); ++arm)
    if (s.arms[arm].links.scanner_online && s.arms[arm].gate.link(s.now_ns) == Code::ok) return arm;
  return 0;
}

std::uint8_t emulation_shown(const Station& s) {
  const bool open = s.slab.phase != SlabPhase::none;
  unsigned bits = unsigned{emulation_of_line(s)} | emulation_of_scans(s);
  bits |= open ? s.slab.header.emulated : s.results.slab_emulated;
  if (!s.results.queue.empty()) bits |= s.results.queue.front().emulated;
  return static_cast<std::uint8_t>(bits);
}

FixedString<32> emulation_words(std::uint8_t bits) {
  FixedString<32> words;
  for (std::size_t i = 0; i < kEmulationNames.size(); ++i) {
    if ((bits & (1U << i)) == 0) continue;
    if (!words.empty()) words.append(", ");
    words.append(kEmulationNames[i]);
  }
  return words;
}

PlcOutputs plc_view(const Station& s) {
  PlcOutputs out;
  const Code fault = current_fault(s);
  const bool open = s.slab.phase != SlabPhase::none;
  out.heartbeat = s.heartbeat;
  out.state = state_of(s);
  out.fault = static_cast<std::uint16_t>(fault);
  const bool waiting = s.results.queue.size() > limits::kStationsMax;
  out.simulation = emulation_shown(s) != 0;
  out.warn = static_cast<std::uint16_t>(
      s.warn | s.settings.warn | calibration_warnings(s) | (waiting ? +kWarnResultsWaiting : 0) |
      (s.arms[0].links.recipes_differ ? +kWarnRecipesDiffer : 0) | (out.simulation ? +kWarnEmulation : 0) |
      (s.stop_alike != 0 ? +kWarnStopsAlike : 0) | (gauges_need_care(s) ? +kWarnGauge : 0));
  const bool shooting = in_maintenance(s) && s.capture.phase != Capture::Phase::ready;
  out.busy = s.command.pending || shooting || s.acquisition.phase != Acquisition::Phase::none ||
             s.slab.phase == SlabPhase::ending || s.slab.phase == SlabPhase::storing_end;
  out.ready = s.recovered && fault == Code::ok && !out.busy && !in_maintenance(s) &&
              s.command.session == s.command.session_next;
  out.acquired = s.command.acq_seq != 0 && s.command.acq_seq == s.command.ack;
  out.result = !s.results.queue.empty();
  out.slab_open = open;
  out.fault_present = fault != Code::ok;
  out.warn_present = out.warn != 0;
  // A scan is possible at one station at least if one arm has both.
  const StationArm& arm = s.arms[best_arm(s)];
  out.pose_ok = arm.gate.link(s.now_ns) == Code::ok;
  out.scanner_ok = arm.links.scanner_online;
  out.plc_link_ok = s.plc.alive;
  // In fault 504 the database is not opened.
  out.store_ok = s.recovered && fault != Code::journal_write && fault != Code::store_full && fault != Code::config;

  out.session = s.command.session;
  out.cmd_ack = s.command.ack;
  out.cmd_status = s.command.status;
  out.acq_seq = s.command.acq_seq;
  out.current_station = s.acquisition.station;
  out.refused = s.command.refused;
  out.refuse_code = s.command.refuse_code;
  out.refuse_seq = s.command.refuse_seq;
  out.utime_us = s.utime_us;
  out.disposition_seq = s.results.disposition_seq;
  out.results_pending = static_cast<std::uint16_t>(s.results.queue.size());
  if (!s.results.queue.empty()) out.record = s.results.queue.front();

  if (open) {
    out.slab_no = s.slab.header.slab_no;
    out.slab_type = s.slab.header.slab_type;
    for (std::size_t i = 0; i < s.slab.stations.size(); ++i) {
      const StationRecord& record = s.slab.stations[i];
      out.table[i] = provisional_row(record);
      count_station(out, i, acquired_or_measured(record));
    }
    out.table_slab_no = s.slab.header.slab_no;
  } else {
    out.table = s.results.table;
    out.slab_verdict = s.results.slab_verdict;
    out.slab_reason = s.results.slab_reason;
    out.table_slab_no = s.results.slab_no;
    out.disposition = s.results.disposition;
    for (std::size_t i = 0; i < out.table.size(); ++i) count_station(out, i, row_has_scan(out.table[i]));
  }
  return out;
}

}  // namespace slabd::daemon
