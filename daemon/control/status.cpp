// SPDX-License-Identifier: Apache-2.0
//
// The answer to a status request on the control socket. Control path: heap and exceptions of the JSON library are
// confined to the files of this folder.
#include <unistd.h>

#include <algorithm>
#include <array>
#include <exception>
#include <fstream>
#include <nlohmann/json.hpp>

#include "daemon/log_outlet.h"
#include "daemon/loop.h"
#include "daemon/slab_ends.h"
#include "daemon/station/parts.h"
#include "daemon/station/pose_gate.h"
#include "hal/plc/plc_map.h"
#include "storage/chain.h"

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

constexpr const char* kRecipesDifferText = "the recipe folder differs from the recipes in use";

Json warnings(std::uint16_t bits) {
  Json list = Json::array();
  const auto add = [&](std::uint16_t bit, const char* text) {
    if ((bits & bit) != 0) list.push_back(text);
  };
  add(kWarnUnconfirmedNominals, "a verdict depends on unconfirmed nominals or tolerances");
  add(kWarnCommissioningCalibration, "commissioning calibration: no calibration has been applied yet");
  add(kWarnStrayFiles, "files that answer no request were moved to stray/");
  add(kWarnResultsWaiting, "more than a slab of results waits for RES_ACK");
  add(kWarnClockBackwards, "the wall clock is older than the newest record");
  add(kWarnRecipeUnusable, "a recipe file could not be used");
  add(kWarnDiskLow, "a command was refused because a disk is full or nearly full");
  add(kWarnControlSocket, "the control socket could not be opened");
  add(kWarnCheckOverdue, "the check of the reference block or the monitor ball is overdue (slabctl calibrate check)");
  add(kWarnStationsNotCorrected, "stations were measured without their correction; U rests on the robot's accuracy");
  add(kWarnScannerNotVerified,
      "the scanner is not verified: never, too long ago, out of limits or at another temperature (slabctl scanner "
      "verify)");
  add(kWarnHandednessUnproven, "no applied calibration proves that the scanner's frame is right-handed");
  add(kWarnRecipesDiffer, kRecipesDifferText);
  add(kWarnEmulation, "emulation: robot or scanner is not the real one");
  add(kWarnStopsAlike,
      "the robot stops alike over neighbouring blocks, so that no pose proves of which block a scan is (slabctl "
      "stations)");
  add(kWarnGauge, "a gauge is stuck, or its master check is missing, failed or overdue (slabctl gauge list)");
  return list;
}

/// Paths may contain any bytes; invalid UTF-8 becomes U+FFFD instead of an exception.
std::string text_of(const Json& json) {
  return json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

std::string refusal(const char* text) {
  return text_of(Json{{"schema", "slabd.error/1"}, {"error", text}});
}

std::string refusal(const Error& why) {
  return text_of(Json{{"schema", "slabd.error/1"}, {"error", why.text.view()}, {"code", static_cast<int>(why.code)}});
}

/// True for a request nested too deeply; such requests cost sixty times their length. Valid ones are nearly flat.
/// Brackets in texts are counted too.
bool nests_too_deep(std::string_view line) {
  constexpr int kDepthMax = 32;
  int depth = 0;
  for (const char c : line) {
    if (c == '[' || c == '{') ++depth;
    if (c == ']' || c == '}') --depth;
    if (depth > kDepthMax) return true;
  }
  return false;
}

}  // namespace

std::int64_t memory_kb(const std::string& key) {
  std::ifstream status("/proc/self/status");
  std::string line;
  while (std::getline(status, line))
    if (line.rfind(key + ":", 0) == 0) return std::strtoll(line.c_str() + key.size() + 1, nullptr, 10);
  return 0;
}

