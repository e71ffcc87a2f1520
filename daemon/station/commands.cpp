// SPDX-License-Identifier: Apache-2.0
//
// The PLC's command interface. A command is carried out once, from the commanding connection, in the present session:
//   (a) CMD_SEQ must be the successor of CMD_ACK: a repeated or replayed block has no effect,
//   (b) SESSION_ECHO must be the session now shown: after a restart of either side old frames are void,
//   (c) ENABLE must be set and the heartbeat alive,
//   (d) one connection commands; a command from another one takes over, but the session changes and its first block is
// refused.
// CMD_ACK moves only if the command is in the journal, or if its content is refused.
#include <algorithm>
#include <cctype>
#include <charconv>
#include <optional>
#include <string_view>
#include <system_error>

#include "base/rules.h"
#include "daemon/station/parts.h"

namespace slabd::daemon {
namespace {

/// Refuses a command. Content refusals consume the number; a stale session or a wrong number does not.
void refuse(Station& s, const PlcInputs& in, Code code, Actions& actions) {
  CommandState& state = s.command;
  state.refuse_code = static_cast<std::uint16_t>(code);
  state.refuse_seq = in.cmd_seq;
  ++state.refused;
  if (code != Code::stale_session && code != Code::bad_sequence) {
    state.ack = in.cmd_seq;
    state.pending_inputs = in;
    set_failed(s, in.cmd_seq, code);
  }
  if (!state.refusal_limit.permits(s.now_ns)) return;
  log(actions, LogLine::Level::warning, code, "command %u (CMD %u, station %u) refused: %.*s (refusal %u)", in.cmd_seq,
      in.command, in.station, static_cast<int>(describe(code).size()), describe(code).data(), state.refused);
  const bool is_scan = in.command == static_cast<std::uint16_t>(PlcCommand::scan);
  const bool in_range = in.station >= 1 && in.station <= limits::kStationsMax;
  if (!is_scan || !in_range || code != Code::calibration_missing || s.slab.phase == SlabPhase::none) return;
  for (const std::uint8_t arm : s.settings.arms.of_station[in.station - 1U])
    log(actions, LogLine::Level::warning, code,
        "station %u cannot be scanned%s: its calibration or its tie could not be used when the slab was begun, or it "
        "was begun with another robot or scanner: SLAB_ABORT, or start slabd with that configuration again",
        in.station, arm_words(s, arm).c_str());
}

bool printable(const std::array<char, limits::kSlabIdBytes>& id) {
  const auto end = std::find(id.begin(), id.end(), '\0');
  const bool text = std::all_of(id.begin(), end, [](char c) { return c >= 0x20 && c < 0x7F; });
  return text && std::all_of(end, id.end(), [](char c) { return c == '\0'; });
}

std::string_view id_text(const std::array<char, limits::kSlabIdBytes>& id) {
  return {id.data(), static_cast<std::size_t>(std::find(id.begin(), id.end(), '\0') - id.begin())};
}

/// Mould of SLAB_BEGIN, from MOULD (HR 34) or SLAB_ID; 0 if neither names one. nullopt if they differ, or if the group
/// of [line] mould_from_id is not a number of a mould.
std::optional<std::uint16_t> mould_of(const Station& s, const PlcInputs& in) {
  if (s.settings.mould_from_id == nullptr) return in.mould;
  const std::optional<std::string_view> digits = s.settings.mould_from_id->first_group(id_text(in.slab_id));
  if (!digits || digits->empty()) return in.mould;
  std::uint16_t of_id = 0;
  const auto [end, fault] = std::from_chars(digits->data(), digits->data() + digits->size(), of_id);
  if (fault != std::errc() || end != digits->data() + digits->size()) return std::nullopt;
  if (of_id != 0 && in.mould != 0 && of_id != in.mould) return std::nullopt;
  return of_id != 0 ? of_id : in.mould;
}

/// True if SLAB_NO and SLAB_TYPE of a command match the open slab; 0 means "the open one".
bool names_open_slab(const Station& s, const PlcInputs& in) {
  const SlabHeader& slab = s.slab.header;
  return (in.slab_no == 0 || in.slab_no == slab.slab_no) && (in.slab_type == 0 || in.slab_type == slab.slab_type);
}

/// The design sheet with which the slab begins; nullptr: as the recipe says.
const DesignSheet* design_for(const Station& s, const Recipe& recipe, const PlcInputs& in) {
  return recipe.design == DesignUse::none ? nullptr : find_design(s.settings.designs, id_text(in.slab_id));
}

/// False if the slab needs a design sheet and has none, or has one of another slab type. While a sheet cannot be read,
/// an optional one is not taken as absent.
bool has_its_design(const Station& s, const Recipe& recipe, const PlcInputs& in) {
  if (recipe.design == DesignUse::none) return true;
  const DesignSheet* const sheet = design_for(s, recipe, in);
  if (sheet != nullptr) return sheet->slab_type == recipe.slab_type && sheet->stations == recipe.stations();
  return recipe.design == DesignUse::optional && !s.settings.designs_faulty;
}

Code check_begin(const Station& s, const PlcInputs& in) {
  if (current_fault(s) != Code::ok) return current_fault(s);
  if (s.slab.phase == SlabPhase::ending || s.slab.phase == SlabPhase::storing_end) return Code::busy;
  if (s.slab.phase != SlabPhase::none) return Code::wrong_slab;
  const Recipe* recipe = recipe_for(s, in.slab_type);
  if (recipe == nullptr || (in.recipe != 0 && in.recipe != recipe->slab_type)) return Code::unknown_type;
  if (!printable(in.slab_id) || !in.chips_agree) return Code::bad_id_text;
  if (s.settings.second_chip_required && in.second_chip == 0) return Code::bad_id_text;
  if (s.settings.id_pattern != nullptr && !s.settings.id_pattern->matches(id_text(in.slab_id)))
    return Code::bad_id_text;
  if (!mould_of(s, in)) return Code::unknown_mould;
  if (!has_its_design(s, *recipe, in)) return Code::no_design;
  return room_for_records(s, 1) ? Code::ok : Code::busy;
}

Code check_scan(const Station& s, const PlcInputs& in) {
  if (current_fault(s) != Code::ok) return current_fault(s);
  if (s.slab.phase == SlabPhase::none || !names_open_slab(s, in)) return Code::wrong_slab;
  if (s.slab.phase != SlabPhase::open) return Code::busy;
  if (s.slab.recipe == nullptr) return Code::unknown_type;
  if (in.station < 1 || in.station > s.slab.recipe->stations()) return Code::station_range;
  const ArmChoice& arms = s.settings.arms.of_station[in.station - 1U];
  if (std::none_of(arms.begin(), arms.end(), [&s](std::uint8_t arm) { return can_scan(s, arm); }))
    return Code::calibration_missing;
  if (s.acquisition.phase != Acquisition::Phase::none || s.station_measuring[in.station - 1U]) return Code::busy;
  if (!room_for_records(s, 2)) return Code::busy;  // for this scan and the slab
  if (s.slab.stations[in.station - 1U].attempts == 0xFF) return Code::attempts_used_up;
  return Code::ok;
}

Code check_end(const Station& s, const PlcInputs& in, bool aborting) {
  if (!aborting && current_fault(s) != Code::ok) return current_fault(s);
  if (s.slab.phase == SlabPhase::none || !names_open_slab(s, in)) return Code::wrong_slab;
  if (s.slab.phase == SlabPhase::storing_end || !room_for_records(s, 1)) return Code::busy;
  if (aborting) return Code::ok;  // also while SLAB_END waits for an event that does not come
  if (s.slab.phase != SlabPhase::open) return Code::busy;
  if (s.slab.recipe == nullptr) return Code::unknown_type;
  return s.acquisition.phase == Acquisition::Phase::none ? Code::ok : Code::busy;
}

Code check_report(const Station& s, const PlcInputs& in) {
  if (!room_for_records(s, s.slab.phase == SlabPhase::none ? 1 : 2)) return Code::busy;
  if (in.station > limits::kStationsMax) return Code::station_range;
  if (in.station == 0) return s.results.slab_record.res_seq != 0 ? Code::ok : Code::wrong_slab;
  // After its end the last slab's stations can be queried until the next one begins. An aborted slab has no results.
  const bool has_ended = s.slab.phase == SlabPhase::none;
  const bool has_results = s.slab.result.verdict != Verdict::none && s.slab.result.verdict != Verdict::aborted;
  if (has_ended && (s.slab.header.key == 0 || !has_results)) return Code::wrong_slab;
  return s.slab.stations[in.station - 1U].phase == StationPhase::measured ? Code::ok : Code::wrong_slab;
}

Code check_content(const Station& s, const PlcInputs& in) {
  if (!in.crc_ok) return Code::bad_crc;
  if (in.command < 1 || in.command > 5) return Code::unknown_command;
  if (!in.enable || !s.plc.alive) return Code::not_enabled;
  // During maintenance the line is not enabled, because a scan would show the target of the calibration.
  const bool inspects = in.command <= static_cast<std::uint16_t>(PlcCommand::slab_end);
  if (in_maintenance(s) && inspects) return Code::not_enabled;
  // Room for this command's jobs and for those of the current measurements.
  if (s.storing.size() + s.measuring + 8 > s.storing.capacity()) return Code::busy;
  // Not wrong_slab, which would say that no slab is open.
  if (s.without_store) return s.settings.fault;
  switch (static_cast<PlcCommand>(in.command)) {
    case PlcCommand::slab_begin: return check_begin(s, in);
    case PlcCommand::scan: return check_scan(s, in);
    case PlcCommand::slab_end: return check_end(s, in, false);
    case PlcCommand::slab_abort: return check_end(s, in, true);
    case PlcCommand::report: return check_report(s, in);
    case PlcCommand::none: break;
  }
  return Code::unknown_command;
}

void journal(Station& s, const PlcInputs& in, Actions& actions) {
  s.command.pending = true;
  s.command.pending_abort = false;
  s.command.pending_inputs = in;
  // The command refused under this number was corrected: REFUSE_SEQ keeps this number only if the new one is refused
  // too.
  if (s.command.refuse_seq == in.cmd_seq) s.command.refuse_seq = s.command.refuse_code = 0;
  PendingStore pending;
  pending.value = in.cmd_seq;
  if (static_cast<PlcCommand>(in.command) == PlcCommand::slab_begin) {
    const BeginSlabJob job = slab_to_begin(s, in);
    s.command.pending_begin = job;
    pending.kind = PendingStore::Kind::begin_slab;
    submit(s, actions, job, pending);
    return;
  }
  CommandJob job;
  job.session = s.command.session;
  job.cmd_seq = in.cmd_seq;
  job.command = in.command;
  job.station = static_cast<std::uint8_t>(in.station);
  job.slab_key = s.slab.phase == SlabPhase::none ? 0 : s.slab.header.key;
  job.utime_us = s.utime_us;
  pending.kind = PendingStore::Kind::command;
  submit(s, actions, job, pending);
}

/// Rule (d). Only a command that would be carried out takes over: a display that writes back the block has no effect,
/// soon or late. The first commander of a process needs no change of session, because it can only have read the present
/// one. True if the session changes; this block belongs to the old one.
bool take_over(Station& s, const PlcInputs& in, Actions& actions) {
  if (in.command_writer == s.command.writer) return false;
  const bool takeover = s.command.writer != 0;
  s.command.writer = in.command_writer;
  if (takeover) increment_session(s, actions, "another connection took over the command block");
  return takeover;
}

/// True if both images contain the same command, independent of writer and session.
bool is_same_command(const PlcInputs& a, const PlcInputs& b) {
  return a.command == b.command && a.station == b.station && a.slab_type == b.slab_type && a.slab_no == b.slab_no &&
         a.slab_id == b.slab_id;
}

/// True if SESSION_ECHO is byte-swapped. It is the only value of a block that is known in advance. It detects a PLC
/// that sends the low byte first; otherwise its CMD_SEQ, which is wrong too, would be reported as out of sequence.
bool is_byte_swapped(std::uint16_t echo, std::uint16_t session) {
  return echo != session && static_cast<std::uint16_t>(echo << 8U | echo >> 8U) == session;
}

/// True for a SLAB_END that will be given again once the fault is reset; the line may have moved on by then.
bool is_end_in_fault(const Station& s, const PlcInputs& in, Code refusal) {
  return static_cast<PlcCommand>(in.command) == PlcCommand::slab_end && refusal == current_fault(s) &&
         s.slab.phase == SlabPhase::open && names_open_slab(s, in);
}

void judge_command(Station& s, const PlcInputs& in, Actions& actions) {
  CommandState& state = s.command;
  if (in.command_writer == 0) return;
  // An unchanged block is evaluated once. A block that was written again is evaluated again if CMD_ACK has moved since,
  // because a number that came too early may be right now.
  const bool looked_at = in.cmd_seq == state.judged_seq && in.session_echo == state.judged_echo &&
                         in.command_writer == state.judged_writer &&
                         (in.command_writes == state.judged_writes || state.ack == state.judged_ack);
  if (looked_at) return;
  state.judged_seq = in.cmd_seq;
  state.judged_echo = in.session_echo;
  state.judged_writer = in.command_writer;
  state.judged_writes = in.command_writes;
  state.judged_ack = state.ack;
  if (in.cmd_seq == 0) return;

  if (in.cmd_seq == state.ack) {
    // The same command again, late or after a restart: CMD_ACK already acknowledges it. Another command with this
    // number is from a second writer with the same count. Without a refusal that writer would take CMD_ACK for its own.
    const PlcInputs& known = state.pending_inputs;
    if (known.cmd_seq == in.cmd_seq && !is_same_command(known, in))
      refuse(s, in, Code::bad_sequence, actions);
    else if (known.cmd_seq != in.cmd_seq || known.session_echo != in.session_echo ||
             known.command_writer != in.command_writer)
      ++state.refused;  // except for the PLC, which writes it again if no answer came
    return;
  }
  // The block that is being journalled, written back by another connection.
  const PlcInputs& under_way = state.pending_inputs;
  if (state.pending && in.cmd_seq == under_way.cmd_seq && in.session_echo == under_way.session_echo &&
      is_same_command(in, under_way))
    return;
  if (is_byte_swapped(in.session_echo, state.session)) {
    refuse(s, in, Code::bad_crc, actions);
  } else if (state.session != state.session_next || in.session_echo != state.session) {
    refuse(s, in, Code::stale_session, actions);
  } else if (state.pending || (holds(Rule::command_number_next) && in.cmd_seq != next_sequence(state.ack))) {
    refuse(s, in, Code::bad_sequence, actions);
  } else if (take_over(s, in, actions)) {
    refuse(s, in, Code::stale_session, actions);
  } else if (const Code code = check_content(s, in); code != Code::ok) {
    if (is_end_in_fault(s, in, code)) freeze_gauges(s, actions);
    refuse(s, in, code, actions);
  } else {
    journal(s, in, actions);
  }
}

/// RES_ACK is a level that lasts until the next record, so it acknowledges a record only if it was set after the record
/// was shown. A value from before belongs to another record (number_record).
void acknowledge(Station& s, const PlcInputs& in, Actions& actions) {
  if (in.res_ack != s.results.ack_before) s.results.ack_before = 0;
  if (s.results.queue.empty() || in.res_ack != s.results.queue.front().res_seq || s.results.ack_before != 0) return;
  if (s.storing.size() + 8 > s.storing.capacity()) return;  // repeated at the PLC's next write
  s.results.queue.pop();
  store_acknowledgement(s, in.res_ack, actions);
}

void beat(Station& s, const PlcInputs& before, const PlcInputs& in, Actions& actions) {
  if (in.heartbeat == before.heartbeat) return;
  s.plc.changed_ns = s.now_ns;
  if (s.plc.alive) return;
  s.plc.alive = true;
  if (s.plc.was_lost) increment_session(s, actions, "the PLC heartbeat returned");
}

}  // namespace

void set_status(Station& s, std::uint16_t cmd_seq, std::uint16_t status) {
  if (s.command.ack == cmd_seq) s.command.status = status;
}

bool room_for_records(const Station& s, std::size_t more) {
  std::size_t promised = s.results.queue.size() + s.measuring;
  for (const PendingStore& pending : s.storing)
    promised += pending.kind == PendingStore::Kind::report || pending.kind == PendingStore::Kind::slab ? 1 : 0;
  return promised + more <= limits::kResultQueueMax;
}

/// The new number is shown only once it is durable; until then every command is stale. Otherwise a restart could count
/// back to a session already used. A number that is being stored was not shown yet, so a further reason to change needs
/// no further number.
void increment_session(Station& s, Actions& actions, const char* why) {
  const bool under_way = std::any_of(s.storing.begin(), s.storing.end(), [](const PendingStore& pending) {
    return pending.kind == PendingStore::Kind::session;
  });
  if (under_way) return;
  s.command.session_next = next_sequence(s.command.session_next);
  if (!holds(Rule::session_after_commit)) s.command.session = s.command.session_next;
  ++s.command.sessions_unsaid;
  if (s.command.session_limit.permits(s.now_ns)) {
    log(actions, LogLine::Level::info, Code::ok, "session %u: %s%s", s.command.session_next, why,
        s.command.sessions_unsaid > 1 ? " (and others since the last line)" : "");
    s.command.sessions_unsaid = 0;
  }
  PendingStore pending;
  pending.kind = PendingStore::Kind::session;
  pending.value = s.command.session_next;
  submit(s, actions, SessionJob{s.command.session_next}, pending);
}

void watch_heartbeat(Station& s, Actions& actions) {
  if (!s.plc.alive || s.now_ns - s.plc.changed_ns <= s.settings.heartbeat_lost_ns) return;
  s.plc.alive = false;
  s.plc.was_lost = true;
  log(actions, LogLine::Level::warning, Code::not_enabled,
      "PLC heartbeat lost; the current scan is completed, new commands are refused");
}

void on_plc(Station& s, const PlcInputs& in, Actions& actions) {
  const PlcInputs before = s.plc.inputs;
  s.plc.inputs = in;
  note_plc_gauges(s, in);
  if (!s.recovered) return;
  beat(s, before, in, actions);
  if (in.sync_req != before.sync_req) increment_session(s, actions, "the PLC requested synchronisation");
  if (in.fault_reset && !before.fault_reset && s.fault != 0) {
    log(actions, LogLine::Level::info, Code::ok, "fault %u reset by the PLC", s.fault);
    s.fault = 0;
    if (s.command.session != s.command.session_next) increment_session(s, actions, "storage is tried again");
  }
  if (in.abort && !before.abort) {
    abort_acquisition(s, actions);
    abort_shot(s, actions);
  }
  acknowledge(s, in, actions);
  judge_command(s, in, actions);
}

void begin_command(Station& s, Actions& actions) {
  const PlcInputs in = s.command.pending_inputs;
  s.command.ack = in.cmd_seq;
  set_status(s, in.cmd_seq, CommandStatus::accepted);
  switch (static_cast<PlcCommand>(in.command)) {
    case PlcCommand::slab_begin:
      open_slab(s, s.command.pending_begin);
      set_status(s, in.cmd_seq, CommandStatus::done);
      log(actions, LogLine::Level::info, Code::ok, "slab %u \"%s\" begun, recipe %s", s.slab.header.slab_no,
          s.slab.header.slab_id.c_str(), s.slab.header.recipe.c_str());
      if (const std::uint16_t dk = s.slab.header.temperature_dk; dk != 0 && !has_value(slab_temperature_c(dk)))
        log(actions, LogLine::Level::warning, Code::ok,
            "SLAB_TEMPERATURE (HR 32) is %.1f K = %.1f deg C, allowed are %.0f..%.0f: taken as unknown", 0.1 * dk,
            0.1 * dk - kKelvinAtZero_c, kSlabTemperatureMin_c, kSlabTemperatureMax_c);
      break;
    case PlcCommand::scan: begin_acquisition(s, in, actions); break;
    case PlcCommand::slab_end: begin_end(s, in.cmd_seq, false, actions); break;
    case PlcCommand::slab_abort: begin_end(s, in.cmd_seq, true, actions); break;
    case PlcCommand::report: {
      PlcResult record = s.results.slab_record;
      if (in.station != 0) {
        const StationRecord& row = s.slab.stations[in.station - 1U];
        record = s.slab.phase == SlabPhase::none ? station_record(row.block, s.slab.result) : station_record(row.block);
        record.cmd_seq = row.attempt.cmd_seq;
        record.slab_no = s.slab.header.slab_no;
        record.scan_utime_us = row.attempt.scan_utime_us;
        record.emulated = s.slab.header.emulated;
      }
      number_record(s, record);
      PendingStore pending;
      pending.kind = PendingStore::Kind::report;
      pending.value = in.cmd_seq;
      pending.record = record;
      submit(s, actions, ReportJob{record}, pending);
      break;
    }
    case PlcCommand::none: break;
  }
}

// A slab's begin and end. SLAB_END waits for the blocks still being measured and has the slab judged; no result is
// shown until the verdict is durable. SLAB_ABORT works the same way with the verdict "aborted".

namespace {

/// Result of an aborted slab. Failures of its blocks stay. A pass does not, because it was provisional: height, spacing
/// and slope in the slab's frame were never judged and may change it.
SlabResult aborted_result(const Station& s) {
  SlabResult result;
  result.verdict = Verdict::aborted;
  result.reason = static_cast<std::uint16_t>(Code::interrupted);
  for (std::size_t i = 0; i < s.slab.stations.size(); ++i) {
    const StationRecord& record = s.slab.stations[i];
    if (record.phase != StationPhase::measured || record.block.verdict == Verdict::pass) continue;
    result.station_verdict[i] = record.block.verdict;
    result.station_reason[i] = record.block.reason;
  }
  return result;
}

void store_end(Station& s, const SlabResult& result, Actions& actions) {
  s.slab.phase = SlabPhase::storing_end;
  s.slab.result = result;
  PendingStore pending;
  pending.kind = PendingStore::Kind::slab;
  pending.slab_key = s.slab.header.key;
  pending.value = s.slab.end_seq;
  pending.record = slab_record(result, s.slab.header.stations);
  pending.record.cmd_seq = s.slab.end_seq;
  pending.record.slab_no = s.slab.header.slab_no;
  pending.record.scan_utime_us = s.utime_us;
  pending.record.emulated = s.slab.header.emulated;
  number_record(s, pending.record);
  submit(s, actions, SlabJob{s.slab.header.key, result, pending.record, s.utime_us}, pending);
}

}  // namespace

/// Assigns the next number, but never the present value of RES_ACK. After a restored database, or with a PLC that
/// counts ahead, the record would count as acknowledged before it was read.
void number_record(Station& s, PlcResult& record) {
  s.results.last_seq = next_sequence(s.results.last_seq);
  if (s.results.last_seq == s.plc.inputs.res_ack) s.results.last_seq = next_sequence(s.results.last_seq);
  record.res_seq = s.results.last_seq;
}

BeginSlabJob slab_to_begin(const Station& s, const PlcInputs& in) {
  const Recipe* recipe = recipe_for(s, in.slab_type);
  assert(recipe != nullptr);
  BeginSlabJob job;
  job.session = s.command.session;
  job.cmd_seq = in.cmd_seq;
  SlabHeader& slab = job.slab;
  slab.key = s.last_slab_key + 1;
  slab.slab_id = id_text(in.slab_id);
  slab.slab_no = in.slab_no;
  slab.slab_type = in.slab_type;
  slab.stations = recipe->stations();
  slab.temperature_dk = in.slab_temperature_dk;
  slab.age_h = in.slab_age_h;
  slab.mould = mould_of(s, in).value_or(0);  // it was checked before
  slab.recipe = recipe->name;
  slab.recipe_sha256 = recipe->sha256;
  if (const DesignSheet* const sheet = design_for(s, *recipe, in)) {
    slab.design_sha256 = sheet->sha256;
    slab.design_text = sheet->text;
  }
  slab.unconfirmed = static_cast<std::uint16_t>(unconfirmed_count(*recipe));
  slab.guard = recipe->guard;
  slab.cell_mm = recipe->evaluation.cell_mm;
  slab.software = s.settings.software;
  slab.T_base_slab = s.settings.T_base_slab;
  put_calibrations(s, slab);
  slab.began_utime_us = s.utime_us;
  slab.emulated = static_cast<std::uint8_t>(s.settings.simulation ? kEmulatedLine : 0U);
  return job;
}

void open_slab(Station& s, const BeginSlabJob& job) {
  s.last_slab_key = job.slab.key;
  s.views.begin_slab();
  s.slab = {};
  s.slab.phase = SlabPhase::open;
  s.slab.header = job.slab;
  s.slab.recipe = recipe_for(s, job.slab.slab_type);
  s.slab.facts = facts_of(job.slab);
  s.gauges.slab_begin_ns = s.now_ns;
  s.gauges.end_before_start = false;
  show_disposition(s, Disposition::none);
  take_calibrations(s);
  s.newest_time.note(job.slab.began_utime_us);
}

void begin_end(Station& s, std::uint16_t cmd_seq, bool aborting, Actions& actions) {
  s.slab.phase = SlabPhase::ending;
  s.slab.end_seq = cmd_seq;
  s.slab.aborting = aborting;
  if (!aborting) return freeze_gauges(s, actions);
  abort_acquisition(s, actions);
  drop_measurements(s);
}

void advance_end(Station& s, Actions& actions) {
  if (s.slab.phase != SlabPhase::ending || s.acquisition.phase != Acquisition::Phase::none || s.measuring != 0) return;
  if (s.now_ns == 0) return;  // at a restart no record is made before the time is known
  // A SLAB_ABORT may be on its way to the journal: a slab has one end.
  if (holds(Rule::one_end_per_slab) && s.command.pending) return;
  if (s.slab.aborting) {
    store_end(s, aborted_result(s), actions);
    return;
  }
  // After a restart or a storage fault a durable cloud may still have to be measured; remeasure() does that.
  const bool waiting = std::any_of(s.slab.stations.begin(), s.slab.stations.end(),
                                   [](const StationRecord& record) { return record.phase == StationPhase::acquired; });
  if (waiting || s.slab.judging) return;
  s.slab.judging = true;
  emit(actions, JudgeSlab{s.slab.header.key, slab_basis(s)});
}

void on_slab_judged(Station& s, const SlabJudged& judged, Actions& actions) {
  if (s.slab.phase != SlabPhase::ending || judged.slab_key != s.slab.header.key) return;
  s.slab.judging = false;
  // As in advance_end(), which asks again.
  if (holds(Rule::one_end_per_slab) && (s.command.pending || s.slab.aborting)) return;
  store_end(s, judged.slab, actions);
}

}  // namespace slabd::daemon
