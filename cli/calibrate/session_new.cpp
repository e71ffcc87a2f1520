// SPDX-License-Identifier: Apache-2.0
//
// slabctl calibrate new: stores the settings before the first view, so that later commands are short and all views are
// evaluated alike.
#include <fmt/core.h>
#include <pwd.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <memory>

#include "cli/calibrate/calibrate.h"
#include "cli/calibrate/find_ball.h"
#include "cli/calibrate/session.h"
#include "cli/client/calibration_change.h"
#include "cli/client/record_options.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/say.h"

namespace slabd::cli {
namespace {

namespace fs = std::filesystem;

struct Options {
  std::string name;
  std::string config;
  ScannerChoice scanner;
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
  LanguageOption language;
  bool json = false;
};

/// Approximate scanner pose: from the option, otherwise the one in force, otherwise the commissioning value.
void find_start(const Options& options, const std::optional<config::Config>& config, calib::SessionSettings& settings) {
  if (!options.start.empty()) {
    const Result<Pose> pose = parse_pose(options.start);
    if (!pose.ok()) stop(kUsage, say("--start: {}", quote(pose.error().text.view())));
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

/// True if the name can be used in a command line, a list, and the one-line note of the last session.
bool is_usable(const std::string& dir, const std::string& name) {
  const bool shown = std::none_of(dir.begin(), dir.end(), [](char c) { return (c >= 0 && c < ' ') || c == '\x7F'; });
  return shown && !name.empty() && !name.starts_with('.') && !name.starts_with(' ') && !name.ends_with(' ');
}

/// Words of a format header for `--flange-form`.
std::string form_words(const std::string& form) {
  if (form == "quaternion") return "";
  if (form == "kuka") return "rotation=kuka_abc unit=mm angle=deg";
  return form;
}

int begin(const Options& options) {
  set_language(options.language, options.json);
  std::optional<config::Config> config;
  if (!config_if_any(options.config, config)) stop(kBadInput);
  if (config) config = options.scanner.of(*config);
  const std::string dir = need(session_dir(options.name, options.config), kUsage);

  calib::SessionSettings settings;
  settings.kind = options.kind == "ball" ? calib::ArtefactKind::ball : calib::ArtefactKind::pose;
  settings.name = fs::path(dir).lexically_normal().filename().string();
  if (settings.name.empty()) settings.name = fs::path(dir).parent_path().filename().string();
  if (!is_usable(dir, settings.name))
    stop(
        kUsage,
        say("NAME: a session's name neither begins with a dot nor begins or ends with a blank, and no character of its "
            "folder is one that cannot be seen"));
  settings.created = report::iso_time(wall_clock_us());
  if (config) settings.config = fs::absolute(options.config.empty() ? default_config() : options.config).string();
  // The name of a scanner is part of its calibrations' ids, except "1".
  if (config && (config->arms.several() || config->by.scanner != PartId("1")))
    settings.scanner = config->by.scanner.view();
  settings.operator_name = options.operator_name.empty() ? default_operator() : options.operator_name;
  settings.noise = options.solve.noise();
  settings.limit_mm = options.solve.limit_mm;
  settings.fov = options.solve.settings().fov;
  settings.scanner_noise_mm = options.ball.noise_mm;
  settings.noise_correlation_mm = options.ball.noise_correlation_mm;
  settings.parallel = options.ball.parallel;
  ScanFormOptions form = options.ball.form;
  form.complete_from(config ? config->scanner.form : hal::ScanForm());
  settings.unit = form.unit;
  settings.columns = form.columns;
  settings.goal = options.goal;
  settings.held_out = options.held_out;
  settings.flange_form = form_words(options.flange_form);
  if (config) settings.down_base = config->T_base_slab.rotation * -Vec3::UnitZ();
  if (const std::string fault = options.solve.fov_fault(); !fault.empty()) stop(kUsage, fault);
  if (settings.goal < settings.held_out + calib::kViewsMin)
    stop(kUsage,
         say("--views {}: with {} held out, {} would be left to solve with; at least {} are needed", settings.goal,
             settings.held_out, settings.goal - std::min(settings.goal, settings.held_out), calib::kViewsMin));
  // The form is tested with a pose, so that a wrong word is detected now and not at the robot.
  const std::string sample = settings.flange_form.find("kuka") != std::string::npos ? "0 0 0 0 0 0" : "0 0 0 1 0 0 0";
  if (options.flange_form != "quaternion" && options.flange_form != "kuka" &&
      settings.flange_form.find("xyzw") == std::string::npos)
    if (const Result<Pose> tried = calib::parse_flange(settings.flange_form, sample, "--flange-form"); !tried.ok())
      stop(kUsage, tried.error());

  std::string certificate;
  if (settings.kind == calib::ArtefactKind::ball) {
    if (!has_value(options.radius_mm))
      stop(kUsage, say("kind ball needs --radius: the certified, effective radius in mm (not the diameter)"));
    settings.radius_mm = options.radius_mm;
    settings.radius_sigma_mm = options.radius_sigma_mm;
  } else {
    if (options.certificate.empty()) stop(kUsage, say("kind artefact needs --certificate; docs/TARGETS.md shows one"));
    const std::string text = need(text_file(options.certificate), kBadInput);
    const auto parsed = need(calib::parse_certificate(text, options.certificate), kBadInput);
    certificate = text;
  }
  find_start(options, config, settings);
  need(Session::create(dir, settings, certificate));
  const Session session = need(Session::open(dir), kInternal);
  remember_session(session.dir());
  if (options.json) {
    report::Json json("slabd.calibration_session/1");
    write_session(json, session);
    fmt::print("{}", json.text());
    return kDone;
  }
  fmt::print("{}", say("{}: begun\n", session_words(session)));
  if (!settings.has_start)
    fmt::print(
        "{}",
        say("where the scanner sits is not known even roughly: poses are suggested from the sixth view on; --start "
            "would help\n"));
  fmt::print("{}", guide_text(session, session.guide()));
  return kDone;
}

}  // namespace

void add_calibrate_new(args::Command& group) {
  auto options = std::make_shared<Options>();
  options->ball.form.unit.clear();  // the configuration's
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
                   "Place of the session: a name below [calibration] sessions_dir, or a folder (with a /) to make")
      ->required();
  command->add_option("--config", options->config,
                      fmt::format("The daemon's configuration (default: {})", default_config()));
  options->scanner.add_to(*command);
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
  command->add_option("--operator", options->operator_name, "Name of the operator (default: your login)");
  options->solve.add_to(*command);
  options->ball.add_to(*command);
  options->language.add_to(*command, "Language of the text");
  command->add_flag("--json", options->json, "Print slabd.calibration_session/1 on stdout");
  command->runs([options] { return begin(*options); });
}

// Default session of a command: the one this user used last, otherwise the only one; if a configuration is named, only
// sessions of its line. Every command prints its session. The note of the last session is optional; without a home
// folder --session is required.

namespace {

namespace fs = std::filesystem;

/// Path of the note; empty without a home folder.
std::string note_path() {
  if (const char* state = std::getenv("XDG_STATE_HOME"); state != nullptr && *state == '/')
    return std::string(state) + "/slabd/calibration-session";
  const char* home = std::getenv("HOME");
  if (home == nullptr || *home != '/') {
    const passwd* user = ::getpwuid(::getuid());
    home = user == nullptr ? nullptr : user->pw_dir;
  }
  return home == nullptr || *home != '/' ? "" : std::string(home) + "/.local/state/slabd/calibration-session";
}

bool is_session(const std::string& dir) {
  std::error_code fault;
  return fs::exists(dir + "/session.txt", fault);
}

std::string last_session() {
  const std::string path = note_path();
  if (path.empty()) return "";
  const Result<std::string> text = text_file(path);
  if (!text.ok()) return "";
  const std::string dir = text.value().substr(0, text.value().find('\n'));
  return is_session(dir) ? dir : "";
}

std::vector<std::string> sessions_in(const std::string& folder) {
  std::vector<std::string> found;
  std::error_code fault;
  for (fs::directory_iterator it(folder, fault), end; !fault && it != end; it.increment(fault))
    if (is_session(it->path().string())) found.push_back(it->path().string());
  std::sort(found.begin(), found.end());
  return found;
}

std::string how_to_begin() {
  return say(
      "begin one with: slabctl calibrate new NAME --kind ball --radius MM (slabctl calibrate new --help explains)");
}

/// Configuration of the other line to which a session belongs; empty if the session may be used. A named configuration
/// selects its line: a session of another line must not be solved or applied for it. A session begun without a
/// configuration may be used on any line.
std::string other_line(const std::string& dir, const std::string& config) {
  if (config.empty()) return "";
  const Result<Session> session = Session::open(dir);
  if (!session.ok()) return "";  // reported when it is opened
  const std::string& begun_with = session.value().settings().config;
  std::error_code fault;
  return begun_with.empty() || fs::equivalent(begun_with, config, fault) ? "" : begun_with;
}

/// Sessions of a line in a folder that several lines may share. `others` lists the excluded ones with the reason.
std::vector<std::string> sessions_of_line(const std::string& folder, const std::string& config, std::string& others) {
  std::vector<std::string> found;
  for (const std::string& dir : sessions_in(folder)) {
    const std::string other = other_line(dir, config);
    if (other.empty())
      found.push_back(dir);
    else
      others += (others.empty() ? "" : ", ") + say("{} is one of {}", fs::path(dir).filename().string(), other);
  }
  return found;
}

std::string which_session(const SessionOptions& options) {
  if (!options.session.empty()) {
    const Result<std::string> dir = session_dir(options.session, options.config);
    if (dir.ok()) return dir.value();
    // An invalid configuration is bad input; a bare name without a configuration is a usage error.
    std::error_code fault;
    const bool has_config = !options.config.empty() || fs::exists(default_config(), fault);
    stop(has_config ? kBadInput : kUsage, dir.error());
  }
  if (std::string last = last_session(); !last.empty() && other_line(last, options.config).empty()) return last;
  std::optional<config::Config> config;
  if (!config_if_any(options.config, config)) stop(kBadInput);
  std::string others;
  const std::vector<std::string> found =
      config ? sessions_of_line(config->sessions_dir, options.config, others) : std::vector<std::string>{};
  if (found.size() == 1) return found.front();
  if (found.empty() && !others.empty())
    stop(kBadInput,
         say("there is no calibration session of {} yet in {} ({}; --session NAME takes one all the same); {}",
             options.config, config->sessions_dir, others, how_to_begin()));
  if (found.empty())
    stop(kBadInput, say("there is no calibration session yet{}; {}",
                        config ? say(" in {}", config->sessions_dir) : std::string(), how_to_begin()));
  std::string names;
  for (const std::string& dir : found) names += (names.empty() ? "" : ", ") + fs::path(dir).filename().string();
  stop(kBadInput, say("there are several calibration sessions ({}); say which with --session NAME", names));
}

}  // namespace

void SessionOptions::add_to(args::Command& command) {
  command.add_option(
      "--session", session,
      "Name or folder (default: the one you worked on last, else the only one there is; with --config, of that line)");
  language.add_to(command, "Language of the text");
  command.add_option("--config", config, fmt::format("The daemon's configuration (default: {})", default_config()));
}

bool config_if_any(const std::string& path, std::optional<config::Config>& config) {
  const std::string file = path.empty() ? default_config() : path;
  std::error_code fault;
  if (path.empty() && !fs::exists(file, fault)) return true;
  config::Config read;
  if (!config_from(file, read)) return false;
  config = std::move(read);
  return true;
}

Result<std::string> session_dir(const std::string& name, const std::string& config_path) {
  if (name.find('/') != std::string::npos || name == "." || name == "..") return fs::absolute(name).string();
  std::optional<config::Config> config;
  if (!config_if_any(config_path, config))
    return said_error(Code::config,
                      say("the configuration says where sessions lie, and cannot be used; give a folder: ./{}", name));
  if (config) return config->sessions_dir + "/" + name;
  return said_error(
      Code::config,
      say("'{}' is a bare name, and without a configuration ({}, or --config FILE) there is no place for it; "
          "give a folder: ./{}",
          name, default_config(), name));
}

Session find_session(const SessionOptions& options) {
  Session session = need(Session::open(which_session(options)), kBadInput);
  remember_session(session.dir());
  return session;
}

void remember_session(const std::string& dir) {
  const std::string path = note_path();
  if (path.empty() || last_session() == dir) return;
  std::error_code fault;
  fs::create_directories(fs::path(path).parent_path(), fault);
  // A failure to store the note is ignored.
  if (!fault) static_cast<void>(write_durably(path, dir + "\n"));
}

}  // namespace slabd::cli