namespace {

Json number_or_null(double value) {
  return has_value(value) ? Json(value) : Json(nullptr);
}

/// The acceptance of an arm's scanner; null: it was never accepted.
Json acceptance(const Station& station, std::size_t arm) {
  const ScannerInForce& scanner = station.calibration.arm[arm].scanner;
  if (scanner.id.empty()) return nullptr;
  const bool outside = is_outside_temperature(station, arm);
  return Json{{"id", scanner.id.view()},
              {"scanner", scanner.numbers.scanner.view()},
              {"state", name(acceptance_state(scanner, expiry_utime_us(station), outside))},
              {"expires_utime_us", scanner.expires_utime_us},
              {"temperature_c", number_or_null(scanner.numbers.temperature_c)}};
}

/// Calibration of an arm for the next slab, and checks that are due.
Json in_force(const Station& station, std::size_t arm) {
  const LineCalibration& c = station.calibration.arm[arm];
  static constexpr std::array<const char*, 3> kSources = {"missing", "commissioning", "applied"};
  const std::int64_t now = expiry_utime_us(station);
  Json j;
  j["source"] = kSources.at(static_cast<std::size_t>(c.source));
  j["id"] = c.id.view();
  j["expires_utime_us"] = c.expires_utime_us;
  j["stations"] = Json::array();
  for (const StationsInForce& t : c.tables) {
    int mastered = 0;
    for (const StationCorrection& s : t.table.station) mastered += s.visits != 0 ? 1 : 0;
    const bool expired = t.expires_utime_us != 0 && now >= t.expires_utime_us;
    j["stations"].push_back({{"slab_type", t.table.slab_type},
                             {"id", t.id.view()},
                             {"mastered", mastered},
                             {"state", !(t.hand_eye_id == c.id) ? "stale"
                                       : expired                ? "expired"
                                                                : "used"},
                             {"expires_utime_us", t.expires_utime_us}});
  }
  const std::int64_t interval = station.settings.check_interval_us;
  const auto watch = [&](const LineCalibration::Watch& w) {
    if (w.reference_id.empty()) return Json(nullptr);
    const std::int64_t last = checked_from_utime_us(w);
    return Json{{"id", w.reference_id.view()},
                {"checked_utime_us", w.checked_utime_us},
                {"passed", w.checked_utime_us == 0 ? Json(nullptr) : Json(!w.failed)},
                {"note", w.note.view()},
                {"due_utime_us", interval == 0 ? 0 : last + interval},
                {"overdue", overdue(w, interval, now)}};
  };
  j["reference_block"] = watch(c.block);
  j["monitor_ball"] = watch(c.ball);
  j["scanner"] = acceptance(station, arm);
  return j;
}

/// The tie of the two robots' bases in force; null: there is none.
Json tie_in_force(const Station& station) {
  const TieInForce& tie = station.calibration.tie;
  if (!station.settings.arms.several() || (tie.id.empty() && tie.trouble.empty())) return nullptr;
  const TieFault fault =
      fault_of_tie(station.calibration, station.settings.arms.list[1].robot, expiry_utime_us(station));
  return Json{{"id", tie.id.view()},
              {"robot", tie.numbers.robot.view()},
              {"expires_utime_us", tie.expires_utime_us},
              {"trouble", describe(fault, station.calibration).view()}};
}

/// Slab types that scans can distinguish by the slab's ends only, or not at all.
Json alike(std::span<const Recipe> recipes) {
  Json list = Json::array();
  for (const AlikeRecipes& pair : alike_recipes(recipes))
    list.push_back({{"a", pair.a->name.view()},
                    {"b", pair.b->name.view()},
                    {"ends_differ", pair.ends_differ},
                    {"text", text_of(pair).view()}});
  return list;
}

Json emulation(unsigned bits) {
  Json list = Json::array();
  for (std::size_t i = 0; i < kEmulationNames.size(); ++i)
    if ((bits & (1U << i)) != 0) list.push_back(kEmulationNames[i]);
  return list;
}

template <typename Record>
void put_fields(const Record& record, Json& j) {
  const auto put = [&](std::string_view key, const auto& value) { j[std::string(key)] = value; };
  fields(put, record);
}

Json plc_link(const hal::PlcPort& plc, bool alive, std::int64_t now_ns) {
  const hal::PlcLinkCounters& c = plc.counters();
  Json j{{"clients", plc.clients()}, {"alive", alive}, {"trouble", plc.trouble()}};
  j["last_frame_s"] = c.last_frame_ns == 0 ? Json(nullptr) : Json(static_cast<double>(now_ns - c.last_frame_ns) / 1e9);
  put_fields(c, j);
  return j;
}

/// Remark on accepted poses; empty if there is none.
std::string_view pose_note(const PoseGate& gate, hal::PoseType type) {
  if (gate.newest() == nullptr) return "";
  if (type == hal::PoseType::flange_pose && !gate.newest()->measured)
    return "they are commanded, not measured (flags, bit 0): commanded poses differ from the real ones";
  if (gate.lacks_stopped())
    return "the robot does not say \"stopped\" (flags, bit 1), as it did before: no scan begins until it does";
  return "";
}

Json pose_link(const Ports& ports, std::size_t arm, const Station& station, const LoopFigures& figures) {
  const hal::PosePort& port = ports.pose_of(arm);
  const PoseGate& gate = station.arms[arm].gate;
  const Code code = gate.link(station.now_ns);
  const bool ok = code == Code::ok;
  const std::string_view refusal = port.refusal(station.now_ns);
  std::string text(describe(code));
  if (!port.trouble().empty())
    text = port.trouble();
  else if (code != Code::ok && !refusal.empty())
    text += std::string(": ") + std::string(refusal);
  Json j{{"ok", ok},
         {"code", static_cast<int>(code)},
         {"text", text},
         {"note", ok ? pose_note(gate, figures.pose_type) : ""},
         {"refusal", refusal}};
  put_fields(port.counters(), j);
  j["stale"] = figures.poses[arm].stale;
  j["wrong_frame"] = figures.poses[arm].wrong_frame;
  return j;
}

Json scanner_link(const Ports& ports, std::size_t arm, const Station& station) {
  const LinkStatus& links = station.arms[arm].links;
  return Json{{"online", links.scanner_online},
              {"strays", links.stray_files},
              {"text", ports.scanner_of(arm).trouble().view()}};
}

Json arms_json(const Station& station, const Ports& ports, const LoopFigures& figures) {
  Json list = Json::array();
  for (std::size_t i = 0; i < arm_count(station) && i < ports.arms(); ++i) {
    const Arm& by = station.settings.arms.list[i];
    list.push_back({{"robot", by.robot.view()},
                    {"scanner", by.scanner.view()},
                    {"pose", pose_link(ports, i, station, figures)},
                    {"scanner_link", scanner_link(ports, i, station)},
                    {"calibration", in_force(station, i)},
                    {"acceptance", acceptance(station, i)},
                    {"temperature_c", number_or_null(station.arms[i].scanner_temperature_c)}});
  }
  return list;
}

/// Why no slab can begin: the faults of all arms.
std::string calibration_fault_text(const Station& station) {
  std::string text;
  for (std::size_t i = 0; i < arm_count(station); ++i) {
    const ArmFault fault = arm_fault(station, i);
    if (fault.any()) text += (text.empty() ? "" : "; ") + std::string(describe(station, i, fault).view());
  }
  return text;
}

/// Both register memories as they are on the wire now, in the configured word order.
std::string plc_image_json(const Station& station, const hal::PlcPort& plc, const LoopFigures& figures) {
  hal::InputImage input{};
  hal::encode_outputs(plc_view(station), figures.plc_word_order, input);
  const std::span<const std::uint16_t> holding = plc.holding();
  Json j;
  j["schema"] = "slabd.plc_image/1";
  j["role"] = hal::kPlcRoles.at(static_cast<std::size_t>(figures.plc_role));
  j["word_order"] = figures.plc_word_order == hal::WordOrder::abcd ? "abcd" : "cdab";
  j["trouble"] = plc.trouble();
  j["holding"] = std::vector<std::uint16_t>(holding.begin(), holding.end());
  j["input"] = std::vector<std::uint16_t>(input.begin(), input.end());
  return text_of(j);
}

/// In fault 504: text on another daemon that uses this daemon's folders; empty if there is none.
std::string used_by_another(const Ports& ports, const LoopFigures& figures) {
  for (std::size_t arm = 0; arm < ports.arms(); ++arm)
    if (const hal::ScannerText scanner = ports.scanner_of(arm).used_by_another(); !scanner.empty())
      return std::string(scanner.view());
  return std::string(figures.store_text.view());
}

}  // namespace

