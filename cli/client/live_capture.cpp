// SPDX-License-Identifier: Apache-2.0
//
// The daemon answers every line at once; a view takes seconds. shoot() therefore starts it and polls its state, which
// also renews the lease. The daemon accepts at most 20 lines a second from one peer, and each ask_daemon() is a new
// one.
#include "cli/client/live_capture.h"

#include <fmt/core.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <thread>

#include "cli/client/control.h"
#include "cli/exit.h"
#include "cli/terminal/say.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

constexpr auto kPollEvery = std::chrono::milliseconds(100);

Error error_in(const json& answer) {
  const int code = answer.value("code", static_cast<int>(Code::config));
  return error(static_cast<Code>(code), "%s", answer.value("error", "slabd refused without a reason").c_str());
}

/// Parses the answer as slabd.capture/1.
Result<json> understood(const Result<std::string>& answer) {
  if (!answer.ok()) return answer.error();
  json state = json::parse(answer.value(), nullptr, false);
  if (!state.is_object()) return said_error(Code::scanner_offline, say("slabd sent an answer that is not JSON"));
  const std::string schema = state.value("schema", "");
  if (schema == "slabd.error/1") return error_in(state);
  if (schema != "slabd.capture/1")
    return said_error(Code::scanner_offline,
                      say("slabd does not answer with slabd.capture/1; is it older than this slabctl?"));
  return state;
}

std::vector<std::string> sentences(const json& object) {
  std::vector<std::string> list;
  const json& warnings = object.value("warnings", json::array());
  for (const json& warning : warnings)
    if (warning.is_string()) list.push_back(warning.get<std::string>());
  return list;
}

Result<LiveShot> taken(const json& shot) {
  const std::vector<double> pose = shot.value("T_base_flange", std::vector<double>());
  if (pose.size() != 7) return said_error(Code::scanner_offline, say("slabd reported a view without a pose"));
  LiveShot view;
  view.number = shot.value("number", 0U);
  view.scan_path = shot.value("scan", "");
  view.points = shot.value("points", std::uint64_t{0});
  std::array<double, 7> numbers{};
  std::copy(pose.begin(), pose.end(), numbers.begin());
  view.T_base_flange = Pose::from_array(numbers);
  view.spread_mm = shot.value("spread_mm", kNoValue);
  view.spread_rad = rad_from_deg(shot.value("spread_deg", kNoValue));
  view.window_s = shot.value("window_s", 0.0);
  view.pose_samples = shot.value("pose_samples", 0U);
  view.first_seq = shot.value("first_seq", 0);
  view.last_seq = shot.value("last_seq", 0);
  view.first_utime_us = shot.value("first_utime_us", std::int64_t{0});
  view.last_utime_us = shot.value("last_utime_us", std::int64_t{0});
  view.requested_utime_us = shot.value("requested_utime_us", std::int64_t{0});
  view.scan_utime_us = shot.value("scan_utime_us", std::int64_t{0});
  view.base_id = shot.value("base_id", 0);
  view.tool_id = shot.value("tool_id", 0);
  view.warnings = sentences(shot);
  return view;
}

std::string doing(const json& state) {
  const std::string phase = state.value("phase", "");
  if (phase == "scanning") return say("scanning");
  if (phase == "checking") return say("looking whether the robot stood still");
  const json& robot = state.value("robot", json(nullptr));
  if (!robot.is_object()) return say("waiting for the robot's poses");
  return say("waiting for standstill of the robot: {:.1f} s so far, moved {:.3f} mm and {:.4f} deg",
             robot.value("stood_s", 0.0), robot.value("moved_mm", 0.0), robot.value("turned_deg", 0.0));
}

Result<std::string> send(const std::string& socket, const json& request) {
  return ask_daemon(socket, request.dump(-1, ' ', false, json::error_handler_t::replace) + "\n");
}

}  // namespace

Result<std::string> LiveCapture::ask(std::string_view action, std::string_view scan_path) const {
  json request = {{"verb", "capture"}, {"action", action}, {"session", session_}};
  if (!scan_path.empty()) request["scan"] = scan_path;
  return send(socket_, request);
}

Result<LiveCapture> LiveCapture::begin(const std::string& socket, const LiveCaptureBegin& begin) {
  json request = {{"verb", "capture"},        {"action", "begin"},
                  {"session", begin.session}, {"operator", begin.operator_name},
                  {"lease_s", begin.lease_s}, {"take_over", begin.take_over}};
  if (!begin.scanner.empty()) request["scanner"] = begin.scanner;
  const Result<json> state = understood(send(socket, request));
  if (!state.ok()) return state.error();
  LiveCapture capture(socket, begin.session);
  capture.warnings_ = sentences(state.value());
  return capture;
}

Result<LiveShot> LiveCapture::shoot(const std::function<void(std::string_view)>& said) {
  Result<json> state = understood(ask("shoot"));
  if (!state.ok()) return state.error();
  const json mine = state.value().value("shot", json(nullptr));
  const unsigned number = mine.is_object() ? mine.value("number", 0U) : 0U;
  std::string last_said;
  for (;;) {
    const json shot = state.value().value("shot", json(nullptr));
    if (!shot.is_object() || shot.value("number", 0U) != number)
      return said_error(Code::interrupted, say("the session was taken over or was started again; shoot again"));
    if (shot.value("done", false)) return shot.value("ok", false) ? taken(shot) : Result<LiveShot>(error_in(shot));
    if (std::string text = doing(state.value()); said && text != last_said) {
      said(text);
      last_said = std::move(text);
    }
    std::this_thread::sleep_for(kPollEvery);
    state = understood(ask("state"));
    if (!state.ok()) {
      if (state.error().code == Code::wrong_slab)
        return said_error(Code::interrupted,
                          say("the session ended while the view was taken; begin it again and shoot again"));
      return state.error();
    }
  }
}

Status LiveCapture::keep() {
  const Result<json> state = understood(ask("state"));
  if (!state.ok()) return state.error();
  return success();
}

Status LiveCapture::release(const std::string& scan_path) {
  const Result<json> state = understood(ask("release", scan_path));
  if (!state.ok()) return state.error();
  return success();
}

Status LiveCapture::end() {
  const Result<json> state = understood(ask("end"));
  if (!state.ok()) return state.error();
  return success();
}

Result<LiveCapture::Ended> LiveCapture::end(const std::string& socket, const std::string& session) {
  const Result<json> state = understood(LiveCapture(socket, session).ask("end"));
  if (!state.ok()) return state.error();
  // A session that still waits for the worker to finish its view ends by itself and counts as ended.
  Ended ended;
  if (state.value().value("phase", "closed") == "closed" || state.value().value("session", "") == session) return ended;
  ended.other = state.value().value("session", "");
  ended.other_operator = state.value().value("operator", "");
  return ended;
}

Exit live_capture_exit(Code code) {
  switch (code) {
    case Code::not_settled:
    case Code::moved_during_scan: return kRefused;
    case Code::config:
    case Code::frame_incomplete:
    case Code::too_few_points: return kBadInput;
    case Code::internal: return kInternal;
    default: return kNotReachable;
  }
}

}  // namespace slabd::cli
