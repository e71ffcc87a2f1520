// SPDX-License-Identifier: Apache-2.0
#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "cli/calibrate/capture.h"
#include "cli/calibrate/find_ball.h"
#include "cli/client/calibration_change.h"
#include "cli/client/live_capture.h"
#include "cli/exit.h"
#include "cli/terminal/say.h"

namespace slabd::cli {
namespace {

namespace fs = std::filesystem;

constexpr const char* kSamePose = "same_pose";

calib::BallSettings ball_settings(const calib::SessionSettings& s) {
  BallOptions options;
  options.noise_mm = s.scanner_noise_mm;
  options.noise_correlation_mm = s.noise_correlation_mm;
  options.parallel = s.parallel;
  calib::BallSettings settings = options.settings();
  settings.radius_mm = s.radius_mm;
  settings.radius_sigma_mm = s.radius_sigma_mm;
  return settings;
}

void refuse(calib::CapturedView& view, std::string_view word, const calib::BallWords& words) {
  view.use = calib::ViewUse::refused;
  view.refusal = word;
  view.reason = words.reason.view();
  view.cure = words.cure.view();
}

double smaller(double a, double b) {
  return has_value(a) && !(b < a) ? a : b;
}
double larger(double a, double b) {
  return has_value(a) && !(b > a) ? a : b;
}

void note_ball(calib::CapturedView& view, const calib::BallReport& ball) {
  view.points += ball.points_used;
  view.half_angle_deg = smaller(view.half_angle_deg, deg_from_rad(ball.half_angle_rad));
}

/// Finds one ball, from all shots together.
Status find_one_ball(const Session& session, const std::vector<std::vector<float>>& scans, calib::CapturedView& view) {
  const calib::BallSettings settings = ball_settings(session.settings());
  std::vector<calib::BallReport> shots;
  double off_mm = 0.0;
  for (const std::vector<float>& xyz : scans) {
    const Result<calib::BallView> found = calib::find_balls(xyz, settings);
    if (!found.ok()) return found.error();
    shots.push_back(as_shot(found.value()));
    note_ball(view, shots.back());
    view.rms_mm = larger(view.rms_mm, shots.back().rms_mm);
    off_mm += shots.back().radius_free_mm - settings.radius_mm;
  }
  view.radius_off_mm = off_mm / static_cast<double>(shots.size());
  const calib::BallShots mean = calib::average_shots(shots, settings);
  view.repeat_mm = mean.repeat_mm;
  if (!mean.ok()) {
    refuse(view, name(mean.refusal), mean.words);
    return success();
  }
  view.T_scanner_target.translation_mm = mean.centre_mm;
  view.covariance.setZero();
  view.covariance.topLeftCorner<3, 3>() = mean.cov_mm2;
  return success();
}

/// Pose of an artefact: the mean over the shots. The covariance is that of one shot: most of it is the common error of
/// neighbouring points, which repeated shots do not reduce.
Status find_one_artefact(const Session& session, const std::vector<std::vector<float>>& scans,
                         calib::CapturedView& view) {
  calib::ArtefactSettings settings;
  settings.ball = ball_settings(session.settings());
  const std::optional<calib::ArtefactCertificate> certificate = session.certificate();
  if (!certificate) return said_error(Code::config, say("{}/certificate.txt cannot be used", session.dir()));
  std::vector<calib::View> poses;
  double off_mm = 0.0;
  std::size_t balls = 0;
  for (const std::vector<float>& xyz : scans) {
    const Result<calib::ArtefactReport> found = calib::find_artefact(xyz, *certificate, settings);
    if (!found.ok()) return found.error();
    const calib::ArtefactReport& report = found.value();
    for (const calib::BallReport& ball : report.view.balls) {
      note_ball(view, ball);
      if (!ball.ok() || !has_value(ball.radius_free_mm)) continue;
      off_mm += ball.radius_free_mm - certificate->ball_radius_mm;
      ++balls;
    }
    view.rms_mm = larger(view.rms_mm, report.residual_rms_mm);
    if (!report.ok()) {
      refuse(view, name(report.refusal), report.words.reason.empty() ? report.view.words : report.words);
      return success();
    }
    view.covariance = report.target.covariance;
    poses.emplace_back().T_scanner_target = report.target.T_scanner_target;
  }
  if (balls > 0) view.radius_off_mm = off_mm / static_cast<double>(balls);
  view.T_scanner_target = calib::best_targets(calib::ArtefactKind::pose, poses, Pose::identity()).front();
  if (poses.size() < 2) return success();
  double squares = 0.0;
  for (const calib::View& pose : poses)
    squares += (pose.T_scanner_target.translation_mm - view.T_scanner_target.translation_mm).squaredNorm();
  view.repeat_mm = std::sqrt(squares / 3.0 / static_cast<double>(poses.size() - 1));
  if (view.repeat_mm <= settings.ball.repeat_max_mm) return success();
  calib::BallWords words;
  words.reason.printf("the shots scatter by %.4f mm per axis, limit %.4f mm", view.repeat_mm,
                      settings.ball.repeat_max_mm);
  words.cure.assign("wait until the robot has settled, tighten artefact and stand, scan again");
  refuse(view, "repeat", words);
  return success();
}

/// The counted view with this pose, or nullptr.
const Session::Entry* view_at(const Session& session, const Pose& pose, Pose& there) {
  for (const Session::Entry& entry : session.entries()) {
    if (!entry.counts()) continue;
    const Result<Pose> other = calib::parse_flange(entry.view.flange_form, entry.view.flange, "T_base_flange");
    if (!other.ok() || !calib::same_place(other.value(), pose)) continue;
    there = other.value();
    return &entry;
  }
  return nullptr;
}

/// Rejects a view whose pose another view has: it would add no information, and as a held-out view it would verify
/// nothing.
void refuse_same_place(const Session& session, const Pose& pose, calib::CapturedView& view) {
  if (view.use == calib::ViewUse::refused) return;
  Pose there;
  const Session::Entry* other = view_at(session, pose, there);
  if (other == nullptr) return;
  calib::BallWords words;
  words.reason.printf("the flange is where it was for view %zu (%.3f mm, %.4f deg away)", other->view.number,
                      (there.translation_mm - pose.translation_mm).norm(),
                      deg_from_rad(angle_between_rad(there.rotation, pose.rotation)));
  words.cure.assign(
      "drive to another pose; if the pose is a slip, give the scan again with the right one; several shots of one pose "
      "are one view: --scan a.ply --scan b.ply; to have this view instead, drop the other one and capture this again");
  refuse(view, kSamePose, words);
}

struct Digests {
  std::vector<FileDigest> shots;
};

/// True if it was rejected only because another view has its pose.
bool refused_for_its_pose(const calib::CapturedView& view) {
  return view.refusal == kSamePose;
}

/// The entry that was captured from these scans with this pose; nullptr if there is none. Code::config if a scan
/// belongs to another view. A dropped view, or one rejected for its pose, does not block its scans: they can become a
/// view with another pose. Scans rejected for their pose can also be used once no counted view has that pose.
Result<const Session::Entry*> known_view(const Session& session, const ViewRequest& request, const Pose& pose,
                                         const Digests& digests) {
  const Session::Entry* counts_not = nullptr;
  for (const Session::Entry& entry : session.entries()) {
    if (entry.undone) continue;
    const calib::CapturedView& v = entry.view;
    std::size_t same = 0;
    for (const FileDigest& digest : digests.shots)
      same += static_cast<std::size_t>(std::count_if(v.shots.begin(), v.shots.end(), [&](const calib::KeptShot& shot) {
        return shot.bytes == digest.bytes && shot.sha256 == digest.sha256;
      }));
    if (same == 0) continue;
    const bool same_pose = v.flange == request.flange && v.flange_form == request.flange_form;
    if (!entry.unreadable.empty())
      return said_error(Code::config, say("{} is a scan of view {}, and whether that counts cannot be read: {}",
                                          request.scans.front(), v.number, entry.unreadable));
    if (same_pose && same >= digests.shots.size() && v.shots.size() == digests.shots.size()) {
      if (entry.counts()) return &entry;
      Pose there;
      if (refused_for_its_pose(v) && entry.dropped_step == 0 && view_at(session, pose, there) == nullptr) continue;
      if (counts_not == nullptr) counts_not = &entry;
      continue;
    }
    if (entry.dropped_step != 0 || refused_for_its_pose(v)) continue;
    return said_error(
        Code::config,
        say("{} is a scan of view {}, which has {}: one scan cannot be two views; if view {} is the wrong one, "
            "slabctl calibrate drop {} --reason \"wrong pose\", then give this command again",
            request.scans.front(), v.number, same_pose ? say("other shots beside it") : say("another pose"), v.number,
            v.number));
  }
  return counts_not;
}

std::string intent_of(const ViewRequest& request) {
  std::string words;
  for (const std::string& scan : request.scans) words += (words.empty() ? "" : ", ") + scan;
  return words + " with T_base_flange " + request.flange;
}

/// Copies and evaluates a view; the caller discards the folder on failure.
Result<calib::CapturedView> collect(Session& session, const ViewRequest& request, const Digests& digests,
                                    const std::string& part) {
  calib::CapturedView view;
  view.use = request.hold_out ? calib::ViewUse::held_out : calib::ViewUse::fit;
  view.flange_form = request.flange_form;
  view.flange = request.flange;
  view.live = request.live;
  std::vector<std::vector<float>> scans;
  const hal::ScanForm form = ScanFormOptions{session.settings().unit, session.settings().columns}.form();
  for (std::size_t i = 0; i < request.scans.size(); ++i) {
    const std::string extension = fs::path(request.scans[i]).extension().string();
    calib::KeptShot shot;
    shot.file = fmt::format("shot_{}{}", i + 1, extension);
    shot.source = request.scans[i];
    const std::string copy = part + "/" + shot.file;
    if (const Status copied = copy_synced(request.scans[i], copy); !copied.ok()) return copied.error();
    const Result<FileDigest> digest = digest_of(copy);
    if (!digest.ok()) return digest.error();
    if (digest.value().sha256 != digests.shots[i].sha256)
      return said_error(Code::config,
                        say("{} changed while it was copied; is it still being written?", request.scans[i]));
    shot.bytes = digest.value().bytes;
    shot.sha256 = digest.value().sha256;
    view.shots.push_back(shot);
    Result<std::vector<float>> xyz = scan_points(copy, form);
    if (!xyz.ok()) {  // its text names the copy, which will be deleted
      const std::string_view why = xyz.error().text.view();
      const std::size_t after = why.starts_with(copy) ? copy.size() : 0;
      return said_error(Code::config, request.scans[i] + retold(why.substr(after)));
    }
    scans.push_back(std::move(xyz.value()));
  }
  const Status found = session.settings().kind == calib::ArtefactKind::ball ? find_one_ball(session, scans, view)
                                                                            : find_one_artefact(session, scans, view);
  if (!found.ok()) return found.error();
  return view;
}

}  // namespace

Result<Taken> take_view(Session& session, const ViewRequest& request) {
  const Result<Pose> pose = calib::parse_flange(request.flange_form, request.flange, "T_base_flange");
  if (!pose.ok()) return pose.error();
  Digests digests;
  for (const std::string& scan : request.scans) {
    Result<FileDigest> digest = digest_of(scan);
    if (!digest.ok()) return error(Code::config, "%s", digest.error().text.c_str());
    for (const FileDigest& other : digests.shots)
      if (other.sha256 == digest.value().sha256)
        return said_error(Code::config, say("{}: the same scan is given twice", scan));
    digests.shots.push_back(std::move(digest.value()));
  }
  const Result<const Session::Entry*> known = known_view(session, request, pose.value(), digests);
  if (!known.ok()) return known.error();
  if (known.value() != nullptr) return Taken{known.value()->view, true, known.value()->dropped_step != 0};
  if (session.entries().size() >= calib::kViewsMax)
    return said_error(Code::config, say("the session has {} views, the most there may be; solve, or begin another",
                                        session.entries().size()));
  const Result<std::string> part = session.begin_view(intent_of(request));
  if (!part.ok()) return part.error();
  Result<calib::CapturedView> view = collect(session, request, digests, part.value());
  if (!view.ok()) {
    session.discard_view(part.value());
    return view.error();
  }
  refuse_same_place(session, pose.value(), view.value());
  if (const Status kept = session.commit_view(part.value(), view.value()); !kept.ok()) {
    session.discard_view(part.value());
    return kept.error();
  }
  return Taken{view.value(), false, false};
}

// A view from the running line. The daemon waits until the robot stops and takes one scan at a time. The shots become
// one view in the session's folder; only then are the daemon's scans released. The line stays in maintenance between
// two views and is idle again at the goal. It is held by a lease, which expires if slabctl crashes.

namespace {

/// Largest motion of the robot between two shots of one view, the same as during one shot.
constexpr double kBetweenShots_mm = 0.02;
const double kBetweenShots_rad = rad_from_deg(0.002);

/// Session name for the daemon, whose names have at most this length.
std::string name_on_the_line(const Session& session) {
  return session.settings().name.substr(0, 100);
}

/// Control socket of the line for which the session was begun.
Result<std::string> socket_of(const Session& session) {
  if (session.settings().config.empty())
    return said_error(
        Code::config,
        say("the session was begun without a configuration, so the daemon is not known; begin one with: slabctl "
            "calibrate new NAME --config FILE"));
  std::optional<config::Config> config;
  if (!config_if_any(session.settings().config, config) || !config)
    return said_error(Code::config, say("{} cannot be used", session.settings().config));
  return config->control_socket;
}

Result<LiveCapture> begin(const Session& session, bool take_over) {
  const Result<std::string> socket = socket_of(session);
  if (!socket.ok()) return socket.error();
  LiveCaptureBegin wanted;
  wanted.session = name_on_the_line(session);
  wanted.operator_name = default_operator().substr(0, 60);
  wanted.take_over = take_over;
  wanted.scanner = session.settings().scanner;
  return LiveCapture::begin(socket.value(), wanted);
}

/// Combines the shots' poses into one and checks their spread.
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
    if (off_mm > kBetweenShots_mm || off_rad > kBetweenShots_rad)
      return said_error(
          Code::not_settled,
          say("the robot moved by {:.3f} mm and {:.4f} deg between the shots of one view; stop it and capture again",
              off_mm, deg_from_rad(off_rad)));
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
  for (const std::string& warning : line.value().warnings()) complain(say("warning: {}", quote(warning)));
  const bool terminal = isatty(STDERR_FILENO) != 0;
  std::vector<LiveShot> shots;
  Result<Taken> taken = said_error(Code::internal, say("no shot was taken"));
  Status good = success();
  for (int i = 1; good.ok() && i <= options.shots; ++i) {
    Result<LiveShot> shot = line.value().shoot([&](std::string_view doing) {
      if (terminal) fmt::print(stderr, "\r\x1b[K{}", say("shot {}/{}: {}", i, options.shots, doing));
    });
    if (terminal) fmt::print(stderr, "\r\x1b[K");
    if (!shot.ok()) {
      good = shot.error();
      break;
    }
    if (i == 1)
      for (const std::string& warning : shot.value().warnings) complain(say("warning: {}", quote(warning)));
    shots.push_back(std::move(shot.value()));
  }
  ViewRequest request;
  request.hold_out = options.hold_out;
  if (good.ok()) good = combine(shots, request);
  taken = good.ok() ? take_view(session, request) : Result<Taken>(good.error());
  // A complete view that could not be copied exists only as the daemon's scans.
  const bool has_no_copy = good.ok() && !taken.ok();
  // A failed release is ignored, because the daemon deletes the scan after a week.
  for (const LiveShot& shot : shots) {
    if (has_no_copy)
      complain(say("kept for a week: {}, of the flange at \"{}\"", shot.scan_path, request.flange));
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
  if (ended.value().other.empty()) return say("it does not hold the line any more");
  return say("it does not hold the line; \"{}\" of {} does, and nothing was done to it", ended.value().other,
             ended.value().other_operator);
}

}  // namespace slabd::cli