double plant_age_s(const storage::Backlog& behind, std::int64_t utime_us) {
  if (behind.oldest_utime_us == 0) return 0.0;
  return static_cast<double>(std::max<std::int64_t>(utime_us - behind.oldest_utime_us, 0)) / 1e6;
}

namespace {

/// How far the plant's database is behind, and from when on that is an alarm; null without one.
Json plant_link(const Station& station, const Ports& ports, const LoopFigures& figures) {
  if (figures.plant_line.empty() || ports.store == nullptr) return nullptr;
  const storage::Backlog behind = ports.store->care().backlog;
  const double age_s = plant_age_s(behind, station.utime_us);
  const double alarm_s = static_cast<double>(figures.plant_alarm_us) / 1e6;
  return Json{{"line", figures.plant_line},
              {"unsent", behind.newest_seq - behind.sent_seq},
              {"unsent_s", age_s},
              {"alarm_s", alarm_s},
              {"late", age_s > alarm_s}};
}

}  // namespace

std::string status_json(const Station& station, const Ports& ports, const LoopFigures& figures) {
  const PlcOutputs view = plc_view(station);
  const Code fault = static_cast<Code>(view.fault);
  Json j;
  j["schema"] = "slabd.status/1";
  j["software"] = station.settings.software.view();
  j["state"] = state_name(view.state);
  j["fault"] = {{"code", view.fault}, {"text", describe(fault)}, {"cure", cure(fault)}};
  if (const std::string other = used_by_another(ports, figures); fault == Code::config && !other.empty()) {
    j["fault"]["text"] = other;
    j["fault"]["cure"] = "stop one of the two daemons, or give each a folder of its own; this one continues by itself";
  }
  if (fault == Code::calibration_missing) j["fault"]["text"] = calibration_fault_text(station);
  j["warn"] = warnings(view.warn);
  if (ports.recipes != nullptr && ports.recipes->differs())
    for (Json& text : j["warn"])
      if (text == kRecipesDifferText) text = ports.recipes->words().view();
  j["warn_bits"] = view.warn;
  j["alike_recipes"] = alike(station.settings.recipes);
  j["emulated"] = view.simulation;
  j["emulation"] = emulation(emulation_shown(station));
  j["emulation_now"] = emulation(unsigned{emulation_of_line(station)} | emulation_of_scans(station));
  j["scanner_temperature_c"] = number_or_null(station.arms[0].scanner_temperature_c);
  j["calibration"] = in_force(station, 0);
  const Capture& capture = station.capture;
  j["maintenance"] = in_maintenance(station)
                         ? Json{{"session", capture.session.view()},
                                {"operator", capture.operator_name.view()},
                                {"views", capture.shot.number},
                                {"lease_left_s", static_cast<double>(capture.lease_until_ns - station.now_ns) / 1e9}}
                         : Json(nullptr);
  j["session"] = view.session;
  const bool open = station.slab.phase != SlabPhase::none;
  j["slab"] = open ? Json{{"no", view.slab_no},
                          {"id", station.slab.header.slab_id.view()},
                          {"type", view.slab_type},
                          {"mould", station.slab.header.mould != 0 ? Json(station.slab.header.mould) : Json(nullptr)},
                          {"recipe", station.slab.header.recipe.view()},
                          {"stations_done", view.stations_done},
                          {"stations", station.slab.header.stations},
                          {"current_station", view.current_station},
                          {"mask", view.station_mask},
                          {"emulated", station.slab.header.emulated != 0}}
                   : Json(nullptr);
  j["links"]["plc"] = plc_link(ports.plc, view.plc_link_ok, station.now_ns);
  j["links"]["pose"] = pose_link(ports, 0, station, figures);
  j["links"]["scanner"] = scanner_link(ports, 0, station);
  j["links"]["store"] = {{"ok", view.store_ok},
                         {"text", view.store_ok ? "" : figures.store_text.c_str()},
                         {"commit_last_ms", figures.commit_last_ms},
                         {"commit_max_ms", figures.commit_max_ms}};
  const storage::ChainHead head = ports.store == nullptr ? storage::ChainHead{} : storage::chain_head(*ports.store);
  j["chain"] = head.entries == 0 ? Json(nullptr) : Json{{"entries", head.entries}, {"sha256", head.sha256.view()}};
  j["plant"] = plant_link(station, ports, figures);
  j["results_pending"] = view.results_pending;
  j["refused"] = {{"count", view.refused}, {"code", view.refuse_code}, {"seq", view.refuse_seq}};
  j["last_slab"] = station.results.slab_no == 0 && station.results.slab_verdict == Verdict::none
                       ? Json(nullptr)
                       : Json{{"no", station.results.slab_no},
                              {"verdict", name(station.results.slab_verdict)},
                              {"reason", station.results.slab_reason},
                              {"emulated", station.results.slab_emulated != 0}};
  j["blocks"] = {{"measured", figures.blocks_measured},
                 {"measuring", station.measuring},
                 {"last_ms", figures.block_last_ms},
                 {"max_ms", figures.block_max_ms}};
  j["arms"] = arms_json(station, ports, figures);
  j["tie"] = tie_in_force(station);
  j["memory"] = {{"rss_kb", memory_kb("VmRSS")},
                 {"peak_kb", memory_kb("VmHWM")},
                 {"inspection_bytes", limits::inspection_bytes(arm_count(station))}};
  j["log_lines_lost"] = log_lines_lost();
  j["uptime_s"] = static_cast<double>(station.now_ns - figures.started_ns) / 1e9;
  j["config"] = figures.config_path;
  j["db"] = figures.db_path;
  return text_of(j);
}

