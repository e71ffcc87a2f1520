// SPDX-License-Identifier: Apache-2.0
//
// A slab's begin and end. SLAB_END waits for the blocks still being measured, has the slab judged, and shows nothing
// until the verdict is durable. SLAB_ABORT takes the same way with the verdict "aborted".
#include <algorithm>

#include "daemon/station/parts.h"

namespace slabd::daemon {
namespace {

/// What the blocks have against them stays. A pass does not: it was provisional, and height, spacing and slope in the
/// slab's frame, which may turn it over, were never judged.
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

/// Never the number that stands in RES_ACK: after a database was restored, or with a PLC that counts ahead, the record
/// would be taken for acknowledged before anybody has seen it.
void number_record(Station& s, PlcResult& record) {
  s.results.last_seq = next_sequence(s.results.last_seq);
  if (s.results.last_seq == s.plc.inputs.res_ack) s.results.last_seq = next_sequence(s.results.last_seq);
  record.res_seq = s.results.last_seq;
}

BeginSlabJob slab_to_begin(const Station& s, const PlcInputs& in) {
  const Recipe* recipe = recipe_for(s, in.slab_type);
  assert(recipe != nullptr);
  BeginSlabJob job;
  job.session = s.desk.session;
  job.cmd_seq = in.cmd_seq;
  SlabHeader& slab = job.slab;
  slab.key = s.last_slab_key + 1;
  const auto id_end = std::find(in.slab_id.begin(), in.slab_id.end(), '\0');
  slab.slab_id = std::string_view(in.slab_id.data(), static_cast<std::size_t>(id_end - in.slab_id.begin()));
  slab.slab_no = in.slab_no;
  slab.slab_type = in.slab_type;
  slab.stations = recipe->stations();
  slab.temperature_dk = in.slab_temperature_dk;
  slab.age_h = in.slab_age_h;
  slab.recipe = recipe->name;
  slab.recipe_sha256 = recipe->sha256;
  slab.unconfirmed = static_cast<std::uint16_t>(unconfirmed_count(*recipe));
  slab.guard = recipe->guard;
  slab.cell_mm = recipe->evaluation.cell_mm;
  slab.calibration_id = s.calibration.id;
  if (const StationsInForce* table = usable_table(s, in.slab_type)) slab.stations_id = table->id;
  slab.scanner_id = s.calibration.scanner.id;
  slab.software = s.settings.software;
  slab.T_base_slab = s.settings.T_base_slab;
  slab.T_flange_scanner = s.calibration.hand_eye.T_flange_scanner;
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
  s.slab.calibration = s.calibration;
  s.newest_time.note(job.slab.began_utime_us);
}

void begin_end(Station& s, std::uint16_t cmd_seq, bool aborting, Actions& actions) {
  s.slab.phase = SlabPhase::ending;
  s.slab.end_seq = cmd_seq;
  s.slab.aborting = aborting;
  if (!aborting) return;
  abort_acquisition(s, actions);
  drop_measurements(s);
}

void advance_end(Station& s, Actions& actions) {
  if (s.slab.phase != SlabPhase::ending || s.acquisition.phase != Acquisition::Phase::none || s.measuring != 0) return;
  if (s.now_ns == 0) return;   // at a restart: without a time nothing is recorded
  if (s.desk.pending) return;  // a SLAB_ABORT may be on its way to the journal: a slab has one end
  if (s.slab.aborting) {
    store_end(s, aborted_result(s), actions);
    return;
  }
  // After a restart or a storage fault a durable cloud may still wait to be measured; remeasure() takes it up.
  const bool waiting = std::any_of(s.slab.stations.begin(), s.slab.stations.end(),
                                   [](const StationRecord& record) { return record.phase == StationPhase::acquired; });
  if (waiting || s.slab.judging) return;
  s.slab.judging = true;
  emit(actions, JudgeSlab{s.slab.header.key, s.slab.header.slab_type});
}

void on_slab_judged(Station& s, const SlabJudged& judged, Actions& actions) {
  if (s.slab.phase != SlabPhase::ending || judged.slab_key != s.slab.header.key) return;
  s.slab.judging = false;
  if (s.desk.pending || s.slab.aborting) return;  // as in advance_end(), which asks again
  store_end(s, judged.slab, actions);
}

}  // namespace slabd::daemon
