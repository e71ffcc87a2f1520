// SPDX-License-Identifier: Apache-2.0
//
// Values of gauges, bound to the slab that they belong to. The newest value of each gauge is kept with its arrival; at
// SLAB_END, before the next slab can send its own, the values are frozen with their states (base/gauge.h).
//
// The PLC's values are taken when GAUGE_SEQ changes, all at once. After a restart nothing is known of values that
// arrived before: in the server's role the registers are empty, and as client slabd takes the first image of the PLC's
// memory as old, because it may be of any age.
#include <algorithm>
#include <cmath>
#include <utility>

#include "daemon/station/parts.h"

namespace slabd::daemon {
namespace {

constexpr double kThousandth = 1e-3;

GaugeMoment moment_of(const Station& s) {
  return {s.slab.header.slab_no, s.gauges.slab_begin_ns, s.now_ns, expiry_utime_us(s)};
}

const GaugeReading* used_before(const Station& s, const GaugeSettings& gauge) {
  return find_gauge(s.gauges.used, gauge.name.view());
}

/// True if the gauge's values say to which slab they belong.
bool names_slab(const Station& s, const GaugeSettings& gauge) {
  return gauge.link != GaugeLink::modbus && s.slab.header.slab_no != 0;
}

/// True if an item of the open slab needs this gauge.
bool is_used(const Station& s, const GaugeName& gauge) {
  if (s.slab.recipe == nullptr) return false;
  for (const GaugeFormula& formula : s.slab.recipe->formulas)
    for (const GaugeName& name : formula.gauges)
      if (name == gauge) return true;
  return false;
}

/// Keeps the newest sample. That of a master does not replace the slab's.
void take(Station& s, std::size_t index, const GaugeSample& sample) {
  (is_of_master(s.settings.gauges[index], sample) ? s.gauges.masters : s.gauges.samples)[index] = sample;
}

void log_reading(Actions& actions, const GaugeReading& reading) {
  log(actions, LogLine::Level::warning, Code::no_gauge, "gauge %s (%s): %s", reading.gauge.c_str(),
      reading.source.c_str(), reason_of(reading.state).data());
}

}  // namespace

void note_plc_gauges(Station& s, const PlcInputs& in) {
  LineGauges& g = s.gauges;
  // Zeros, behind which the values before a lost connection would look new.
  if (!in.gauges_known) return;
  const bool first = !std::exchange(g.plc_seen, true);
  if (in.gauge_seq == g.plc_seq) return;
  g.plc_seq = in.gauge_seq;
  const bool known = in.gauge_seq != 0 && !(first && s.settings.plc_memory_lasts);
  for (std::size_t i = 0; i < s.settings.gauges.size(); ++i) {
    const GaugeSettings& gauge = s.settings.gauges[i];
    if (gauge.link != GaugeLink::plc) continue;
    const std::int32_t number = in.gauge_thousandths[gauge.plc_index];
    if (!known) {
      g.samples[i] = g.masters[i] = {};
      continue;
    }
    GaugeSample sample;
    sample.slab_no = in.gauge_slab_no;
    if (number != kNoGaugeRegister)
      sample = {true, gauge.scale * kThousandth * number, in.gauge_seq, in.gauge_slab_no, s.now_ns, s.utime_us};
    take(s, i, sample);
  }
}

void on_gauges_sampled(Station& s, const GaugesSampled& sampled) {
  for (std::size_t i = 0; i < s.settings.gauges.size(); ++i) {
    const GaugeLink link = s.settings.gauges[i].link;
    if (link == GaugeLink::modbus || link == GaugeLink::udp) take(s, i, (*sampled.samples)[i]);
  }
}

void on_gauge_entered(Station& s, const GaugeEntered& entered, Actions& actions) {
  if (entered.index >= s.settings.gauges.size()) return;
  const GaugeSettings& gauge = s.settings.gauges[entered.index];
  GaugeSample sample = newest_sample(s, entered.index);
  // Seconds as a start, so that the numbers do not repeat after a restart.
  const auto start = static_cast<std::uint32_t>(s.utime_us / 1'000'000);
  const std::uint32_t seq = std::max(start, sample.seq + 1);
  sample = {true, gauge.scale * entered.value, seq, entered.slab_no, s.now_ns, s.utime_us};
  take(s, entered.index, sample);
  log(actions, LogLine::Level::info, Code::ok, "gauge %s: %.4f %s entered for slab %u by uid %u", gauge.name.c_str(),
      sample.value, name(gauge.unit).data(), entered.slab_no, entered.uid);
}

void on_gauge_checked(Station& s, const GaugeCheck& check) {
  for (std::size_t i = 0; i < s.settings.gauges.size(); ++i)
    if (s.settings.gauges[i].name == check.gauge) s.gauges.checks[i] = check;
}

void recover_gauges(Station& s, const RecoveredLine& line) {
  for (const GaugeCheck& check : line.gauge_checks) on_gauge_checked(s, check);
  s.gauges.runs = line.gauge_runs;
  s.gauges.used = line.gauges_used;
  s.gauges.end_before_start = line.slab_open && line.end_was_given;
}

const GaugeSample& newest_sample(const Station& s, std::size_t index) {
  const GaugeSample& sample = s.gauges.samples[index];
  const GaugeSample& master = s.gauges.masters[index];
  return master.has_value && (!sample.has_value || master.mono_ns >= sample.mono_ns) ? master : sample;
}

GaugeReading gauge_reading(const Station& s, std::size_t index) {
  const GaugeSettings& gauge = s.settings.gauges[index];
  const GaugeMoment moment = moment_of(s);
  // On a line that does not number its slabs, no value names one.
  const GaugeSample& sample = moment.slab_no == 0 ? newest_sample(s, index) : s.gauges.samples[index];
  GaugeReading reading = bind(gauge, sample, s.gauges.checks[index], used_before(s, gauge), moment);
  if (reading.state == GaugeState::ok && s.gauges.end_before_start && !names_slab(s, gauge))
    reading.state = GaugeState::other_slab;
  return reading;
}

void freeze_gauges(Station& s, Actions& actions) {
  // A SLAB_END that a fault hindered is given again, when the next slab may be in the gauges already. Good readings
  // stay, and every reading whose value does not name a slab.
  const GaugeReadings before = std::exchange(s.slab.facts.gauges, {});
  for (std::size_t i = 0; i < s.settings.gauges.size(); ++i) {
    const GaugeSettings& gauge = s.settings.gauges[i];
    const GaugeReading* const first = find_gauge(before, gauge.name.view());
    const bool stays = first != nullptr && (first->state == GaugeState::ok || !names_slab(s, gauge));
    const GaugeReading reading = stays ? *first : gauge_reading(s, i);
    const bool is_new = first == nullptr || first->state != reading.state;
    if (is_new && reading.state != GaugeState::ok && is_used(s, reading.gauge)) log_reading(actions, reading);
    (void)s.slab.facts.gauges.push(reading);
  }
}

void note_used_gauges(Station& s, const SlabResult& result, Actions& actions) {
  if (result.gauges.empty()) return;
  s.gauges.used = result.gauges;
  add_slab(s.gauges.runs, result.gauges);
  for (const GaugeReading& reading : result.gauges)
    if (reading.state == GaugeState::not_plausible) log_reading(actions, reading);
  for (const GaugeRun& run : s.gauges.runs)
    if (run.slabs == limits::kGaugeStuckSlabs)
      log(actions, LogLine::Level::warning, Code::no_gauge,
          "gauge %s has given %.4f for %d slabs in a row: is the sensor stuck, or its cable off?", run.gauge.c_str(),
          run.value, run.slabs);
}

const GaugeRun* run_of(const Station& s, std::string_view gauge) {
  const auto found =
      std::find_if(s.gauges.runs.begin(), s.gauges.runs.end(), [&](const GaugeRun& run) { return run.gauge == gauge; });
  return found == s.gauges.runs.end() ? nullptr : found;
}

bool gauges_need_care(const Station& s) {
  for (std::size_t i = 0; i < s.settings.gauges.size(); ++i) {
    const GaugeSettings& gauge = s.settings.gauges[i];
    if (check_state(gauge, s.gauges.checks[i], expiry_utime_us(s)) != GaugeState::ok) return true;
    const GaugeRun* const run = run_of(s, gauge.name.view());
    if (run != nullptr && run->is_stuck()) return true;
  }
  return false;
}

}  // namespace slabd::daemon