std::string calibration_json(const Station& station, const CalibrationChanger& changer) {
  Json j;
  j["schema"] = "slabd.calibration_state/1";
  j["in_force"] = in_force(station, 0);
  j["arms"] = Json::array();
  for (std::size_t i = 0; i < arm_count(station); ++i)
    j["arms"].push_back({{"robot", station.settings.arms.list[i].robot.view()},
                         {"scanner", station.settings.arms.list[i].scanner.view()},
                         {"in_force", in_force(station, i)}});
  j["tie"] = tie_in_force(station);
  const bool open = station.slab.phase != SlabPhase::none;
  j["open_slab"] = open ? Json{{"calibration_id", station.slab.header.calibration_id.view()},
                               {"stations_id", station.slab.header.stations_id.view()},
                               {"scanner_id", station.slab.header.scanner_id.view()}}
                        : Json(nullptr);
  j["last_change"] = changer.file().empty() ? Json(nullptr)
                                            : Json{{"file", changer.file().view()},
                                                   {"done", changer.is_done()},
                                                   {"ok", changer.succeeded()},
                                                   {"id", changer.id().view()},
                                                   {"code", static_cast<int>(changer.error().code)},
                                                   {"error", changer.error().text.view()}};
  return text_of(j);
}

std::string recipes_json(const RecipeWatch& watch) {
  static constexpr std::array<const char*, 5> kReload = {"none", "checking", "checked", "refused", "done"};
  Json j;
  j["schema"] = "slabd.recipes/1";
  j["in_use"] = Json::array();
  const std::shared_ptr<const RecipeSet> in_use = watch.in_use();
  for (const Recipe& recipe : in_use->recipes)
    j["in_use"].push_back({{"name", recipe.name.view()},
                           {"slab_type", recipe.slab_type},
                           {"sha256", recipe.sha256.view()},
                           {"file", recipe.path.view()}});
  j["differs"] = Json::array();
  for (const RecipeDifference& difference : watch.differences())
    j["differs"].push_back({{"file", difference.file},
                            {"what", difference.what},
                            {"keys", difference.keys},
                            {"problem", difference.problem}});
  j["reload"] = {{"state", kReload.at(static_cast<std::size_t>(watch.reload()))}, {"text", watch.reload_text().view()}};
  return text_of(j);
}

