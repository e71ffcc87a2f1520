// SPDX-License-Identifier: Apache-2.0
#include "base/gauge.h"

#include <algorithm>
#include <cmath>

namespace slabd {
namespace {

constexpr std::array<FormulaInfo, 4> kFormulas = {{
    {FormulaKind::mean, "mean", 1, limits::kFormulaGaugesMax},
    {FormulaKind::difference, "difference", 2, 2},
    {FormulaKind::range, "range", 2, limits::kFormulaGaugesMax},
    {FormulaKind::plane4_flatness, "plane4_flatness", 4, 4},
}};

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t')) text.remove_suffix(1);
  return text;
}

double square(double v) {
  return v * v;
}

int length(std::string_view text) {
  return static_cast<int>(std::min<std::size_t>(text.size(), 40));
}

/// True if the sample was made for this slab.
bool is_of_slab(const GaugeSettings& gauge, const GaugeSample& sample, const GaugeReading* used,
                const GaugeMoment& slab) {
  if (sample.slab_no == 0)
    return sample.mono_ns >= slab.begin_ns && (slab.slab_no == 0 || !is_of_master(gauge, sample));
  // The slab may be inspected again, and the number is that of the first time.
  const bool was_used = used != nullptr && used->slab_no == sample.slab_no && used->seq == sample.seq;
  return sample.slab_no == slab.slab_no && !was_used;
}

}  // namespace

bool passes(const GaugeCheck& check) {
  return std::abs(check.value - check.master_value) <= check.within;  // false with a NaN
}

std::string_view name(GaugeState state) {
  switch (state) {
    case GaugeState::ok: return "ok";
    case GaugeState::missing: return "missing";
    case GaugeState::other_slab: return "other_slab";
    case GaugeState::stale: return "stale";
    case GaugeState::out_of_range: return "out_of_range";
    case GaugeState::not_plausible: return "not_plausible";
    case GaugeState::unchecked: return "unchecked";
    case GaugeState::check_failed: return "check_failed";
    case GaugeState::check_overdue: return "check_overdue";
  }
  return "missing";
}

GaugeState gauge_state_of(std::string_view text) {
  for (std::size_t i = 0; i < kGaugeStates; ++i)
    if (name(static_cast<GaugeState>(i)) == text) return static_cast<GaugeState>(i);
  return GaugeState::missing;
}

std::string_view reason_of(GaugeState state) {
  switch (state) {
    case GaugeState::ok: return "";
    case GaugeState::missing: return "no value has arrived";
    case GaugeState::other_slab: return "the value belongs to another slab";
    case GaugeState::stale: return "the value is too old";
    case GaugeState::out_of_range: return "the value is outside the measuring range";
    case GaugeState::not_plausible: return "the value is far from the nominal: another unit or another dimension";
    case GaugeState::unchecked: return "it was never checked with this master and source";
    case GaugeState::check_failed: return "its last master check was outside the limit";
    case GaugeState::check_overdue: return "its master check is overdue";
  }
  return "";
}

double master_uncertainty(const GaugeMaster& master) {
  return master.given ? std::hypot(master.u, master.limit / std::sqrt(3.0)) : 0.0;
}

bool is_of_master(const GaugeSettings& gauge, const GaugeSample& sample) {
  return sample.slab_no == 0 && gauge.link != GaugeLink::modbus;
}

GaugeState check_state(const GaugeSettings& gauge, const GaugeCheck& last, std::int64_t utime_us) {
  constexpr std::int64_t kAhead_us = 3'600'000'000;
  const GaugeMaster& master = gauge.master;
  if (!master.given) return GaugeState::ok;
  // A check with another master, of another value of it, or through another register is not a check of this gauge.
  if (last.utime_us == 0 || last.master_value != master.value || last.unit != gauge.unit ||
      !(last.source == gauge.channel))
    return GaugeState::unchecked;
  if (!last.passed || !(std::abs(last.value - master.value) <= master.limit)) return GaugeState::check_failed;
  if (last.utime_us - utime_us > kAhead_us) return GaugeState::unchecked;
  return utime_us - last.utime_us > master.every_us ? GaugeState::check_overdue : GaugeState::ok;
}

GaugeReading bind(const GaugeSettings& gauge, const GaugeSample& sample, const GaugeCheck& last_check,
                  const GaugeReading* used, const GaugeMoment& slab) {
  GaugeReading reading;
  reading.gauge = gauge.name;
  reading.source = gauge.source;
  reading.unit = gauge.unit;
  reading.u = gauge.u;
  reading.u_master = master_uncertainty(gauge.master);
  reading.check_utime_us = gauge.master.given ? last_check.utime_us : 0;
  if (reading.check_utime_us != 0) reading.check_deviation = last_check.value - last_check.master_value;
  if (!sample.has_value) return reading;
  reading.value = sample.value;
  reading.seq = sample.seq;
  reading.slab_no = sample.slab_no;
  reading.utime_us = sample.utime_us;
  // An instrument's thread may be some milliseconds ahead of the time of the turn.
  const std::int64_t age_ns = std::max<std::int64_t>(slab.end_ns - sample.mono_ns, 0);
  reading.age_s = static_cast<double>(age_ns) / 1e9;
  if (!std::isfinite(sample.value))
    reading.state = GaugeState::missing;
  else if (!is_of_slab(gauge, sample, used, slab))
    reading.state = GaugeState::other_slab;
  else if (age_ns > gauge.valid_ns)
    reading.state = GaugeState::stale;
  else if (sample.value < gauge.low || sample.value > gauge.high)
    reading.state = GaugeState::out_of_range;
  else
    reading.state = check_state(gauge, last_check, slab.utime_us);
  return reading;
}

