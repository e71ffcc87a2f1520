// SPDX-License-Identifier: Apache-2.0
//
// The answer to a status request on the control socket. Control path: heap and exceptions of the JSON library stay in
// here.
#include <exception>
#include <fstream>
#include <nlohmann/json.hpp>

#include "daemon/loop.h"

namespace slabd::daemon {
namespace {

using Json = nlohmann::ordered_json;

std::string_view state_name(PlcState state) {
  switch (state) {
    case PlcState::init: return "init";
    case PlcState::recover: return "recover";
    case PlcState::idle: return "idle";
    case PlcState::slab_open: return "slab_open";
    case PlcState::settling: return "settling";
    case PlcState::scanning: return "scanning";
    case PlcState::waiting_for_plc: return "waiting_for_plc";
    case PlcState::fault: return "fault";
    case PlcState::maintenance: return "maintenance";
  }
  return "unknown";
}

Json warnings(std::uint16_t bits) {
  Json list = Json::array();
  const auto add = [&](std::uint16_t bit, const char* text) {
    if ((bits & bit) != 0) list.push_back(text);
  };
  add(kWarnUnconfirmedNominals, "a verdict depends on nominals or tolerances nobody has confirmed");
  add(kWarnCommissioningCalibration, "commissioning calibration: no calibration has been applied yet");
  add(kWarnStrayFiles, "files that answer no request were moved to stray/");
  add(kWarnResultsWaiting, "more than a slab of results waits for RES_ACK");
  add(kWarnClockBackwards, "the wall clock is older than the newest record");
  add(kWarnRecipeUnusable, "a recipe file could not be used");
  add(kWarnDiskLow, "a slab was refused because the spool disk is nearly full");
  add(kWarnControlSocket, "the control socket could not be opened");
  return list;
}

/// Paths may hold any bytes; what is not UTF-8 becomes U+FFFD instead of an exception.
std::string text_of(const Json& json) {
  return json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

std::string refusal(const char* text) {
  return text_of(Json{{"schema", "slabd.error/1"}, {"error", text}});
}

/// "VmRSS" and the like from /proc/self/status, in kB; 0 where there is none.
std::int64_t memory_kb(const std::string& key) {
  std::ifstream status("/proc/self/status");
  std::string line;
  while (std::getline(status, line))
    if (line.rfind(key + ":", 0) == 0) return std::strtoll(line.c_str() + key.size() + 1, nullptr, 10);
  return 0;
}

}  // namespace

std::string status_json(const Station& station, const Ports& ports, const LoopFigures& figures) {
  const PlcOutputs view = plc_view(station);
  const Code fault = static_cast<Code>(view.fault);
  const Code pose = station.gate.link(station.now_ns);
  Json j;
  j["schema"] = "slabd.status/1";
  j["software"] = station.settings.software.view();
  j["state"] = state_name(view.state);
  j["fault"] = {{"code", view.fault}, {"text", describe(fault)}, {"cure", cure(fault)}};
  j["warn"] = warnings(view.warn);
  j["session"] = view.session;
  const bool open = station.slab.phase != SlabPhase::none;
  j["slab"] = open ? Json{{"no", view.slab_no},
                          {"id", station.slab.header.slab_id.view()},
                          {"type", view.slab_type},
                          {"recipe", station.slab.header.recipe.view()},
                          {"stations_done", view.stations_done},
                          {"stations", station.slab.header.stations},
                          {"mask", view.station_mask}}
                   : Json(nullptr);
  j["links"]["plc"] = {{"clients", ports.plc.clients()}, {"alive", view.plc_link_ok}};
  const hal::PoseLinkCounters& counters = ports.pose.counters();
  j["links"]["pose"] = {{"ok", view.pose_ok},
                        {"code", static_cast<int>(pose)},
                        {"text", ports.pose.trouble().empty() ? describe(pose) : ports.pose.trouble()},
                        {"accepted", counters.accepted},
                        {"foreign", counters.foreign},
                        {"malformed", counters.malformed}};
  j["links"]["scanner"] = {{"online", view.scanner_ok}, {"strays", station.links.stray_files}};
  j["links"]["store"] = {
      {"ok", view.store_ok}, {"commit_last_ms", figures.commit_last_ms}, {"commit_max_ms", figures.commit_max_ms}};
  j["results_pending"] = view.results_pending;
  j["refused"] = {{"count", view.refused}, {"code", view.refuse_code}, {"seq", view.refuse_seq}};
  j["last_slab"] = station.results.slab_no == 0 && station.results.slab_verdict == Verdict::none
                       ? Json(nullptr)
                       : Json{{"no", station.results.slab_no},
                              {"verdict", name(station.results.slab_verdict)},
                              {"reason", station.results.slab_reason}};
  j["blocks"] = {{"measured", figures.blocks_measured},
                 {"measuring", station.measuring},
                 {"last_ms", figures.block_last_ms},
                 {"max_ms", figures.block_max_ms}};
  j["memory"] = {
      {"rss_kb", memory_kb("VmRSS")}, {"peak_kb", memory_kb("VmHWM")}, {"inspection_bytes", limits::kInspectionBytes}};
  j["uptime_s"] = static_cast<double>(station.now_ns - figures.started_ns) / 1e9;
  j["config"] = figures.config_path;
  j["db"] = figures.db_path;
  return text_of(j);
}

std::string answer_control(std::string_view line, const Station& station, const Ports& ports,
                           const LoopFigures& figures) {
  try {
    const Json request = Json::parse(line, nullptr, false);
    if (!request.is_object()) return refusal("a request is one JSON object per line, like {\"verb\":\"status\"}");
    const auto verb = request.find("verb");
    if (verb == request.end() || !verb->is_string()) return refusal("the key \"verb\" is missing or not a string");
    if (*verb != "status") return refusal("unknown verb; known: status");
    return status_json(station, ports, figures);
  } catch (const std::exception&) {
    // Somebody's question must not stop the line.
    return R"({"schema":"slabd.error/1","error":"the daemon could not make an answer"})";
  }
}

}  // namespace slabd::daemon
