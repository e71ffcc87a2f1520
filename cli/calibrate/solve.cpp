// SPDX-License-Identifier: Apache-2.0
//
// slabctl calibrate solve: views of the session, or two tables of poses, in; T_flange_scanner and every figure out.
#include <fmt/core.h>

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <memory>

#include "cli/calibrate/calibrate.h"
#include "cli/calibrate/session_solution.h"
#include "cli/calibrate/solve_options.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
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
  if (scale.views == 0) return "scanner scale: no view sees both balls of the bar\n";
  return fmt::format(
      "scanner scale: {:+.0f} +- {:.0f} ppm (1 sigma) against {:.4f} mm, {} views{}; a diagnosis, not applied\n",
      scale.ppm, scale.sigma_ppm, bar[2], scale.views, scale.suspicious ? ": SUSPICIOUS" : "");
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
    Json json("slabd.hand_eye/1");
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
    fmt::print("hand-eye calibration from {} and {}: {}", options.flange, options.target,
               hand_eye_text(kind, result, noise));
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
    Json json("slabd.hand_eye/1");
    json.field("software", daemon::software_version());
    write_session(json, session);
    json.field("id", solution.record.id).field("stored", keeps).field("same_as_before", again);
    json.field("inputs_sha256", solution.record.inputs).field("figures_sha256", solution.record.figures);
    write_hand_eye(json, session.settings().kind, h, session.settings().noise);
    json.field("next", next_command(session));
    fmt::print("{}", json.text());
  } else {
    fmt::print("{}: {}", session_words(session), hand_eye_text(session.settings().kind, h, session.settings().noise));
    if (keeps)
      fmt::print("{} as {} (step {}){}\n", again ? "the same, bit for bit, as stored" : "stored", solution.record.id,
                 solution.record.step, h.ok ? "" : "; refused, so it is never applied");
  }
  for (const Session::Entry& entry : session.entries())
    if (!entry.unreadable.empty())
      complain(fmt::format("view {} is left out: {}", entry.view.number, entry.unreadable));
  if (h.ok) {
    if (!options.json) fmt::print("next: slabctl calibrate verify\n");
    return kDone;
  }
  if (!options.json)
    fmt::print(
        "next: cure what is named above; slabctl calibrate list shows every view, slabctl calibrate drop N --why "
        "\"...\" leaves one out, slabctl calibrate capture takes more\n");
  return kRefused;
}

/// CLI11 has checked that four numbers are there, and that none is negative.
void check_ball_bar(const std::vector<double>& bar) {
  const auto is_ball = [](double number) {
    return number >= 1.0 && number <= static_cast<double>(calib::kBallsMax) && number == std::floor(number);
  };
  if (is_ball(bar[0]) && is_ball(bar[1]) && bar[0] != bar[1] && bar[2] > 0.0) return;
  stop(kUsage, fmt::format("--ball-bar {:g} {:g} {:g} {:g}: the first two are balls of the target table, different "
                           "whole numbers within 1 .. {}, the third is their certified distance, above 0 mm",
                           bar[0], bar[1], bar[2], bar[3], calib::kBallsMax));
}

int solve(const Options& options) {
  if (!options.ball_bar.empty()) check_ball_bar(options.ball_bar);
  const int given =
      (options.kind.empty() ? 0 : 1) + (options.flange.empty() ? 0 : 1) + (options.target.empty() ? 0 : 1);
  if (given == 0 && options.ball_bar.empty()) return solve_kept_views(options);
  if (const std::string fault = options.solve.fov_fault(); given == 3 && !fault.empty()) stop(kUsage, fault);
  if (given == 3) return solve_tables(options);
  stop(kUsage, "give --kind, --flange and --target to solve two tables, or none of them to solve the session");
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
  if (file == nullptr) return error(Code::config, "%s: %s", path.c_str(), std::strerror(errno));
  std::string text(kBytesMax + 1, '\0');
  const std::size_t bytes = std::fread(text.data(), 1, text.size(), file);
  const bool failed = std::ferror(file) != 0;
  const int reason = errno;
  std::fclose(file);
  if (failed) return error(Code::config, "%s: %s", path.c_str(), std::strerror(reason));
  if (bytes > kBytesMax) return error(Code::config, "%s: larger than %zu bytes", path.c_str(), kBytesMax);
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

}  // namespace slabd::cli
