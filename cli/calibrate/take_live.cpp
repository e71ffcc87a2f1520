// SPDX-License-Identifier: Apache-2.0
//
// A view from the running line. The daemon waits until the robot stands and takes one scan at a time; the shots become
// one view here, in the session's own folder, and only then the daemon's scans are let go. The line stays in
// maintenance between two views (a lease, so a slabctl that dies gives it back by saying nothing) and is idle again at
// the goal.
#include <fmt/core.h>
#include <unistd.h>
#include <algorithm>

#include "cli/calibrate/capture.h"
#include "cli/client/calibration_desk.h"
#include "cli/client/live_capture.h"
#include "cli/exit.h"

namespace slabd::cli {
namespace {

/// Between two shots of one view the robot must not have moved further than it may move during one.
constexpr double kBetweenShotsMm = 0.02;
const double kBetweenShotsRad = rad_from_deg(0.002);

/// By what the daemon knows it; its names are at most this long.
std::string name_on_the_line(const Session& session) {
  return session.settings().name.substr(0, 100);
}

/// The daemon that has the line the session was begun for.
Result<std::string> socket_of(const Session& session) {
  if (session.settings().config.empty())
    return error(Code::config,
                 "the session was begun without a configuration, so the daemon is not known; begin one with: slabctl "
                 "calibrate new NAME --config FILE");
  std::optional<daemon::Config> config;
  if (!config_if_any(session.settings().config, config) || !config)
    return error(Code::config, "%s cannot be used", session.settings().config.c_str());
  return config->control_socket;
}

Result<LiveCapture> begin(const Session& session, bool take_over) {
  const Result<std::string> socket = socket_of(session);
  if (!socket.ok()) return socket.error();
  LiveCaptureBegin wanted;
  wanted.session = name_on_the_line(session);
  wanted.operator_name = default_operator().substr(0, 60);
  wanted.take_over = take_over;
  return LiveCapture::begin(socket.value(), wanted);
}

/// The shots' poses as one, and how far they spread.
Status combine(const std::vector<LiveShot>& shots, ViewRequest& request) {
  std::vector<calib::View> poses;
  for (const LiveShot& shot : shots) poses.emplace_back().T_scanner_target = shot.T_base_flange;
  const Pose mean = calib::best_targets(calib::ArtefactKind::pose, poses, Pose::identity()).front();
  calib::LiveStamp& live = request.live;
  live = {true,
          0.0,
          0.0,
          shots.front().first_seq,
          shots.back().last_seq,
          shots.front().first_utime_us,
          shots.back().last_utime_us};
  for (const LiveShot& shot : shots) {
    const double off_mm = (shot.T_base_flange.translation_mm - mean.translation_mm).norm();
    const double off_rad = angle_between_rad(shot.T_base_flange.rotation, mean.rotation);
    if (off_mm > kBetweenShotsMm || off_rad > kBetweenShotsRad)
      return error(Code::not_settled,
                   "the robot moved by %.3f mm and %.4f deg between the shots of one view; stop it and capture again",
                   off_mm, deg_from_rad(off_rad));
    live.spread_mm = std::max(live.spread_mm, shot.spread_mm);
    live.spread_deg = std::max(live.spread_deg, deg_from_rad(shot.spread_rad));
    request.scans.push_back(shot.scan_path);
  }
  const std::array one = {mean};
  request.flange = calib::write_poses(one, calib::PoseFormat{}, calib::TableRole::flange);
  while (request.flange.ends_with('\n')) request.flange.pop_back();
  return success();
}

}  // namespace

Result<Taken> take_live(Session& session, const LiveOptions& options) {
  Result<LiveCapture> line = begin(session, options.take_over);
  if (!line.ok()) return line.error();
  for (const std::string& warning : line.value().warnings()) complain("warning: " + warning);
  const bool terminal = isatty(STDERR_FILENO) != 0;
  std::vector<LiveShot> shots;
  Result<Taken> taken = error(Code::internal, "no shot was taken");
  Status good = success();
  for (int i = 1; good.ok() && i <= options.shots; ++i) {
    Result<LiveShot> shot = line.value().shoot([&](std::string_view doing) {
      if (terminal) fmt::print(stderr, "\r\x1b[Kshot {}/{}: {}", i, options.shots, doing);
    });
    if (terminal) fmt::print(stderr, "\r\x1b[K");
    if (!shot.ok()) {
      good = shot.error();
      break;
    }
    if (i == 1)
      for (const std::string& warning : shot.value().warnings) complain("warning: " + warning);
    shots.push_back(std::move(shot.value()));
  }
  ViewRequest request;
  request.hold_out = options.hold_out;
  if (good.ok()) good = combine(shots, request);
  taken = good.ok() ? take_view(session, request) : Result<Taken>(good.error());
  // What stood still and could not be copied is the only one of its kind.
  const bool has_no_copy = good.ok() && !taken.ok();
  // A scan that is not let go now is let go by the daemon in a week; that is no reason to fail.
  for (const LiveShot& shot : shots) {
    if (has_no_copy)
      complain(fmt::format("kept for a week: {}, of the flange at \"{}\"", shot.scan_path, request.flange));
    else
      static_cast<void>(line.value().release(shot.scan_path));
  }
  const std::size_t counted = session.counted(calib::ViewUse::fit) + session.counted(calib::ViewUse::held_out);
  if (counted >= session.settings().goal) static_cast<void>(line.value().end());
  return taken;
}

Result<std::string> end_live(const Session& session) {
  const Result<std::string> socket = socket_of(session);
  if (!socket.ok()) return socket.error();
  const Result<LiveCapture::Ended> ended = LiveCapture::end(socket.value(), name_on_the_line(session));
  if (!ended.ok()) return ended.error();
  if (ended.value().other.empty()) return std::string("it does not hold the line any more");
  return fmt::format("it does not hold the line; \"{}\" of {} does, and nothing was done to it", ended.value().other,
                     ended.value().other_operator);
}

}  // namespace slabd::cli