std::string metrics_json(const Station& station, const Ports& ports, const LoopFigures& figures) {
  return text_of(Json{{"schema", "slabd.metrics/1"}, {"text", metrics_text(station, ports, figures)}});
}

std::string answer_control(std::string_view line, const Station& station, const Ports& ports, LoopFigures& figures,
                           CalibrationChanger& changer, const std::function<void(const Event&)>& handle) {
  try {
    if (nests_too_deep(line)) return refusal("a request is one JSON object, not a heap of brackets");
    const Json request = Json::parse(line, nullptr, false);
    if (!request.is_object()) return refusal("a request is one JSON object per line, like {\"verb\":\"status\"}");
    const auto verb = request.find("verb");
    if (verb == request.end() || !verb->is_string()) return refusal("the key \"verb\" is missing or not a string");
    if (*verb == "status") return status_json(station, ports, figures);
    if (figures.opening && *verb != "metrics") return refusal("the database is being opened; repeat the request");
    if (*verb == "calibration") return calibration_json(station, changer);
    if (*verb == "gauges") return gauges_json(station, ports);
    if (*verb == "gauge_enter") {
      const std::uint32_t uid = ports.control == nullptr ? hal::ControlPort::kUidUnknown : ports.control->peer_uid();
      const Result<GaugeEntered> entered = parse_gauge_entry(line, station, uid);
      if (!entered.ok()) return refusal(entered.error());
      handle(entered.value());
      return gauges_json(station, ports);
    }
    if (*verb == "plc_image") return plc_image_json(station, ports.plc, figures);
    if (*verb == "metrics") {
      std::string answer = metrics_json(station, ports, figures);
      if (request.value("reset", false)) figures.block_max_ms = figures.commit_max_ms = 0.0;
      return answer;
    }
    if (*verb == "care" || *verb == "backup" || *verb == "prune" || *verb == "sent") {
      if (ports.store == nullptr) return refusal("the daemon has no usable database");
      // Only users who could delete the database file may delete records.
      const std::uint32_t who = ports.control == nullptr ? hal::ControlPort::kUidUnknown : ports.control->peer_uid();
      if (*verb == "prune" && who != 0 && who != ::geteuid())
        return refusal("only root and slabd's own user may take records away");
      if (*verb != "care")
        if (const Status taken = order_care(line, *ports.store, figures.db_path, ports.clock.utime_us()); !taken.ok())
          return refusal(taken.error());
      return care_json(*ports.store);
    }
    if (*verb == "recipes") {
      if (ports.recipes == nullptr)
        return refusal("slabd is in a fault of its configuration or its database: its recipes are read at a restart");
      if (request.value("reload", false)) {
        if (station.slab.phase != SlabPhase::none)
          return refusal(
              "a slab is open: it ends with the recipe it was begun with; reload the recipes when it has ended");
        (void)ports.recipes->order_reload();
      }
      return recipes_json(*ports.recipes);
    }
    if (*verb != "calibration_change" && *verb != "capture")
      return refusal(
          "unknown verb; known: status, calibration, plc_image, metrics, care, backup, prune, sent, recipes, "
          "gauges, gauge_enter, calibration_change, capture");
    const std::uint32_t uid = ports.control == nullptr ? hal::ControlPort::kUidUnknown : ports.control->peer_uid();
    if (*verb == "capture") {
      const Result<CaptureRequest> capture = parse_capture(line, uid);
      if (!capture.ok()) return refusal(capture.error());
      handle(capture.value());
      const Error& why = station.capture.refusal;
      return why.code == Code::ok ? capture_json(station) : refusal(why);
    }
    const auto file = request.find("file");
    if (file == request.end() || !file->is_string()) return refusal("the key \"file\" is missing or not a string");
    const Status laid = changer.accept(file->get<std::string>(), uid);
    if (!laid.ok()) return refusal(laid.error().text.c_str());
    return calibration_json(station, changer);
  } catch (const std::exception&) {
    // A failing answer must not stop the line.
    return R"({"schema":"slabd.error/1","error":"the daemon could not make an answer"})";
  }
}

}  // namespace slabd::daemon
