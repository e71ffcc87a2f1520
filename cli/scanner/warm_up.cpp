// SPDX-License-Identifier: Apache-2.0
//
// slabctl scanner warm-up: views of the monitor ball until the scanner has warmed up (calib/warm_up.h), from the
// running line or from files.
#include <fmt/core.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
#include <thread>
#include <vector>

#include "calib/calib.h"
#include "cli/calibrate/monitor_ball.h"
#include "cli/client/calibration_change.h"
#include "cli/client/record_options.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/say.h"
#include "report/json.h"

namespace slabd::cli {
namespace {

using Clock = std::chrono::steady_clock;

/// Views in succession that may show no ball, for example because a crane passes, before the command gives up.
constexpr int kMissedMax = 5;
/// The lease of the line is renewed this often between two views.
constexpr double kKeep_s = 10.0;

struct Options {
  std::vector<std::string> files;
  std::string times;
  std::string config;
  ScannerChoice scanner;
  BallMeasurement look;
  LanguageOption language;
  bool as_json = false;
};

struct Seen {
  MeasuredBall ball;
  calib::WarmUpView view;
};

/// The monitor ball in force, if there is one.
struct Reference {
  std::string id;
  std::string observations;
  std::int64_t expires_utime_us = 0;  ///< 0 if it never expires
  MonitorBall ball;
};

struct Run {
  const Options& options;
  const config::Config& config;
  InForce hand_eye;
  std::optional<Reference> reference;
  BallMeasurement look;
  std::vector<Seen> seen;
  calib::WarmUpReport report;
  std::optional<CalibrationCheck> check;  ///< stored at the end
};

/// Ascending times in seconds, one for each file.
std::vector<double> times_of(const Options& options) {
  std::vector<double> times;
  const char* at = options.times.data();
  const char* const end = at + options.times.size();
  while (at != end) {
    double time_s = kNoValue;
    const auto [rest, failed] = std::from_chars(at, end, time_s);
    if (failed != std::errc{} || !std::isfinite(time_s) || (rest != end && *rest != ',') ||
        (!times.empty() && time_s <= times.back())) {
      times.clear();
      break;
    }
    times.push_back(time_s);
    at = rest == end ? end : rest + 1;
  }
  if (times.size() != options.files.size())
    stop(kUsage,
         say("--times \"{}\": allowed are {} ascending numbers of seconds, separated by commas, one for each scan",
             options.times, options.files.size()));
  return times;
}

std::string missing_words(const calib::WarmUpReport& report, const config::Config& config) {
  switch (report.state) {
    case calib::WarmUpState::few_views: return say("needs {} views at least", config.warm_up.views_min);
    case calib::WarmUpState::short_time:
      return say("needs views over {:.1f} min, they span {:.1f} min", config.warm_up.window_s / 60.0,
                 report.window_s / 60.0);
    case calib::WarmUpState::drifting: return say("still drifting");
    case calib::WarmUpState::uncertain: return say("needs more views: the slopes are not certain enough");
    case calib::WarmUpState::stable: return say("stable");
  }
  return "";
}

std::string slopes_text(const calib::WarmUpReport& report) {
  if (!has_value(report.centre_speed_um_per_h)) return "";
  return say("; centre {:.1f} +- {:.1f} um/h, radius {:+.1f} +- {:.1f} um/h over {:.1f} min",
             report.centre_speed_um_per_h, report.factor * report.centre_sigma_um_per_h, report.radius_um_per_h,
             report.factor * report.radius_sigma_um_per_h, report.window_s / 60.0);
}

/// Prints the line of the newest view: to stderr beside a document.
void print_view(const Run& run) {
  const Seen& newest = run.seen.back();
  const Vec3 origin_mm = run.reference ? run.reference->ball.p_base : run.seen.front().view.centre_mm;
  const std::string temperature = has_value(newest.ball.scanner_temperature_c)
                                      ? say(", {:.1f} deg C", newest.ball.scanner_temperature_c)
                                      : std::string();
  std::FILE* out = run.options.as_json ? stderr : stdout;
  fmt::print(out, "{}\n",
             say("{:6.1f} min{}: ball {:.4f} mm off, radius {:.4f} mm{}: {}", newest.view.time_s / 60.0, temperature,
                 (newest.view.centre_mm - origin_mm).norm(), newest.view.radius_mm, slopes_text(run.report),
                 missing_words(run.report, run.config)));
  std::fflush(out);
}

/// Adds a view and examines all. True if the scanner is stable.
bool add(Run& run, const MeasuredBall& ball, double time_s) {
  run.seen.push_back({ball, {time_s, ball.p_base_mm, ball.radius_free_mm}});
  std::vector<calib::WarmUpView> views;
  views.reserve(run.seen.size());
  for (const Seen& one : run.seen) views.push_back(one.view);
  run.report = need(calib::examine_warm_up(views, run.config.warm_up));
  print_view(run);
  return run.report.state == calib::WarmUpState::stable;
}

bool watch_files(Run& run) {
  const std::vector<double> times = times_of(run.options);
  bool stable = false;
  for (std::size_t i = 0; i < times.size(); ++i) {
    BallMeasurement look = run.look;
    look.scan = run.options.files[i];
    // All files are examined: a scanner that was stable in between may drift again.
    stable = add(run, look_at_ball(run.config, look, run.hand_eye.T_flange_scanner), times[i]);
  }
  return stable;
}

void need_same_pose(const Run& run, const MeasuredBall& seen) {
  if (run.seen.empty()) return;
  const Pose& first = run.seen.front().ball.T_base_flange;
  const double off_mm = (seen.T_base_flange.translation_mm - first.translation_mm).norm();
  if (off_mm > run.config.splice.gate_mm ||
      angle_between_rad(seen.T_base_flange.rotation, first.rotation) > run.config.splice.gate_rad)
    stop(kRefused,
         say("the robot moved by {:.1f} mm between two views; the warm-up needs one pose: begin again", off_mm));
}

bool watch_line(Run& run) {
  LiveBall line(run.config, run.look);
  const auto begin = Clock::now();
  const auto elapsed_s = [&begin] { return std::chrono::duration<double>(Clock::now() - begin).count(); };
  int missed = 0;
  for (double next_s = 0.0;; next_s = std::max(next_s + run.config.warm_up_every_s, elapsed_s())) {
    while (elapsed_s() < next_s) {
      std::this_thread::sleep_for(std::chrono::duration<double>(std::min(kKeep_s, next_s - elapsed_s())));
      line.keep();
    }
    MeasuredBall seen;
    if (const std::optional<Stop> unseen = line.shoot(run.hand_eye.T_flange_scanner, seen)) {
      complain(unseen->sentence);
      if (++missed == kMissedMax) stop(unseen->status);
    } else {
      missed = 0;
      need_same_pose(run, seen);
      if (add(run, seen, elapsed_s())) return true;
    }
    if (elapsed_s() > 60.0 * run.config.warm_up_give_up_min) return false;
  }
}

/// Stores the last view of a stable scanner as a check of the monitor ball, as `slabctl calibrate check` does. Views of
/// a scanner that drifts are not stored, because a failed check stops the line.
void keep_check(Run& run) {
  if (!run.reference) {
    complain(say("no monitor ball is in force, so no check is stored: slabctl calibrate reference"));
    return;
  }
  if (const std::int64_t end = run.reference->expires_utime_us; end != 0 && wall_clock_us() >= end) {
    complain(say("no check is stored: {}", say("{} has expired", run.reference->id)));
    return;
  }
  if (const double taken_mm = run.reference->ball.radius_mm; std::abs(run.look.radius_mm - taken_mm) > kSameRadius_mm) {
    complain(say("no check is stored: {}", say("--radius {:g}: {} was taken into use with {:g} mm", run.look.radius_mm,
                                               run.reference->id, taken_mm)));
    return;
  }
  const MeasuredBall& seen = run.seen.back().ball;
  if (const std::string where = seen_elsewhere(run.config, run.reference->observations, seen); !where.empty()) {
    complain(say("no check is stored: {}", where));
    return;
  }
  CalibrationCheck check = calib::check_ball(run.reference->ball, seen.p_base_mm);
  FixedString<160> note;
  note.printf("after a warm-up of %.0f min, %zu views%s%s", run.seen.back().view.time_s / 60.0, run.seen.size(),
              check.note.empty() ? "" : "; ", check.note.c_str());
  check.note = note;
  check.reference_id.assign(run.reference->id);
  check.hand_eye_id = run.hand_eye.id;
  check.utime_us = wall_clock_us();
  check.who.assign(run.look.who.empty() ? default_operator() : run.look.who);
  check.source.assign(seen.source);
  static_cast<void>(need(change_calibration(run.config, storage::KeepCheck{check})));
  run.check = check;
}

void print_document(const Run& run) {
  const calib::WarmUpReport& r = run.report;
  report::Json json("slabd.scanner_warm_up/1");
  json.field("state", r.state).field("stable", r.state == calib::WarmUpState::stable);
  json.field("views_used", r.views).field("window_s", r.window_s).field("factor", r.factor);
  json.field("centre_um_per_h", r.centre_speed_um_per_h).field("centre_sigma_um_per_h", r.centre_sigma_um_per_h);
  json.field("centre_axes_um_per_h", r.centre_um_per_h).field("radius_um_per_h", r.radius_um_per_h);
  json.field("radius_sigma_um_per_h", r.radius_sigma_um_per_h);
  json.field("limit_centre_um_per_h", run.config.warm_up.centre_um_per_h);
  json.field("limit_radius_um_per_h", run.config.warm_up.radius_um_per_h);
  json.key("views").begin_array();
  for (const Seen& one : run.seen) {
    json.begin_object().field("time_s", one.view.time_s).field("source", one.ball.source);
    json.field("temperature_c", one.ball.scanner_temperature_c).field("centre_mm", one.view.centre_mm);
    json.field("radius_mm", one.view.radius_mm).end_object();
  }
  json.end_array().key("check");
  if (!run.check) {
    json.null();
  } else {
    json.begin_object().field("reference_id", run.check->reference_id).field("passed", run.check->passed);
    json.field("off_mm", run.check->off_mm).field("note", run.check->note).end_object();
  }
  fmt::print("{}", json.text());
}

int warm_up(const Options& options) {
  set_language(options.language, options.as_json);
  if (options.look.live == !options.files.empty())
    stop(kUsage, say("give either scans with --times and --flange, or --live"));
  const config::Config config = options.scanner.of(config_from(options.config));
  finish_killed_change(config);
  Run run{options, config, {}, {}, options.look, {}, {}, {}};
  {
    const std::unique_ptr<storage::Reader> reader = open_records(config);
    run.hand_eye = hand_eye_in_force(reader.get(), config);
    if (run.hand_eye.id.empty())
      stop(kRefused, say("no calibration is in force, and the configuration has no commissioning values"));
    if (reader != nullptr)
      if (const auto record = need(reader->current(CalibrationKind::monitor_ball, 0, config.by.scanner.view())))
        run.reference = Reference{record->id, record->observations, record->expires_utime_us,
                                  std::get<MonitorBall>(record->numbers)};
  }
  if (!has_value(run.look.radius_mm) && run.reference) run.look.radius_mm = run.reference->ball.radius_mm;
  if (!has_value(run.look.radius_mm))
    stop(kUsage, say("--radius: the ball's certified radius (effective, as coated) is missing"));
  const bool stable = options.look.live ? watch_line(run) : watch_files(run);
  if (stable && options.look.live) keep_check(run);
  if (options.as_json) print_document(run);
  if (run.check && !run.check->passed)
    complain(
        say("the scanner is stable, but the ball is not where it was: {}; slabs are refused (fault 503) until a "
            "check passes",
            quote(run.check->note.view())));
  if (!stable) complain(say("not stable: {}", missing_words(run.report, config)));
  return stable && (!run.check || run.check->passed) ? kDone : kRefused;
}

}  // namespace

void add_scanner_warm_up(args::Command& scanner) {
  auto options = std::make_shared<Options>();
  args::Command command =
      scanner.add_subcommand("warm-up", "Views of the monitor ball until the scanner no longer drifts");
  command->footer(
      "\nStable: the slopes of the ball's centre and radius, with their uncertainty, are below the limits of\n"
      "[scanner.warm_up], over enough views and time. With --live the line is held until then; a stable scanner's "
      "last\n"
      "view is stored as a check of the monitor ball.\n"
      "Exit status: 0 stable, 6 not stable or the check failed.\n\n"
      "Examples: slabctl scanner warm-up --live\n"
      "          slabctl scanner warm-up v1.ply v2.ply v3.ply v4.ply --times 0,60,120,180 \\\n"
      "            --flange \"1500 200 900 0 1 0 0\" --radius 19.05");
  command->add_option("SCANS", options->files, "Scans of the ball, all from one pose, in the order of their times");
  command->add_option("--times", options->times, "Seconds from any origin, one for each scan: 0,60,120");
  command->add_option("--config", options->config, "The daemon's configuration")->default_val(default_config());
  options->scanner.add_to(*command);
  options->look.add_to(*command);
  command->add_option("--operator", options->look.who, "Name of the operator (default: your login)");
  options->language.add_to(*command, "Language of the text");
  command->add_flag("--json", options->as_json, "Print slabd.scanner_warm_up/1 on stdout");
  command->runs([options] { return warm_up(*options); });
}

}  // namespace slabd::cli
