// SPDX-License-Identifier: Apache-2.0
//
// slabctl calibrate new: what is known before the first view is agreed once, so that every later command is short and
// every view is judged alike.
#include <fmt/core.h>
#include <algorithm>
#include <filesystem>
#include <memory>

#include "cli/calibrate/calibrate.h"
#include "cli/calibrate/find_ball.h"
#include "cli/calibrate/session.h"
#include "cli/calibrate/solve_options.h"
#include "cli/client/calibration_desk.h"
#include "cli/client/record_options.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"

namespace slabd::cli {
namespace {

namespace fs = std::filesystem;

struct Options {
  std::string name;
  std::string config;
  std::string kind = "ball";
  double radius_mm = kNoValue;
  double radius_sigma_mm = 0.003;
  std::string certificate;
  SolveOptions solve;
  BallOptions ball;
  std::size_t goal = 20;
  std::size_t held_out = 3;
  std::string flange_form = "quaternion";
  std::string start;
  std::string operator_name;
  bool json = false;
};

/// The scanner's place as it is believed to be: what was said, else in force, else commissioned.
void find_start(const Options& options, const std::optional<daemon::Config>& config, calib::SessionSettings& settings) {
  if (!options.start.empty()) {
    const Result<Pose> pose = parse_pose(options.start);
    if (!pose.ok()) stop(kUsage, fmt::format("--start: {}", pose.error().text.view()));
    settings.has_start = true;
    settings.T_flange_scanner = pose.value();
    settings.start_id = "as given";
  } else if (config) {
    const InForce in_force = hand_eye_in_force(*config);
    settings.has_start = !in_force.id.empty();
    settings.T_flange_scanner = in_force.T_flange_scanner;
    settings.start_id = in_force.id.view();
  }
}

/// Every later command finds the session by its name, on a command line, in a list and in the note of the last one,
/// which is a line.
bool is_usable(const std::string& dir, const std::string& name) {
  const bool shown = std::none_of(dir.begin(), dir.end(), [](char c) { return (c >= 0 && c < ' ') || c == '\x7F'; });
  return shown && !name.empty() && !name.starts_with('.') && !name.starts_with(' ') && !name.ends_with(' ');
}

/// The words of a format header that `--flange-form` means.
std::string form_words(const std::string& form) {
  if (form == "quaternion") return "";
  if (form == "kuka") return "rotation=kuka_abc unit=mm angle=deg";
  return form;
}

int begin(const Options& options) {
  std::optional<daemon::Config> config;
  if (!config_if_any(options.config, config)) stop(kBadInput);
  const std::string dir = need(session_dir(options.name, options.config), kUsage);

  calib::SessionSettings settings;
  settings.kind = options.kind == "ball" ? calib::ArtefactKind::ball : calib::ArtefactKind::pose;
  settings.name = fs::path(dir).lexically_normal().filename().string();
  if (settings.name.empty()) settings.name = fs::path(dir).parent_path().filename().string();
  if (!is_usable(dir, settings.name))
    stop(kUsage,
         "NAME: a session's name neither begins with a dot nor begins or ends with a blank, and no character of its "
         "folder is one that cannot be seen");
  settings.created = iso_time(wall_clock_us());
  if (config) settings.config = fs::absolute(options.config.empty() ? kDefaultConfig : options.config).string();
  settings.operator_name = options.operator_name.empty() ? default_operator() : options.operator_name;
  settings.noise = options.solve.noise();
  settings.limit_mm = options.solve.limit_mm;
  settings.fov = options.solve.settings().fov;
  settings.scanner_noise_mm = options.ball.noise_mm;
  settings.noise_correlation_mm = options.ball.noise_correlation_mm;
  settings.parallel = options.ball.parallel;
  settings.unit = options.ball.unit;
  settings.goal = options.goal;
  settings.held_out = options.held_out;
  settings.flange_form = form_words(options.flange_form);
  if (config) settings.down_base = config->T_base_slab.rotation * -Vec3::UnitZ();
  if (const std::string fault = options.solve.fov_fault(); !fault.empty()) stop(kUsage, fault);
  if (settings.goal < settings.held_out + calib::kViewsMin)
    stop(kUsage, fmt::format("--views {}: with {} held out, {} would be left to solve with; at least {} are needed",
                             settings.goal, settings.held_out,
                             settings.goal - std::min(settings.goal, settings.held_out), calib::kViewsMin));
  // The form is tried on a pose, so that a wrong word shows now and not at the robot.
  const std::string sample = settings.flange_form.find("kuka") != std::string::npos ? "0 0 0 0 0 0" : "0 0 0 1 0 0 0";
  if (options.flange_form != "quaternion" && options.flange_form != "kuka" &&
      settings.flange_form.find("xyzw") == std::string::npos)
    if (const Result<Pose> tried = calib::parse_flange(settings.flange_form, sample, "--flange-form"); !tried.ok())
      stop(kUsage, tried.error().text.view());

  std::string certificate;
  if (settings.kind == calib::ArtefactKind::ball) {
    if (!has_value(options.radius_mm))
      stop(kUsage, "kind ball needs --radius: the certified, effective radius in mm (not the diameter)");
    settings.radius_mm = options.radius_mm;
    settings.radius_sigma_mm = options.radius_sigma_mm;
  } else {
    if (options.certificate.empty()) stop(kUsage, "kind artefact needs --certificate; docs/CALIBRATION.md shows one");
    const std::string text = need(text_file(options.certificate), kBadInput);
    const auto parsed = need(calib::parse_certificate(text, options.certificate), kBadInput);
    certificate = text;
  }
  find_start(options, config, settings);
  need(Session::create(dir, settings, certificate));
  const Session session = need(Session::open(dir), kInternal);
  remember_session(session.dir());
  if (options.json) {
    Json json("slabd.calibration_session/1");
    write_session(json, session);
    fmt::print("{}", json.text());
    return kDone;
  }
  fmt::print("{}: begun\n", session_words(session));
  if (!settings.has_start)
    fmt::print(
        "where the scanner sits is not known even roughly: poses are suggested from the sixth view on; --start "
        "would help\n");
  fmt::print("{}", guide_text(session, session.guide()));
  return kDone;
}

}  // namespace

void add_calibrate_new(args::Command& group) {
  auto options = std::make_shared<Options>();
  args::Command command =
      group.add_subcommand("new", "Begin a calibration of the scanner on the flange: the commands after it lead on");
  command->footer(
      "\nThe routine: new, then capture until the goal is reached, solve, verify, apply; list, drop and undo on the "
      "way.\n"
      "Every command can be stopped at any moment and given again; nothing that was captured is lost.\n"
      "Example: slabctl calibrate new hall-2 --kind ball --radius 25.4 --robot-sigma-mm 0.017\n"
      "Exit status: 0 done, 2 usage, 3 bad input, 4 the disk.");
  command
      ->add_option("NAME", options->name,
                   "Of the session: a name below [calibration] sessions_dir, or a folder (with a /) to make")
      ->required();
  command->add_option("--config", options->config,
                      fmt::format("The daemon's configuration (default: {})", kDefaultConfig));
  command->add_option("--kind", options->kind, "ball: a tooling ball; artefact: three to eight balls on a frame")
      ->check(args::one_of({"ball", "artefact", "pose"}))
      ->capture_default_str();
  command->add_option("--radius", options->radius_mm, "Kind ball: certified radius in mm")->check(within(1.0, 200.0));
  command->add_option("--radius-sigma-mm", options->radius_sigma_mm, "Its standard uncertainty (k = 1)")
      ->check(within(0.0, 1.0))
      ->capture_default_str();
  command->add_option("--certificate", options->certificate, "Kind artefact: what the laboratory certified");
  command->add_option("--views", options->goal, "Goal: accepted views, held-out ones among them")
      ->check(args::range(std::size_t{6}, calib::kViewsMax))
      ->capture_default_str();
  command->add_option("--hold-out", options->held_out, "How many of them take no part in the fit, to verify it")
      ->check(args::range(std::size_t{3}, std::size_t{100}))
      ->capture_default_str();
  command
      ->add_option("--flange-form", options->flange_form,
                   "Form of poses given with --flange: quaternion (x y z qw qx qy qz, mm), kuka (X Y Z A B C, mm and "
                   "deg), or the words of a table's format header")
      ->capture_default_str();
  command->add_option(
      "--start", options->start,
      "Roughly where the scanner sits, T_flange_scanner \"x y z qw qx qy qz\" (default: the calibration "
      "in force, else the commissioning value)");
  command->add_option("--operator", options->operator_name, "Who does it (default: your login)");
  options->solve.add_to(*command);
  options->ball.add_to(*command);
  command->add_flag("--json", options->json, "Print slabd.calibration_session/1 on stdout");
  command->runs([options] { return begin(*options); });
}

}  // namespace slabd::cli
