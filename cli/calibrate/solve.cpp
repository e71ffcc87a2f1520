// SPDX-License-Identifier: Apache-2.0
//
// slabctl calibrate solve: computes T_flange_scanner and all figures from the session's views or from two tables of
// poses.
#include <fmt/core.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <memory>

#include "cli/calibrate/calibrate.h"
#include "cli/calibrate/session.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/say.h"
#include "daemon/measure.h"

namespace slabd::cli {
namespace {

struct Options {
  SolveOptions solve;
  std::string kind;
  std::string flange;
  std::string target;
  std::vector<double> ball_bar;
  SessionOptions session;
  bool force = false;
  bool json = false;
};

Result<std::vector<calib::View>> read_views(calib::ArtefactKind kind, const Options& options,
                                            calib::DeclaredFormats& declared) {
  const Result<std::string> flange_text = text_file(options.flange);
  if (!flange_text) return flange_text.error();
  const Result<std::string> target_text = text_file(options.target);
  if (!target_text) return target_text.error();
  const auto flange = calib::parse_poses(flange_text.value(), options.flange, calib::TableRole::flange);
  if (!flange) return flange.error();
  const auto target = calib::parse_poses(target_text.value(), options.target, calib::TableRole::target);
  if (!target) return target.error();
  declared = {flange.value().format, target.value().format};
  return calib::views_from(kind, flange.value(), options.flange, target.value(), options.target);
}

std::string scale_text(const calib::ScaleDiagnosis& scale, const std::vector<double>& bar) {
  if (scale.views == 0) return say("scanner scale: no view contains both balls of the bar\n");
  return say("scanner scale: {:+.0f} +- {:.0f} ppm (1 sigma) against {:.4f} mm, {} views{}; a diagnosis, not applied\n",
             scale.ppm, scale.sigma_ppm, bar[2], scale.views, scale.suspicious ? say(": SUSPICIOUS") : "");
}

int solve_tables(const Options& options) {
  const calib::ArtefactKind kind = options.kind == "pose" ? calib::ArtefactKind::pose : calib::ArtefactKind::ball;
  calib::SolveSettings settings = options.solve.settings();
  const std::vector<calib::View> views = need(read_views(kind, options, settings.declared), kBadInput);
  const calib::StatedNoise noise = options.solve.noise();
  const calib::HandEye result = need(calib::solve(kind, views, noise, settings), kBadInput);
  calib::ScaleDiagnosis scale;
  if (!options.ball_bar.empty()) {
    const auto ball = [&](std::size_t k) { return static_cast<std::size_t>(options.ball_bar[k]) - 1; };
    scale = calib::diagnose_scale(views, ball(0), ball(1), options.ball_bar[2], options.ball_bar[3], noise.target_mm);
  }
  if (options.json) {
    report::Json json("slabd.hand_eye/1");
    json.field("software", daemon::software_version()).field("flange", options.flange);
    json.field("target_file", options.target);
    write_hand_eye(json, kind, result, noise);
    if (!options.ball_bar.empty()) {
      json.key("scale").begin_object().field("views", scale.views).field("ppm", scale.ppm);
      json.field("sigma_ppm", scale.sigma_ppm).field("suspicious", scale.suspicious).field("applied", false);
      json.end_object();
    }
    fmt::print("{}", json.text());
  } else {
    fmt::print("{}", say("hand-eye calibration from {} and {}: {}", options.flange, options.target,
                         hand_eye_text(kind, result, noise)));
    if (!options.ball_bar.empty()) fmt::print("{}", scale_text(scale, options.ball_bar));
  }
  return result.ok ? kDone : kRefused;
}

int solve_kept_views(const Options& options) {
  Session session = find_session(options.session);
  need(session.lock());
  SessionSolution solution = need(solve_session(session));
  const calib::HandEye& h = solution.hand_eye;
  const std::size_t before = session.solution() ? session.solution()->record.step : 0;
  const bool keeps = h.ok || options.force;
  if (keeps) need(session.keep_solution(solution.record, solution.figures));
  const bool again = keeps && before == solution.record.step;
  if (options.json) {
    report::Json json("slabd.hand_eye/1");
    json.field("software", daemon::software_version());
    write_session(json, session);
    json.field("id", solution.record.id).field("stored", keeps).field("same_as_before", again);
    json.field("inputs_sha256", solution.record.inputs).field("figures_sha256", solution.record.figures);
    write_hand_eye(json, session.settings().kind, h, session.settings().noise);
    json.field("next", next_command(session));
    fmt::print("{}", json.text());
  } else {
    fmt::print("{}", say("{}: {}", session_words(session),
                         hand_eye_text(session.settings().kind, h, session.settings().noise)));
    if (keeps)
      fmt::print("{}",
                 say("{} as {} (step {}){}\n", again ? say("the same, bit for bit, as stored") : say("stored"),
                     solution.record.id, solution.record.step, h.ok ? "" : say("; refused, so it is never applied")));
  }
  for (const Session::Entry& entry : session.entries())
    if (!entry.unreadable.empty()) complain(say("view {} is left out: {}", entry.view.number, entry.unreadable));
  if (h.ok) {
    if (!options.json) fmt::print("{}", say("next: slabctl calibrate verify\n"));
    return kDone;
  }
  if (!options.json)
    fmt::print("{}", say("next: cure what is named above; slabctl calibrate list shows every view, slabctl calibrate "
                         "drop N --reason "
                         "\"...\" leaves one out, slabctl calibrate capture takes more\n"));
  return kRefused;
}

/// CLI11 has checked that there are four numbers, none of them negative.
void check_ball_bar(const std::vector<double>& bar) {
  const auto is_ball = [](double number) {
    return number >= 1.0 && number <= static_cast<double>(calib::kBallsMax) && number == std::floor(number);
  };
  if (is_ball(bar[0]) && is_ball(bar[1]) && bar[0] != bar[1] && bar[2] > 0.0) return;
  stop(kUsage, say("--ball-bar {:g} {:g} {:g} {:g}: the first two are balls of the target table, different "
                   "whole numbers within 1 .. {}, the third is their certified distance, above 0 mm",
                   bar[0], bar[1], bar[2], bar[3], calib::kBallsMax));
}

int solve(const Options& options) {
  set_language(options.session.language, options.json);
  if (!options.ball_bar.empty()) check_ball_bar(options.ball_bar);
  const int given =
      (options.kind.empty() ? 0 : 1) + (options.flange.empty() ? 0 : 1) + (options.target.empty() ? 0 : 1);
  if (given == 0 && options.ball_bar.empty()) return solve_kept_views(options);
  if (const std::string fault = options.solve.fov_fault(); given == 3 && !fault.empty()) stop(kUsage, fault);
  if (given == 3) return solve_tables(options);
  stop(kUsage, say("give --kind, --flange and --target to solve two tables, or none of them to solve the session"));
}

constexpr const char* kFooter = R"(
Without tables: solves the views of the session (slabctl calibrate new, capture) with the noise, field of view and
limit agreed at its beginning, and stores the result in it. Solving again gives the same bits.

With tables:
FLANGE and TARGET are tables of text, one pose a line, `x y z qw qx qy qz` (mm, unit quaternion, # comments):
T_base_flange as the robot reported it, and on the same line of the other table T_scanner_target, or for a ball
its centre `x y z 1 0 0 0`. Any other form is declared in a header line, never guessed:
  # format: rotation=kuka_abc unit=mm angle=deg frames=T_base_flange        x y z A B C, R = Rz(A) Ry(B) Rx(C)
  # format: rotation=quaternion_xyzw unit=m                                 x y z qx qy qz qw
  # format: rotation=none labels=view,ball                                  view ball x y z, several balls

Noise is per axis, one standard deviation. A data sheet's repeatability +-R (ISO 9283) is about R / 3.6.
A refused result prints the same figures, says why and what to do, and ends with status 6.

Example: slabctl calibrate solve --kind ball --flange flange.txt --target target.txt --robot-sigma-mm 0.06)";

}  // namespace

Result<std::string> text_file(const std::string& path) {
  constexpr std::size_t kBytesMax = 16U << 20U;
  std::FILE* file = std::fopen(path.c_str(), "rb");
  if (file == nullptr) return said_error(Code::config, path + ": " + quote(std::strerror(errno)));
  std::string text(kBytesMax + 1, '\0');
  const std::size_t bytes = std::fread(text.data(), 1, text.size(), file);
  const bool failed = std::ferror(file) != 0;
  const int reason = errno;
  std::fclose(file);
  if (failed) return said_error(Code::config, path + ": " + quote(std::strerror(reason)));
  if (bytes > kBytesMax) return said_error(Code::config, say("{}: larger than {} bytes", path, kBytesMax));
  text.resize(bytes);
  return text;
}

void add_calibrate_solve(args::Command& group) {
  auto options = std::make_shared<Options>();
  args::Command command = group.add_subcommand("solve", "T_flange_scanner from views of a fixed artefact, or why not");
  command->footer(kFooter);
  command->add_option("--kind", options->kind, "Artefact: ball (one or more tooling balls) or pose")
      ->check(args::one_of({"ball", "pose"}));
  command->add_option("--flange", options->flange, "Table of T_base_flange");
  command->add_option("--target", options->target, "Table of ball centres or T_scanner_target");
  options->solve.add_to(*command);
  command
      ->add_option("--ball-bar", options->ball_bar,
                   "Diagnose the scanner's scale: two ball numbers, their certified distance and its sigma (mm)")
      ->expected(4)
      ->check(at_least(0.0));
  options->session.add_to(*command);
  command->add_flag("--force", options->force, "Session: store a refused solution too; it is never applied");
  command->add_flag("--json", options->json, "Print slabd.hand_eye/1 on stdout");
  command->runs([options] { return solve(*options); });
}

calib::StatedNoise SolveOptions::noise() const {
  const bool rotation_stated = has_value(robot_sigma_deg);
  calib::StatedNoise noise;
  noise.robot_mm = robot_sigma_mm;
  noise.robot_rad = rotation_stated ? rad_from_deg(robot_sigma_deg) : calib::robot_rad_for(robot_sigma_mm);
  noise.target_mm = target_sigma_mm;
  if (has_value(target_sigma_deg))
    noise.target_rad = rad_from_deg(target_sigma_deg);
  else if (!rotation_stated)
    noise.target_rad *= std::max(1.0, robot_sigma_mm / calib::StatedNoise{}.robot_mm);
  return noise;
}

calib::SolveSettings SolveOptions::settings() const {
  calib::SolveSettings settings;
  if (fov.size() == 4) settings.fov = {fov[0], fov[1], fov[2], fov[3]};
  settings.point_sigma_mm_max = limit_mm;
  return settings;
}

std::string SolveOptions::fov_fault() const {
  const calib::FieldOfView view = settings().fov;
  if (view.near_mm < view.far_mm && view.half_x_mm > 0.0 && view.half_y_mm > 0.0) return "";
  return say(
      "--fov: half width, half height, nearest, furthest in mm; nearest must be less than furthest, and the halves "
      "above 0");
}

void SolveOptions::add_to(args::Command& command) {
  command.add_option("--robot-sigma-mm", robot_sigma_mm, "Robot's position noise per axis")
      ->check(at_least(0.0))
      ->capture_default_str();
  command
      .add_option("--robot-sigma-deg", robot_sigma_deg,
                  "Robot's rotation noise per axis; default 0.0023 per 0.06 mm of its position noise")
      ->check(at_least(0.0));
  command.add_option("--target-sigma-mm", target_sigma_mm, "Noise of a ball's centre or the artefact's origin")
      ->check(at_least(0.0))
      ->capture_default_str();
  command
      .add_option("--target-sigma-deg", target_sigma_deg,
                  "Noise of the artefact's rotation; default 0.003, or if no rotation noise is stated and the robot's "
                  "position noise is above 0.06 mm, in proportion to it")
      ->check(at_least(0.0));
  command
      .add_option("--limit-mm", limit_mm,
                  "Refuse when the predicted point error (1 sigma) is above; default 6 times the stated position noise")
      ->check(at_least(0.0));
  command
      .add_option("--fov", fov,
                  "Field in which the error is predicted: half width, half height, nearest, furthest (mm); default 100 "
                  "100 420 580")
      ->expected(4)
      ->check(at_least(0.0));
}

// The solution of a session and its record. Both are computed only from the views (not from the clock or paths), so
// solving again gives the same bits and the same id.

namespace {

/// Certified balls: from the artefact's certificate if there is one.
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

/// Covariance of X from the sigma of the certified radius. A radius error moves the centres of all views along the
/// view by the same amount. This error of X does not decrease with the number of views and is not visible in
/// residuals.
Mat6 covariance_of_radius(const Session& session, const std::vector<calib::View>& views, const calib::HandEye& h) {
  const calib::SessionSettings& settings = session.settings();
  std::vector<Vec3> shifts_mm;
  for (const calib::View& view : views) {
    const bool pose = settings.kind == calib::ArtefactKind::pose;
    const Vec3& seen = pose ? view.T_scanner_target.translation_mm : view.balls.front().centre_mm;
    const Vec3 along = settings.parallel ? Vec3(Vec3::UnitZ()) : Vec3(seen.normalized());
    double half_angle_rad = calib::BallSettings{}.half_angle_min_rad;  // an accepted view has at least this cap
    for (const Session::Entry& entry : session.entries())
      if (entry.view.number == view.number && has_value(entry.view.half_angle_deg))
        half_angle_rad = rad_from_deg(entry.view.half_angle_deg);
    shifts_mm.emplace_back(calib::shift_per_radius(half_angle_rad) * along);
  }
  const calib::Vec6 per_mm = calib::motion_from_shifts(settings.kind, views, h, settings.noise, shifts_mm);
  const double sigma_mm = certified_balls(session).radius_sigma_mm;
  return sigma_mm * sigma_mm * per_mm * per_mm.transpose();
}

/// Compares the radius of the balls in the scans with the certificate, and the resulting shift with the claimed
/// accuracy. A wrong radius moves every centre along the view and X with them; residuals of fitted, left-out or
/// held-out views do not show it.
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
  constexpr double kLeast_mm = 0.02;
  // The sigmas of the record include the certificate's uncertainty.
  if (check.covered || !(std::abs(check.shift_mm) > std::max(kLeast_mm, h.predicted_point_sigma_mm))) {
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
    return said_error(Code::config,
                      say("no view of the session counts yet; take one: slabctl calibrate capture --help"));
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
    // The record's sigmas are per axis: of a point in the field of view, and of the rotation. They include the
    // contribution of the artefact, because it is an error of X.
    record.numbers.sigma_mm = calib::point_sigma_mm(covariance, h.T_flange_scanner, settings.fov) / std::sqrt(3.0);
    record.numbers.sigma_rad = std::sqrt(covariance.bottomRightCorner<3, 3>().trace() / 3.0);
    storage::CalibrationRecord kept;
    kept.numbers = record.numbers;
    if (!settings.scanner.empty()) kept.scanner = settings.scanner;
    record.id = storage::calibration_id(kept);
  }
  record.point_sigma_mm = h.predicted_point_sigma_mm;
  record.leave_one_out_mm = h.leave_one_out_mm.median;
  record.s0 = h.s0;
  report::Json json("slabd.hand_eye/1");
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
  if (!session.solution()) stop(kRefused, say("the session is not solved yet; next: slabctl calibrate solve"));
  if (!session.solution_is_current())
    stop(kRefused,
         say("views were captured, dropped or taken back since it was solved; next: slabctl calibrate solve"));
  if (!session.solution()->record.ok)
    stop(kRefused, say("its solution was refused and stored with --force: it is never applied; slabctl calibrate solve "
                       "says what is "
                       "wrong and what to do"));
}

}  // namespace slabd::cli
