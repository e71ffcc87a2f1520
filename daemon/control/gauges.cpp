// SPDX-License-Identifier: Apache-2.0
//
// The verb "gauges" of the control socket: what every gauge reads now, its master check, and whether its value would
// count for the slab; and "gauge_enter", by which a person enters a value. Control path: heap and exceptions of the
// JSON library are confined to the files of this folder.
#include <cmath>
#include <nlohmann/json.hpp>

#include "daemon/loop.h"
#include "daemon/station/parts.h"

namespace slabd::daemon {
namespace {

using Json = nlohmann::ordered_json;

Json number(double value) {
  return std::isfinite(value) ? Json(value) : Json(nullptr);
}

Json master_json(const Station& s, const GaugeSettings& gauge, const GaugeCheck& check) {
  if (!gauge.master.given) return nullptr;
  const GaugeState state = check_state(gauge, check, expiry_utime_us(s));
  Json j{{"value", gauge.master.value},
         {"u", gauge.master.u},
         {"limit", gauge.master.limit},
         {"every_h", static_cast<double>(gauge.master.every_us) / 3.6e9},
         {"state", state == GaugeState::ok ? "ok" : name(state)}};
  j["check"] = check.utime_us == 0 ? Json(nullptr)
                                   : Json{{"utime_us", check.utime_us},
                                          {"value", check.value},
                                          {"deviation", check.value - check.master_value},
                                          {"passed", check.passed},
                                          {"due_utime_us", check.utime_us + gauge.master.every_us}};
  return j;
}

Json gauge_json(const Station& s, const Ports& ports, std::size_t index) {
  const GaugeSettings& gauge = s.settings.gauges[index];
  const GaugeSample& sample = newest_sample(s, index);
  const GaugeReading reading = gauge_reading(s, index);
  const GaugeRun* const run = run_of(s, gauge.name.view());
  const hal::ScannerText trouble = ports.gauges == nullptr ? hal::ScannerText() : ports.gauges->trouble(index);
  Json j{{"name", gauge.name.view()},
         {"unit", name(gauge.unit)},
         {"source", gauge.source.view()},
         {"channel", gauge.channel.view()},
         {"u", gauge.u},
         {"valid_s", static_cast<double>(gauge.valid_ns) / 1e9},
         {"value", sample.has_value ? number(sample.value) : Json(nullptr)},
         {"age_s", sample.has_value ? Json(static_cast<double>(s.now_ns - sample.mono_ns) / 1e9) : Json(nullptr)},
         {"utime_us", sample.utime_us},
         {"seq", sample.seq},
         {"slab_no", sample.slab_no},
         {"state", name(reading.state)},
         {"reason", reason_of(reading.state)},
         {"trouble", trouble.view()},
         {"same_slabs", run == nullptr ? 0 : run->slabs},
         {"stuck", run != nullptr && run->is_stuck()}};
  j["master"] = master_json(s, gauge, s.gauges.checks[index]);
  return j;
}

}  // namespace

std::string gauges_json(const Station& s, const Ports& ports) {
  Json j;
  j["schema"] = "slabd.gauges/1";
  const bool open = s.slab.phase != SlabPhase::none;
  j["slab_no"] = open ? Json(s.slab.header.slab_no) : Json(nullptr);
  j["gauges"] = Json::array();
  for (std::size_t i = 0; i < s.settings.gauges.size(); ++i) j["gauges"].push_back(gauge_json(s, ports, i));
  const hal::GaugeCounters counters = ports.gauges == nullptr ? hal::GaugeCounters{} : ports.gauges->counters();
  j["udp"] = {{"accepted", counters.accepted},
              {"repeated", counters.repeated},
              {"unknown", counters.unknown},
              {"malformed", counters.malformed},
              {"foreign", counters.foreign}};
  return j.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

Result<GaugeEntered> parse_gauge_entry(std::string_view line, const Station& s, std::uint32_t uid) {
  const Json request = Json::parse(line, nullptr, false);
  if (!request.is_object()) return error(Code::config, "a request is one JSON object");
  const auto gauge = request.find("gauge");
  const auto value = request.find("value");
  const auto slab_no = request.find("slab_no");
  if (gauge == request.end() || !gauge->is_string())
    return error(Code::config, "\"gauge\" must be the name of a gauge");
  if (value == request.end() || !value->is_number() || !std::isfinite(value->get<double>()))
    return error(Code::config, "\"value\" must be a number");
  if (slab_no == request.end() || !slab_no->is_number_unsigned() || slab_no->get<std::uint64_t>() > 0xFFFF'FFFFU)
    return error(Code::config, "\"slab_no\" must be the number of the slab that was measured, 0..4294967295");
  if (uid == hal::ControlPort::kUidUnknown) return error(Code::config, "the user of this request is unknown");
  const auto& wanted = gauge->get_ref<const std::string&>();
  for (std::size_t i = 0; i < s.settings.gauges.size(); ++i) {
    const GaugeSettings& known = s.settings.gauges[i];
    if (!(known.name == wanted)) continue;
    if (known.link != GaugeLink::manual)
      return error(Code::config, "the values of %s come from %s; only those of source \"operator\" are entered",
                   known.name.c_str(), known.source.c_str());
    return GaugeEntered{i, value->get<double>(), slab_no->get<std::uint32_t>(), uid};
  }
  return error(Code::config, "there is no gauge %.40s in the configuration", wanted.c_str());
}

}  // namespace slabd::daemon
