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

namespace slabd::cli {

namespace {

/// A wrong radius shifts every centre along the view and X with them; no residual, left-out or held-out view shows it.
/// What the balls themselves show is held against the certificate, and the shift against what the result claims.
void judge_radius(const Session& session, calib::HandEye& h) {
  const calib::SessionSettings& settings = session.settings();
  calib::BallSettings balls;
  balls.radius_mm = settings.radius_mm;
  balls.radius_sigma_mm = settings.radius_sigma_mm;
  if (const auto certificate = session.certificate()) {
    balls.radius_mm = certificate->ball_radius_mm;
    balls.radius_sigma_mm = certificate->ball_radius_sigma_mm;
  }
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
  if (!(std::abs(check.shift_mm) > std::max(kLeastMm, h.predicted_point_sigma_mm))) {
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
  const calib::HandEye& h = solution.hand_eye;
  calib::SolvedRecord& record = solution.record;
  record.inputs = session.inputs();
  record.ok = h.ok;
  if (h.determined) {
    record.numbers.T_flange_scanner = h.T_flange_scanner;
    // The record's sigmas are per axis: of a point somewhere in the field of view, and of the rotation.
    record.numbers.sigma_mm = h.predicted_point_sigma_mm / std::sqrt(3.0);
    record.numbers.sigma_rad = std::sqrt(h.covariance.bottomRightCorner<3, 3>().trace() / 3.0);
    storage::CalibrationRecord kept;
    kept.numbers = record.numbers;
    record.id = storage::calibration_id(kept);
  }
  record.point_sigma_mm = h.predicted_point_sigma_mm;
  record.leave_one_out_mm = h.leave_one_out_mm.median;
  record.s0 = h.s0;
  Json json;
  json.begin_object().field("schema", "slabd.hand_eye/1").field("software", daemon::software_version().view());
  json.field("id", std::string_view(record.id)).field("inputs_sha256", std::string_view(record.inputs));
  write_hand_eye(json, settings.kind, h, settings.noise);
  solution.figures = json.end_object().text();
  return solution;
}

std::string observations_text(const Session& session) {
  std::string text = "# ---- session.txt\n" + calib::session_text(session.settings());
  for (const Session::Entry& entry : session.entries())
    if (entry.counts())
      text += fmt::format("# ---- views/{:03}/view.txt\n", entry.view.number) + calib::view_text(entry.view);
  return text;
}

bool ready_to_use(const Session& session, int& exit_status) {
  exit_status = kRefused;
  if (!session.solution()) {
    complain("the session is not solved yet; next: slabctl calibrate solve");
    return false;
  }
  if (!session.solution_is_current()) {
    complain("views were captured, dropped or taken back since it was solved; next: slabctl calibrate solve");
    return false;
  }
  if (!session.solution()->record.ok) {
    complain(
        "its solution was refused and stored with --force: it is never applied; slabctl calibrate solve says what is "
        "wrong and what to do");
    return false;
  }
  exit_status = kDone;
  return true;
}

}  // namespace slabd::cli
