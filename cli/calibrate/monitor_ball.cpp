// SPDX-License-Identifier: Apache-2.0
#include "cli/calibrate/monitor_ball.h"

#include <fmt/core.h>
#include <unistd.h>

#include <sstream>

#include "base/pages.h"
#include "calib/calib.h"
#include "cli/client/calibration_change.h"
#include "cli/client/live_capture.h"
#include "cli/client/scanner_choice.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/say.h"

namespace slabd::cli {
namespace {

/// Finds the ball in a scan. nullopt on success, otherwise the reason.
std::optional<Stop> find_in(const BallMeasurement& look, const std::string& scan, const hal::ScanForm& form,
                            const Pose& X, MeasuredBall& seen) {
  const auto because = [](const Error& why) { return Stop{exit_for(why.code), retold(why.text.view())}; };
  Pages memory(limits::kScanSlotBytes);
  const std::span<float> xyz = memory.take<float>(limits::kScanPointsMax * 3);
  const Result<ScanShape> shape = hal::read_scan(scan.c_str(), form, xyz);
  if (!shape.ok()) return because(shape.error());
  calib::BallSettings settings;
  settings.radius_mm = look.radius_mm;
  settings.noise_mm = look.noise_mm;
  const Result<calib::BallView> view = calib::find_balls(xyz.first(3 * shape.value().points), settings);
  if (!view.ok()) return because(view.error());
  if (!view.value().ok())
    return Stop{kRefused, say("{}: refused ({}): {}\n  what to do: {}", scan, name(view.value().refusal),
                              quote(view.value().words.reason.view()), quote(view.value().words.cure.view()))};
  seen.p_base_mm = seen.T_base_flange * (X * view.value().balls.front().centre_mm);
  seen.radius_free_mm = view.value().balls.front().radius_free_mm;
  seen.scanner_temperature_c = shape.value().scanner_temperature_c;
  return std::nullopt;
}

/// Takes one view through the daemon; the line is idle again afterwards, even after an error.
MeasuredBall take_live(const config::Config& config, const BallMeasurement& look, const Pose& X) {
  LiveBall line(config, look);
  MeasuredBall seen;
  const std::optional<Stop> unseen = line.shoot(X, seen);
  if (unseen) complain(unseen->sentence);  // printed before the line is returned
  line.end();
  if (unseen) stop(unseen->status);
  return seen;
}

}  // namespace

struct LiveBall::Session {
  LiveCapture line;
  hal::ScanForm form;
  BallMeasurement look;
};

LiveBall::LiveBall(const config::Config& config, const BallMeasurement& look) {
  const std::string who = look.who.empty() ? default_operator() : look.who;
  // The session name is unique, so that two simultaneous checks cannot continue or end each other's session. The lease
  // is short, because after a crash no other process can continue the session.
  const std::string session = fmt::format("monitor ball {}", ::getpid());
  Result<LiveCapture> line =
      LiveCapture::begin(config.control_socket, {session, who, kLease_s, false, id_if_several(config)});
  if (!line.ok()) stop(live_capture_exit(line.error().code), line.error());
  session_ = std::make_unique<Session>(Session{std::move(line.value()), config.scanner.form, look});
}

LiveBall::~LiveBall() {
  end();
}

std::optional<Stop> LiveBall::shoot(const Pose& T_flange_scanner, MeasuredBall& seen) {
  const bool terminal = isatty(STDERR_FILENO) != 0;
  const Result<LiveShot> shot = session_->line.shoot([&](std::string_view said) {
    if (terminal) fmt::print(stderr, "\r\x1b[K{} ...", said);
  });
  if (terminal) fmt::print(stderr, "\r\x1b[K");
  if (!shot.ok()) return Stop{live_capture_exit(shot.error().code), retold(shot.error().text.view())};
  for (const std::string& warning : shot.value().warnings) complain(say("warning: {}", quote(warning)));
  seen.T_base_flange = shot.value().T_base_flange;
  seen.source = fmt::format("live view of {}", shot.value().scan_utime_us);
  std::optional<Stop> unseen = find_in(session_->look, shot.value().scan_path, session_->form, T_flange_scanner, seen);
  if (const Status released = session_->line.release(shot.value().scan_path); !released)
    complain(say("warning: {}", quote(released.error().text.view())));
  return unseen;
}

void LiveBall::keep() {
  if (const Status kept = session_->line.keep(); !kept) stop(live_capture_exit(kept.error().code), kept.error());
}

void LiveBall::end() {
  if (session_ == nullptr) return;
  if (const Status ended = session_->line.end(); !ended) complain(say("warning: {}", quote(ended.error().text.view())));
  session_.reset();
}

std::string seen_elsewhere(const config::Config& config, const std::string& observations, const MeasuredBall& seen) {
  const std::optional<Pose> then = ball_pose_of(observations);
  if (!then) return "";
  const double off_mm = (seen.T_base_flange.translation_mm - then->translation_mm).norm();
  const double off_rad = angle_between_rad(seen.T_base_flange.rotation, then->rotation);
  if (off_mm <= config.splice.gate_mm && off_rad <= config.splice.gate_rad) return "";
  return say(
      "the robot stood {:.1f} mm and {:.2f} deg from where it stood when the ball was taken into use; from there it "
      "errs otherwise, so look from the same pose",
      off_mm, deg_from_rad(off_rad));
}

void BallMeasurement::add_to(args::Command& command) {
  args::Option pose =
      command.add_option("--flange", flange, "Pose of the robot: \"x y z qw qx qy qz\" of the flange, as reported");
  command.add_flag("--live", live, "Take scan and pose of the ball from the running line; it must be idle")
      ->excludes(pose);
  command.add_option("--radius", radius_mm, "Certified radius of the ball, mm")->check(within(1.0, 200.0));
  command.add_option("--noise", noise_mm, "Expected standard deviation of the scanner's points, mm")
      ->check(within(0.001, 1.0))
      ->capture_default_str();
  form.add_to(command);
}

MeasuredBall look_at_ball(const config::Config& config, const BallMeasurement& look, const Pose& T_flange_scanner) {
  if (!has_value(look.radius_mm))
    stop(kUsage, say("--radius: the ball's certified radius (effective, as coated) is missing"));
  if (look.live) return take_live(config, look, T_flange_scanner);
  const Result<Pose> pose = parse_pose(look.flange);
  if (!pose.ok())
    stop(kUsage,
         look.flange.empty()
             ? say("--flange is missing: where the robot stood when the ball was scanned, \"x y z qw qx qy qz\" "
                   "as it reports its flange (or --live: scan and pose come from the running line)")
             : say("--flange: {}", quote(pose.error().text.view())));
  MeasuredBall seen;
  seen.T_base_flange = pose.value();
  seen.source = look.scan;
  if (const auto unseen = find_in(look, look.scan, look.form.form(config.scanner.form), T_flange_scanner, seen))
    throw *unseen;
  return seen;
}

std::string ball_observations(const MeasuredBall& seen, std::string_view hand_eye_id) {
  const std::array<double, 7> p = seen.T_base_flange.to_array();
  return fmt::format("scan {}\nT_base_flange {} {} {} {} {} {} {}\nhand-eye {}\n", seen.source, p[0], p[1], p[2], p[3],
                     p[4], p[5], p[6], hand_eye_id);
}

std::optional<Pose> ball_pose_of(const std::string& observations) {
  std::istringstream lines(observations);
  constexpr std::string_view kKey = "T_base_flange ";
  for (std::string line; std::getline(lines, line);)
    if (line.starts_with(kKey)) {
      const Result<Pose> pose = parse_pose(std::string_view(line).substr(kKey.size()));
      if (pose.ok()) return pose.value();
    }
  return std::nullopt;
}

}  // namespace slabd::cli
