// SPDX-License-Identifier: Apache-2.0
//
// The solution of a session and the record that is applied of it. Both are computed from what the views hold and from
// nothing else (no clock, no place on the disk), so solving again gives the same bits, and the id says so.
#include "cli/calibrate/session_solution.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "cli/calibrate/calibrate.h"
#include "cli/exit.h"
#include "daemon/measure.h"

namespace slabd::cli {

namespace {

/// What the balls are certified as; the artefact's own certificate, if there is one.
calib::BallSettings certified_balls(const Session& session) {
  calib::BallSettings balls;
  balls.radius_mm = session.settings().radius_mm;
  balls.radius_sigma_mm = session.settings().radius_sigma_mm;
  if (const auto certificate = session.certificate()) {
    balls.radius_mm = certificate->ball_radius_mm;
    balls.radius_sigma_mm = certificate->ball_radius_sigma_mm;
  }
  return balls;
}

/// What the certified radius may be wrong by moves the centres of all views along the view, by the same amount: an
/// error of X that does not fall with their number and is in no residual. Of the sigma of the radius, as a covariance
/// of X.
Mat6 covariance_of_radius(const Session& session, const std::vector<calib::View>& views, const calib::HandEye& h) {
  const calib::SessionSettings& settings = session.settings();
  std::vector<Vec3> shifts_mm;
  for (const calib::View& view : views) {
    const bool pose = settings.kind == calib::ArtefactKind::pose;
    const Vec3& seen = pose ? view.T_scanner_target.translation_mm : view.balls.front().centre_mm;
    const Vec3 along = settings.parallel ? Vec3(Vec3::UnitZ()) : Vec3(seen.normalized());
    double half_angle_rad = calib::BallSettings{}.half_angle_min_rad;  // no accepted view has a smaller cap
    for (const Session::Entry& entry : session.entries())
      if (entry.view.number == view.number && has_value(entry.view.half_angle_deg))
        half_angle_rad = rad_from_deg(entry.view.half_angle_deg);
    shifts_mm.emplace_back(calib::shift_per_radius(half_angle_rad) * along);
  }
  const calib::Vec6 per_mm = calib::motion_from_shifts(settings.kind, views, h, settings.noise, shifts_mm);
  const double sigma_mm = certified_balls(session).radius_sigma_mm;
  return sigma_mm * sigma_mm * per_mm * per_mm.transpose();
}

/// A wrong radius shifts every centre along the view and X with them; no residual, left-out or held-out view shows it.
/// What the balls themselves show is held against the certificate, and the shift against what the result claims.
void judge_radius(const Session& session, calib::HandEye& h) {
  const calib::BallSettings balls = certified_balls(session);
  std::vector<calib::BallReport> seen;
  for (const Session::Entry& entry : session.entries()) {
    if (!entry.counts() || !has_value(entry.view.radius_off_mm)) continue;
    calib::BallReport& ball = seen.emplace_back();
    ball.refusal = calib::BallRefusal::none;
    ball.radius_free_mm = balls.radius_mm + entry.view.radius_off_mm;
    ball.shift_per_radius = calib::shift_per_radius(rad_from_deg(entry.view.half_angle_deg)) * Vec3::UnitZ();
  }
  const calib::RadiusCheck check = calib::check_radius(seen, balls);
  if (!check.suspicious) return;
  constexpr double kLeastMm = 0.02;
  // What the certificate covers is in the sigmas of the record.
  if (check.covered || !(std::abs(check.shift_mm) > std::max(kLeastMm, h.predicted_point_sigma_mm))) {
    h.warnings.emplace_back(check.words.reason.view());
    return;
  }
  h.ok = false;
  h.reasons.push_back({calib::Refusal::ball_radius, std::string(check.words.reason.view()),
                       std::string(check.words.cure.view()) + "; then begin a session with that radius"});
}

}  // namespace

Result<SessionSolution> solve_session(const Session& session) {
  Result<std::vector<calib::View>> views = session.views(calib::ViewUse::fit);
  if (!views.ok()) return views.error();
  if (views.value().empty())
    return error(Code::config, "no view of the session counts yet; take one: slabctl calibrate capture --help");
  const calib::SessionSettings& settings = session.settings();
  Result<calib::HandEye> solved = calib::solve(settings.kind, views.value(), settings.noise, session.solve_settings());
  if (!solved.ok()) return solved.error();
  SessionSolution solution{std::move(views.value()), std::move(solved.value()), {}, {}};
  judge_radius(session, solution.hand_eye);
  Mat6 covariance = solution.hand_eye.covariance;
  if (solution.hand_eye.determined) {
    const Mat6 of_radius = covariance_of_radius(session, solution.views, solution.hand_eye);
    covariance += of_radius;
    const double radius_mm = calib::point_sigma_mm(of_radius, solution.hand_eye.T_flange_scanner, settings.fov);
    if (radius_mm > solution.hand_eye.predicted_point_sigma_mm)
      solution.hand_eye.warnings.push_back(fmt::format(
          "the certified radius is uncertain by {:.4f} mm (k = 1): that moves a scanned point by {:.3f} mm, "
          "more than the {:.3f} mm predicted from the views; have it certified better, more views do not help",
          certified_balls(session).radius_sigma_mm, radius_mm, solution.hand_eye.predicted_point_sigma_mm));
  }
  const calib::HandEye& h = solution.hand_eye;
  calib::SolvedRecord& record = solution.record;
  record.inputs = session.inputs();
  record.ok = h.ok;
  if (h.determined) {
    record.numbers.T_flange_scanner = h.T_flange_scanner;
    // The record's sigmas are per axis: of a point somewhere in the field of view, and of the rotation; with what the
    // artefact adds, for whoever uses X has that in it.
    record.numbers.sigma_mm = calib::point_sigma_mm(covariance, h.T_flange_scanner, settings.fov) / std::sqrt(3.0);
    record.numbers.sigma_rad = std::sqrt(covariance.bottomRightCorner<3, 3>().trace() / 3.0);
    storage::CalibrationRecord kept;
    kept.numbers = record.numbers;
    record.id = storage::calibration_id(kept);
  }
  record.point_sigma_mm = h.predicted_point_sigma_mm;
  record.leave_one_out_mm = h.leave_one_out_mm.median;
  record.s0 = h.s0;
  Json json("slabd.hand_eye/1");
  json.field("software", daemon::software_version()).field("id", record.id).field("inputs_sha256", record.inputs);
  write_hand_eye(json, settings.kind, h, settings.noise);
  solution.figures = json.text();
  return solution;
}

std::string observations_text(const Session& session) {
  std::string text = "# ---- session.txt\n" + calib::session_text(session.settings());
  for (const Session::Entry& entry : session.entries())
    if (entry.counts())
      text += fmt::format("# ---- views/{:03}/view.txt\n", entry.view.number) + calib::view_text(entry.view);
  return text;
}

void need_solution(const Session& session) {
  if (!session.solution()) stop(kRefused, "the session is not solved yet; next: slabctl calibrate solve");
  if (!session.solution_is_current())
    stop(kRefused, "views were captured, dropped or taken back since it was solved; next: slabctl calibrate solve");
  if (!session.solution()->record.ok)
    stop(kRefused,
         "its solution was refused and stored with --force: it is never applied; slabctl calibrate solve says what is "
         "wrong and what to do");
}

}  // namespace slabd::cli
