// SPDX-License-Identifier: Apache-2.0
//
// A view from the running line. The daemon waits until the robot stands and takes one scan at a time; the shots become
// one view here, in the session's own folder, and only then the daemon's scans are let go. The line stays in
// maintenance between two views (a lease, so a slabctl that dies gives it back by saying nothing) and is idle again at
// the goal.
#include <fmt/core.h>
#include <unistd.h>
#include <algorithm>

#include "cli/calibrate/calibration_desk.h"
#include "cli/calibrate/capture.h"
#include "cli/calibrate/live_capture.h"
#include "cli/exit.h"

namespace slabd::cli {
namespace {

/// Between two shots of one view the robot must not have moved further than it may move during one.
constexpr double kBetweenShotsMm = 0.02;
const double kBetweenShotsRad = rad_from_deg(0.002);

Result<LiveCapture> begin(const Session& session, std::string& socket) {
  if (session.settings().config.empty())
    return error(Code::config,
                 "the session was begun without a configuration, so the daemon is not known; begin one with: slabctl "
                 "calibrate new NAME --config FILE");
  std::optional<daemon::Config> config;
  if (!config_if_any(session.settings().config, config) || !config)
    return error(Code::config, "%s cannot be used", session.settings().config.c_str());
  socket = config->control_socket;
  LiveCaptureBegin wanted;
  wanted.session = session.settings().name.substr(0, 100);
  wanted.operator_name = default_operator().substr(0, 60);
  return LiveCapture::begin(socket, wanted);
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

Result<Taken> take_live(Session& session, int count, bool hold_out) {
  std::string socket;
  Result<LiveCapture> line = begin(session, socket);
  if (!line.ok()) return line.error();
  for (const std::string& warning : line.value().warnings()) complain("warning: " + warning);
  const bool terminal = isatty(STDERR_FILENO) != 0;
  std::vector<LiveShot> shots;
  Result<Taken> taken = error(Code::internal, "no shot was taken");
  Status good = success();
  for (int i = 1; good.ok() && i <= count; ++i) {
    Result<LiveShot> shot = line.value().shoot([&](std::string_view doing) {
      if (terminal) fmt::print(stderr, "\r\x1b[Kshot {}/{}: {}", i, count, doing);
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
  request.hold_out = hold_out;
  if (good.ok()) good = combine(shots, request);
  taken = good.ok() ? take_view(session, request) : Result<Taken>(good.error());
  // A scan that is not let go now is let go by the daemon in a week; that is no reason to fail.
  for (const LiveShot& shot : shots) static_cast<void>(line.value().release(shot.scan_path));
  const std::size_t counted = session.counted(calib::ViewUse::fit) + session.counted(calib::ViewUse::held_out);
  if (counted >= session.settings().goal) static_cast<void>(line.value().end());
  return taken;
}

Status end_live(const Session& session) {
  std::string socket;
  Result<LiveCapture> line = begin(session, socket);
  return line.ok() ? line.value().end() : Status(line.error());
}

}  // namespace slabd::cli