void add_slab(GaugeRuns& runs, const GaugeReadings& readings) {
  for (const GaugeReading& reading : readings) {
    if (!has_value(reading.value)) continue;
    GaugeRun* run = std::find_if(runs.begin(), runs.end(), [&](const GaugeRun& r) { return r.gauge == reading.gauge; });
    if (run == runs.end()) {
      if (!runs.push({reading.gauge, reading.value, 0})) continue;
      run = &runs.back();
    }
    if (run->value != reading.value) *run = {reading.gauge, reading.value, 0};
    ++run->slabs;
  }
}

std::span<const FormulaInfo> formula_infos() {
  return kFormulas;
}

const FormulaInfo& info(FormulaKind kind) {
  static constexpr FormulaInfo kNone{FormulaKind::none, "", 0, 0};
  for (const FormulaInfo& formula : kFormulas)
    if (formula.kind == kind) return formula;
  return kNone;
}

FormulaText text_of(const GaugeFormula& formula) {
  FormulaText text;
  if (!formula.given()) return text;
  text.append(info(formula.kind).name);
  for (std::size_t i = 0; i < formula.gauges.size(); ++i) {
    text.append(i == 0 ? "(" : ", ");
    text.append(formula.gauges[i].view());
  }
  text.append(")");
  return text;
}

bool is_gauge_name(std::string_view name) {
  const auto letter = [](char c) { return c >= 'a' && c <= 'z'; };
  const auto allowed = [&](char c) { return letter(c) || (c >= '0' && c <= '9') || c == '_'; };
  return !name.empty() && name.size() <= limits::kGaugeNameBytes && letter(name.front()) &&
         std::all_of(name.begin(), name.end(), allowed);
}

Result<GaugeFormula> parse_formula(std::string_view text) {
  text = trimmed(text);
  const std::size_t open = text.find('(');
  const std::string_view word = trimmed(text.substr(0, open));
  const FormulaInfo* form = nullptr;
  for (const FormulaInfo& formula : kFormulas)
    if (formula.name == word) form = &formula;
  if (form == nullptr)
    return error(
        Code::config,
        "the form \"%.*s\" is unknown; allowed are mean, difference, range and plane4_flatness of gauges, such "
        "as \"mean(length_left, length_right)\"",
        length(word), word.data());
  if (open == std::string_view::npos || !text.ends_with(')'))
    return error(Code::config, "%s needs its gauges in brackets, such as \"mean(length_left, length_right)\"",
                 form->name.data());
  GaugeFormula formula;
  formula.kind = form->kind;
  std::size_t count = 0;
  for (std::string_view rest = text.substr(open + 1, text.size() - open - 2);; ++count) {
    const std::size_t comma = rest.find(',');
    const std::string_view gauge = trimmed(rest.substr(0, comma));
    if (!is_gauge_name(gauge))
      return error(Code::config,
                   "\"%.*s\" is not the name of a gauge: up to %zu lower-case letters, digits and '_', a letter first",
                   length(gauge), gauge.data(), limits::kGaugeNameBytes);
    for (const GaugeName& other : formula.gauges)
      if (other == gauge) return error(Code::config, "the gauge %.*s is named twice", length(gauge), gauge.data());
    static_cast<void>(formula.gauges.push(GaugeName(gauge)));
    if (comma == std::string_view::npos) break;
    rest.remove_prefix(comma + 1);
  }
  ++count;
  if (count < form->gauges_min || count > form->gauges_max) {
    FixedString<32> allowed;
    allowed.printf(form->gauges_min == form->gauges_max ? "%zu" : "%zu..%zu", form->gauges_min, form->gauges_max);
    return error(Code::config, "%s has %zu gauges, allowed are %s", form->name.data(), count, allowed.c_str());
  }
  return formula;
}

const GaugeReading* find_gauge(const GaugeReadings& readings, std::string_view gauge) {
  for (const GaugeReading& reading : readings)
    if (reading.gauge == gauge) return &reading;
  return nullptr;
}

FormulaValue evaluate(const GaugeFormula& formula, const GaugeReadings& readings) {
  FormulaValue result;
  std::array<const GaugeReading*, limits::kFormulaGaugesMax> of{};
  const std::size_t n = formula.gauges.size();
  for (std::size_t i = 0; i < n; ++i) {
    of[i] = find_gauge(readings, formula.gauges[i].view());
    if (of[i] == nullptr || of[i]->state != GaugeState::ok) return result;
  }
  std::array<double, limits::kFormulaGaugesMax> weight{};
  switch (formula.kind) {
    case FormulaKind::none: return result;
    case FormulaKind::mean: weight.fill(1.0 / static_cast<double>(n)); break;
    case FormulaKind::difference: weight = {1.0, -1.0}; break;
    case FormulaKind::range: {
      const auto less = [](const GaugeReading* a, const GaugeReading* b) { return a->value < b->value; };
      const auto [low, high] = std::minmax_element(of.begin(), of.begin() + static_cast<std::ptrdiff_t>(n), less);
      weight[static_cast<std::size_t>(high - of.begin())] += 1.0;
      weight[static_cast<std::size_t>(low - of.begin())] -= 1.0;
      break;
    }
    case FormulaKind::plane4_flatness: weight = {0.5, -0.5, 0.5, -0.5}; break;
  }
  double sum = 0.0;
  double variance = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    sum += weight[i] * of[i]->value;
    variance += square(weight[i] * of[i]->u);
    result.u_master += std::abs(weight[i]) * of[i]->u_master;
  }
  result.value = formula.kind == FormulaKind::plane4_flatness ? std::abs(sum) : sum;
  result.u_gauge = std::sqrt(variance);
  return result;
}

}  // namespace slabd
