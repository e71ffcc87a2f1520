// SPDX-License-Identifier: Apache-2.0
//
// slabctl calibrate solve: two tables of poses in, T_flange_scanner and every figure out.
#include <fmt/core.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>

#include "cli/calibrate/calibrate.h"
#include "cli/command.h"
#include "cli/exit.h"

namespace slabd::cli {
namespace {

struct Options {
  std::string kind;
  std::string flange;
  std::string target;
  double robot_sigma_mm = calib::StatedNoise{}.robot_mm;
  double robot_sigma_deg = kNoValue;
  double target_sigma_mm = calib::StatedNoise{}.target_mm;
  double target_sigma_deg = kNoValue;
  double limit_mm = kNoValue;
  std::vector<double> fov;
  std::vector<double> ball_bar;
  bool json = false;

  /// Who states nothing but a position noise for the robot gets rotations in proportion: a robot of 0.7 mm with the
  /// angles of one of 0.06 mm would weigh them a hundred times too much. Targets are not taken to be better for it.
  [[nodiscard]] calib::StatedNoise noise() const {
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
  [[nodiscard]] calib::SolveSettings settings() const {
    calib::SolveSettings settings;
    if (fov.size() == 4) settings.fov = {fov[0], fov[1], fov[2], fov[3]};
    settings.point_sigma_mm_max = limit_mm;
    return settings;
  }
};

/// A number of at least `low`, NaN and infinity refused, which CLI::Range lets through.
CLI::Validator at_least(double low) {
  const std::string range = fmt::format("at least {}", low);
  return {[=](std::string& text) {
            char* end = nullptr;
            const double value = std::strtod(text.c_str(), &end);
            const bool number = !text.empty() && end == text.c_str() + text.size() && std::isfinite(value);
            return number && value >= low ? std::string() : fmt::format("\"{}\" is not a number of {}", text, range);
          },
          range};
}

Result<std::vector<calib::View>> read_views(calib::ArtefactKind kind, const Options& options) {
  const Result<std::string> flange_text = text_file(options.flange);
  if (!flange_text) return flange_text.error();
  const Result<std::string> target_text = text_file(options.target);
  if (!target_text) return target_text.error();
  const auto flange = calib::parse_poses(flange_text.value(), options.flange, calib::TableRole::flange);
  if (!flange) return flange.error();
  const auto target = calib::parse_poses(target_text.value(), options.target, calib::TableRole::target);
  if (!target) return target.error();
  return calib::views_from(kind, flange.value(), options.flange, target.value(), options.target);
}

std::string scale_text(const calib::ScaleDiagnosis& scale, const std::vector<double>& bar) {
  if (scale.views == 0) return "scanner scale: no view sees both balls of the bar\n";
  return fmt::format(
      "scanner scale: {:+.0f} +- {:.0f} ppm (1 sigma) against {:.4f} mm, {} views{}; a diagnosis, not applied\n",
      scale.ppm, scale.sigma_ppm, bar[2], scale.views, scale.suspicious ? ": SUSPICIOUS" : "");
}

int solve(const Options& options) {
  const calib::ArtefactKind kind = options.kind == "pose" ? calib::ArtefactKind::pose : calib::ArtefactKind::ball;
  const Result<std::vector<calib::View>> views = read_views(kind, options);
  if (!views) {
    complain(views.error().text.view());
    return kBadInput;
  }
  const calib::StatedNoise noise = options.noise();
  const Result<calib::HandEye> solved = calib::solve(kind, views.value(), noise, options.settings());
  if (!solved) {
    complain(solved.error().text.view());
    return kBadInput;
  }
  const calib::HandEye& result = solved.value();
  calib::ScaleDiagnosis scale;
  if (!options.ball_bar.empty()) {
    const auto ball = [&](std::size_t k) { return static_cast<std::size_t>(options.ball_bar[k]) - 1; };
    scale = calib::diagnose_scale(views.value(), ball(0), ball(1), options.ball_bar[2], options.ball_bar[3],
                                  noise.target_mm);
  }
  if (options.json) {
    Json json;
    json.begin_object().field("schema", "slabd.hand_eye/1").field("software", daemon::software_version().view());
    json.field("flange", std::string_view(options.flange)).field("target_file", std::string_view(options.target));
    write_hand_eye(json, kind, result, noise);
    if (!options.ball_bar.empty()) {
      json.key("scale").begin_object().field("views", scale.views).field("ppm", scale.ppm);
      json.field("sigma_ppm", scale.sigma_ppm).field("suspicious", scale.suspicious).field("applied", false);
      json.end_object();
    }
    fmt::print("{}", json.end_object().text());
  } else {
    fmt::print("hand-eye calibration from {} and {}: {}", options.flange, options.target,
               hand_eye_text(kind, result, noise));
    if (!options.ball_bar.empty()) fmt::print("{}", scale_text(scale, options.ball_bar));
  }
  return result.ok ? kDone : kRefused;
}

constexpr const char* kFooter = R"(
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

void add_calibrate_solve(CLI::App& group, int& exit_status) {
  auto options = std::make_shared<Options>();
  CLI::App* command = group.add_subcommand("solve", "T_flange_scanner from views of a fixed artefact, or why not");
  command->footer(kFooter);
  command->add_option("--kind", options->kind, "Artefact: ball (one or more tooling balls) or pose")
      ->required()
      ->check(CLI::IsMember({"ball", "pose"}));
  command->add_option("--flange", options->flange, "Table of T_base_flange")->required();
  command->add_option("--target", options->target, "Table of ball centres or T_scanner_target")->required();
  command->add_option("--robot-sigma-mm", options->robot_sigma_mm, "Robot's position noise per axis")
      ->check(at_least(0.0))
      ->capture_default_str();
  command
      ->add_option("--robot-sigma-deg", options->robot_sigma_deg,
                   "Robot's rotation noise per axis; default 0.0023 per 0.06 mm of its position noise")
      ->check(at_least(0.0));
  command
      ->add_option("--target-sigma-mm", options->target_sigma_mm, "Noise of a ball's centre or the artefact's origin")
      ->check(at_least(0.0))
      ->capture_default_str();
  command
      ->add_option("--target-sigma-deg", options->target_sigma_deg,
                   "Noise of the artefact's rotation; default 0.003, or if no rotation noise is stated and the robot's "
                   "position noise is above 0.06 mm, in proportion to it")
      ->check(at_least(0.0));
  command
      ->add_option(
          "--limit-mm", options->limit_mm,
          "Refuse when the predicted point error (1 sigma) is above; default 6 times the stated position noise")
      ->check(at_least(0.0));
  command
      ->add_option(
          "--fov", options->fov,
          "Where the error is predicted: half width, half height, nearest, furthest (mm); default 100 100 420 580")
      ->expected(4)
      ->check(at_least(0.0));
  command
      ->add_option("--ball-bar", options->ball_bar,
                   "Diagnose the scanner's scale: two ball numbers, their certified distance and its sigma (mm)")
      ->expected(4)
      ->check(at_least(0.0));
  command->add_flag("--json", options->json, "Print slabd.hand_eye/1 on stdout");
  command->callback([options, &exit_status] { exit_status = solve(*options); });
}

}  // namespace slabd::cli
