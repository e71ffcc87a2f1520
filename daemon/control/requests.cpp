// SPDX-License-Identifier: Apache-2.0
//
// The ordering verbs of the control socket. "capture": parses JSON into an event, and writes the station's state as
// JSON. Control path: heap and exceptions of the JSON library are confined to the files of this folder.
#include <array>
#include <nlohmann/json.hpp>

#include "daemon/loop.h"
#include "daemon/station/parts.h"
#include "daemon/station/still_watch.h"

namespace slabd::daemon {
namespace {

using Json = nlohmann::ordered_json;

std::string_view phase_name(Capture::Phase phase) {
  switch (phase) {
    case Capture::Phase::closed: return "closed";
    case Capture::Phase::ready: return "ready";
    case Capture::Phase::settling: return "settling";
    case Capture::Phase::scanning: return "scanning";
    case Capture::Phase::checking: return "checking";
  }
  return "unknown";
}

/// Largest difference between the sender's wall clock and slabd's; beyond it a clock is wrong or poses arrive late.
constexpr std::int64_t kPoseAgeUsMax = 500'000;

void warn_of_frame(const PoseSample& sample, Json& list) {
  if (sample.tool_id == 0 && sample.base_id == 0) return;
  char text[240];
  std::snprintf(text, sizeof text,
                "tool %d and base %d are active on the controller: a calibration needs the flange in the robot root "
                "($TOOL and $BASE = $NULLFRAME); with a tool the result holds for that tool's frame only",
                sample.tool_id, sample.base_id);
  list.push_back(text);
}

Json warnings(const Station& s) {
  Json list = Json::array();
  char text[240];
  const CaptureGuard& guard = s.settings.capture;
  if (guard.is_wider()) {
    std::snprintf(
        text, sizeof text,
        "the flange may move %.3f mm and %.4f deg over %.1f s ([calibration] capture_stable_*), more than the "
        "%.3f mm, %.4f deg and %.1f s a calibration should have",
        guard.stable_mm, deg_from_rad(guard.stable_rad), static_cast<double>(guard.stable_ns) / 1e9,
        CaptureGuard::kStable_mm, deg_from_rad(CaptureGuard::kStable_rad),
        static_cast<double>(CaptureGuard::kStable_ns) / 1e9);
    list.push_back(text);
  }
  const StationArm& arm = s.arms[s.capture.arm];
  if (const Code link = arm.gate.link(s.now_ns); link != Code::ok)
    list.push_back(std::string(describe(link)) + "; " + std::string(cure(link)));
  if (!arm.links.scanner_online)
    list.push_back(std::string(describe(Code::scanner_offline)) + "; " + std::string(cure(Code::scanner_offline)));
  return list;
}

Json pose_json(const Pose& pose) {
  return pose.to_array();
}

Json shot_json(const CaptureShot& shot) {
  if (shot.number == 0) return nullptr;
  Json j;
  j["number"] = shot.number;
  j["done"] = shot.done;
  j["ok"] = shot.done && shot.code == Code::ok;
  if (!shot.done) return j;
  j["code"] = static_cast<int>(shot.code);
  j["error"] = shot.text.view();
  if (shot.code != Code::ok) return j;
  j["scan"] = shot.scan_path.view();
  j["points"] = shot.shape.finite;
  j["T_base_flange"] = pose_json(shot.T_base_flange);
  j["spread_mm"] = shot.spread_mm;
  j["spread_deg"] = deg_from_rad(shot.spread_rad);
  j["window_s"] = static_cast<double>(shot.last.arrival_ns - shot.first.arrival_ns) / 1e9;
  j["pose_samples"] = shot.samples;
  j["first_seq"] = shot.first.seq;
  j["last_seq"] = shot.last.seq;
  j["first_utime_us"] = shot.first.utime_us;
  j["last_utime_us"] = shot.last.utime_us;
  j["requested_utime_us"] = shot.requested_utime_us;
  j["scan_utime_us"] = shot.scan_utime_us;
  j["base_id"] = shot.last.base_id;
  j["tool_id"] = shot.last.tool_id;
  Json list = Json::array();
  warn_of_frame(shot.last, list);
  if (shot.pose_age_us > kPoseAgeUsMax || shot.pose_age_us < -kPoseAgeUsMax) {
    char text[200];
    std::snprintf(text, sizeof text,
                  "the robot's poses are %.1f s old by their time stamps: its clock is wrong, or they arrive late and "
                  "the pose may be outdated",
                  static_cast<double>(shot.pose_age_us) / 1e6);
    list.push_back(text);
  }
  j["warnings"] = list;
  return j;
}

/// Reads a text of 1..capacity bytes; false if it is missing, not a string or too long (it would be cut).
template <std::size_t Capacity>
bool take_text(const Json& request, const char* key, FixedString<Capacity>& out) {
  const auto at = request.find(key);
  if (at == request.end() || !at->is_string()) return false;
  const std::string& text = at->get_ref<const std::string&>();
  if (text.empty() || text.size() > Capacity) return false;
  out.assign(text);
  return true;
}

}  // namespace

std::string capture_json(const Station& s) {
  const Capture& c = s.capture;
  Json j;
  j["schema"] = "slabd.capture/1";
  j["phase"] = phase_name(c.phase);
  j["open"] = in_maintenance(s);
  if (in_maintenance(s)) {
    j["session"] = c.session.view();
    j["operator"] = c.operator_name.view();
    j["scanner"] = s.settings.arms.list[c.arm].scanner.view();
    j["uid"] = c.uid;
    j["since_utime_us"] = c.since_utime_us;
    j["lease_left_s"] = static_cast<double>(c.lease_until_ns - s.now_ns) / 1e9;
  }
  j["guard"] = {{"stable_s", static_cast<double>(s.settings.capture.stable_ns) / 1e9},
                {"stable_mm", s.settings.capture.stable_mm},
                {"stable_deg", deg_from_rad(s.settings.capture.stable_rad)}};
  const StillWatch& still = s.arms[c.arm].still;
  const PoseRange& recent = still.recent();
  const bool any = still.samples() != 0;
  j["robot"] = any ? Json{{"stood_s", static_cast<double>(still.newest().arrival_ns - still.first().arrival_ns) / 1e9},
                          {"moved_mm", recent.mm()},
                          {"turned_deg", deg_from_rad(recent.rad())}}
                   : Json(nullptr);
  j["folder"] = capture_folder(s).view();
  j["warnings"] = warnings(s);
  j["shot"] = shot_json(c.shot);
  return j.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

Result<CaptureRequest> parse_capture(std::string_view line, std::uint32_t uid) {
  using What = CaptureRequest::Action;
  const Json request = Json::parse(line, nullptr, false);
  if (!request.is_object()) return error(Code::config, "a request is one JSON object");
  const auto action = request.find("action");
  CaptureRequest made;
  made.uid = uid;
  struct Named {
    const char* name;
    What action;
  };
  static constexpr std::array kActions = {Named{"begin", What::begin}, Named{"shoot", What::shoot},
                                          Named{"state", What::keep}, Named{"release", What::release},
                                          Named{"end", What::end}};
  const Named* found = nullptr;
  for (const Named& named : kActions)
    if (action != request.end() && *action == named.name) found = &named;
  if (found == nullptr) return error(Code::config, "\"action\" must be one of begin, shoot, state, release, end");
  made.action = found->action;
  if (!take_text(request, "session", made.session))
    return error(Code::config, "\"session\" must be a text of 1..%zu bytes", CaptureName::capacity());
  if (made.action == What::release && !take_text(request, "scan", made.scan))
    return error(Code::config, "\"scan\" must be the path of a view's scan");
  if (made.action != What::begin) return made;
  if (uid == hal::ControlPort::kUidUnknown) return error(Code::config, "the user of this request is unknown");
  if (!take_text(request, "operator", made.operator_name))
    return error(Code::config, "\"operator\" must be a text of 1..%zu bytes", made.operator_name.capacity());
  const auto lease = request.find("lease_s");
  if (lease != request.end() && !lease->is_number_integer())
    return error(Code::config, "\"lease_s\" must be an integer");
  made.lease_s = lease == request.end() ? 300 : lease->get<std::int64_t>();
  if (request.contains("scanner") && !take_text(request, "scanner", made.scanner))
    return error(Code::config, "\"scanner\" must be the id of a scanner, a text of 1..%zu bytes", PartId::capacity());
  const auto take_over = request.find("take_over");
  if (take_over != request.end() && !take_over->is_boolean())
    return error(Code::config, "\"take_over\" must be true or false");
  made.take_over = take_over != request.end() && take_over->get<bool>();
  return made;
}

// The verbs "care", "backup" and "prune" of the control socket: orders for the whole database. The storage thread
// carries them out between its jobs; this code passes the orders on and reports their state.

namespace {

const char* phase_name(storage::CareState::Phase phase) {
  static constexpr std::array kNames = {"none", "under_way", "done", "failed"};
  return kNames.at(static_cast<std::size_t>(phase));
}

}  // namespace

std::string care_json(const storage::Store& store) {
  const storage::CareState care = store.care();
  Json j;
  j["schema"] = "slabd.care/1";
  j["backup"] = {{"state", phase_name(care.backup)},
                 {"path", care.backup_path},
                 {"pages", care.backup_pages},
                 {"pages_all", care.backup_pages_all},
                 {"error", care.backup_error}};
  j["prune"] = {{"state", phase_name(care.prune)}, {"slabs", care.pruned_slabs}, {"error", care.prune_error}};
  return j.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

Status order_care(std::string_view line, storage::Store& store, const std::string& db_path, std::int64_t utime_us) {
  const Json request = Json::parse(line, nullptr, false);
  if (!request.is_object()) return error(Code::config, "a request is one JSON object");
  if (request.value("verb", "") == "backup") {
    const Result<std::string> path = storage::backup_path(db_path, utime_us);
    if (!path.ok()) return path.error();
    return store.order(storage::BackupOrder{path.value()});
  }
  if (request.value("verb", "") == "sent") {
    const auto epoch = request.find("epoch");
    const auto seq = request.find("seq");
    if (epoch == request.end() || !epoch->is_string()) return error(Code::config, "\"epoch\" must be a text");
    if (seq == request.end() || !seq->is_number_integer()) return error(Code::config, "\"seq\" must be a whole number");
    return store.order(storage::SentOrder{epoch->get<std::string>(), seq->get<std::int64_t>()});
  }
  const auto keep = request.find("keep_slabs");
  if (keep == request.end() || !keep->is_number_integer())
    return error(Code::config, "\"keep_slabs\" must be a whole number");
  storage::PruneOrder order{keep->get<std::int64_t>()};
  if (const auto failed = request.find("keep_failed_slabs"); failed != request.end()) {
    if (!failed->is_number_integer()) return error(Code::config, "\"keep_failed_slabs\" must be a whole number");
    order.keep_failed_slabs = failed->get<std::int64_t>();
  }
  return store.order(order);
}

}  // namespace slabd::daemon
