// SPDX-License-Identifier: Apache-2.0
//
// slabctl calibrate ball: is the ball seen well enough in these scans, and where is it? Offline, before and after a
// session, and to make the target table that `calibrate solve` reads.
#include <fmt/core.h>
#include <memory>

#include "base/durable.h"
#include "cli/calibrate/calibrate.h"
#include "cli/calibrate/find_ball.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/progress.h"
#include "hal/hal.h"

namespace slabd::cli {
namespace {

struct Options {
  std::vector<std::string> scans;
  BallOptions ball;
  double radius_mm = kNoValue;
  double radius_sigma_mm = 0.003;
  int count = 1;
  bool shots = false;
  std::string target;
  bool json = false;

  [[nodiscard]] calib::BallSettings settings() const {
    calib::BallSettings s = ball.settings();
    s.radius_mm = radius_mm;
    s.radius_sigma_mm = radius_sigma_mm;
    s.count = count;
    return s;
  }
};

std::string shots_text(const calib::BallShots& shots) {
  if (!shots.ok())
    return fmt::format("shots together\n  refused: {}\n  cure: {}\n", shots.words.reason.view(),
                       shots.words.cure.view());
  const Vec3& c = shots.centre_mm;
  const Vec3 sigma = shots.cov_mm2.diagonal().cwiseMax(0.0).cwiseSqrt();
  return fmt::format(
      "shots together\n  centre ({:.4f}, {:.4f}, {:.4f}) mm, sigma ({:.4f}, {:.4f}, {:.4f}) mm\n  {} shots scatter by "
      "{} mm per axis\n",
      c.x(), c.y(), c.z(), sigma.x(), sigma.y(), sigma.z(), shots.shots,
      has_value(shots.repeat_mm) ? fmt::format("{:.4f}", shots.repeat_mm) : "-");
}

void write_shots(Json& json, const calib::BallShots& shots) {
  const Vec3 sigma = shots.cov_mm2.diagonal().cwiseMax(0.0).cwiseSqrt();
  json.key("shots").begin_object().field("status", shots.ok() ? "ok" : "refused").field("refusal", shots.refusal);
  json.field("reason", shots.words.reason).field("cure", shots.words.cure).field("count", shots.shots);
  json.field("centre_mm", shots.centre_mm).field("sigma_mm", sigma).field("repeat_mm", shots.repeat_mm);
  json.field("worst_shot", shots.worst_shot).end_object();
}

/// Sightings of the accepted views, with the labels that let refused ones be missing.
void write_target(const Options& options, const std::vector<calib::BallView>& views) {
  std::vector<Pose> poses;
  std::vector<std::size_t> view_labels;
  std::vector<std::size_t> ball_labels;
  for (std::size_t v = 0; v < views.size(); ++v) {
    if (!views[v].ok()) continue;
    poses.push_back({Quat::Identity(), views[v].balls[0].centre_mm});
    view_labels.push_back(v);
    ball_labels.push_back(0);
  }
  if (poses.empty()) stop(kRefused, fmt::format("{} is not written: no view was accepted", options.target));
  calib::PoseFormat format;
  format.rotation = calib::RotationForm::none;
  format.labelled = true;
  format.declared = true;
  OutFile file(options.target, {.synced = true});
  file.write(calib::write_poses(poses, format, calib::TableRole::target, view_labels, ball_labels));
  need(file.close(Code::journal_write), kNotReachable);
}

/// What the free radius of all views says about the certified one; a warning is not a refusal.
void tell_radius(const Options& options, const std::vector<calib::BallView>& views, Json& json) {
  std::vector<calib::BallReport> balls;
  for (const calib::BallView& view : views)
    if (view.ok()) balls.push_back(view.balls[0]);
  const calib::RadiusCheck check = calib::check_radius(balls, options.settings());
  json.key("radius_free").begin_object().field("views", check.views).field("mean_mm", check.mean_mm);
  json.field("sigma_mm", check.sigma_mm).field("shift_mm", check.shift_mm).field("suspicious", check.suspicious);
  json.end_object();
  if (!options.json && has_value(check.mean_mm))
    fmt::print("free radius over {} scans: {:.4f} +- {:.4f} mm, certified {:.4f}\n", check.views, check.mean_mm,
               2.0 * check.sigma_mm, options.radius_mm);
  if (check.suspicious)
    complain(fmt::format("warning: {}\n  cure: {}", check.words.reason.view(), check.words.cure.view()));
}

int run_ball(const Options& options) {
  const calib::BallSettings settings = options.settings();
  std::vector<calib::BallView> views;
  Json json("slabd.balls/1");
  json.field("radius_mm", options.radius_mm).field("count", options.count).key("views").begin_array();
  std::size_t accepted = 0;
  each_scan(options.scans, options.ball.unit, [&](const std::string& path, std::span<const float> xyz) {
    const Result<calib::BallView> view = calib::find_balls(xyz, settings);
    if (!view) return Status(view.error());
    views.push_back(view.value());
    accepted += view.value().ok() ? 1U : 0U;
    json.begin_object().field("file", path);
    write_ball_view(json, view.value());
    json.end_object();
    if (!options.json)
      fmt::print("{}{}\n{}", path, view.value().ok() ? ": accepted" : ": refused",
                 ball_view_text(view.value(), settings));
    return success();
  });
  json.end_array();
  bool good = accepted == views.size();
  if (options.count == 1) tell_radius(options, views, json);
  if (options.shots) {
    std::vector<calib::BallReport> reports;
    for (const calib::BallView& view : views) reports.push_back(as_shot(view));
    const calib::BallShots shots = calib::average_shots(reports, settings);
    good = good && shots.ok();
    write_shots(json, shots);
    if (!options.json) fmt::print("{}", shots_text(shots));
  }
  json.field("accepted", accepted).field("status", good ? "ok" : "refused");
  if (options.json)
    fmt::print("{}", json.text());
  else if (views.size() > 1)
    fmt::print("{} of {} scans accepted\n", accepted, views.size());
  if (!options.target.empty()) {
    write_target(options, views);
    if (!options.json) fmt::print("{}: {} sightings, numbered by scan\n", options.target, accepted);
  }
  return good ? kDone : kRefused;
}

}  // namespace

void BallOptions::add_to(args::Command& command) {
  command
      .add_option("--scanner-noise-mm", noise_mm,
                  "Standard deviation of the scanner's points; 1.5 times that is the limit")
      ->check(within(0.001, 1.0))
      ->capture_default_str();
  command
      .add_option("--noise-correlation-mm", noise_correlation_mm,
                  "Take the noise to hang together over at least this length; 0 = as each scan shows")
      ->check(within(0.0, 20.0))
      ->capture_default_str();
  command.add_flag("--parallel", parallel, "The scan's rays are parallel to Z instead of through the origin");
  command.add_option("--unit", unit, "Unit of the scans: mm, m or um")
      ->check(args::one_of({"mm", "m", "um"}))
      ->capture_default_str();
}

calib::BallSettings BallOptions::settings() const {
  calib::BallSettings s;
  s.noise_mm = noise_mm;
  s.noise_correlation_mm = noise_correlation_mm;
  if (parallel) s.viewpoint_mm = Vec3(0.0, 0.0, -1e9);
  return s;
}

Result<std::vector<float>> scan_points(const std::string& path, const std::string& unit) {
  std::vector<float> xyz(3 * limits::kScanPointsMax);
  const Result<ScanShape> shape = hal::read_scan(path.c_str(), *length_unit(unit), std::span<float>(xyz));
  if (!shape) return shape.error();
  xyz.resize(3 * shape.value().points);
  return xyz;
}

calib::BallReport as_shot(const calib::BallView& view) {
  calib::BallReport report = view.balls.empty() ? calib::BallReport{} : view.balls[0];
  report.refusal = view.refusal;
  report.words = view.words;
  return report;
}

void each_scan(const std::vector<std::string>& paths, const std::string& unit,
               const std::function<Status(const std::string&, std::span<const float>)>& use) {
  ProgressCount progress(stderr, paths.size());
  for (const std::string& path : paths) {
    progress.next(path);
    const std::vector<float> xyz = need(scan_points(path, unit), kBadInput);
    if (const Status used = use(path, xyz); !used) stop(kUsage, fmt::format("{}: {}", path, used.error().text.view()));
  }
}

void add_calibrate_ball(args::Command& group) {
  auto options = std::make_shared<Options>();
  args::Command command = group.add_subcommand("ball", "Find tooling balls in scans: centre, every gate, why refused");
  command->footer(
      "\nThe radius is the certified, effective one of the ball as coated (the radius, not the diameter).\n"
      "Example: slabctl calibrate ball view_*.ply --radius 25.4 --target target.txt\n"
      "Exit status: 0 every scan accepted, 6 one refused, 2 usage, 3 bad input.");
  command->add_option("SCAN", options->scans, "Scans of the ball, one a view, in the order of the flange poses")
      ->required();
  command->add_option("--radius", options->radius_mm, "Certified radius in mm")->required()->check(within(1.0, 200.0));
  command->add_option("--radius-sigma-mm", options->radius_sigma_mm, "Its standard uncertainty (k = 1)")
      ->check(within(0.0, 1.0))
      ->capture_default_str();
  args::Option count = command->add_option("--count", options->count, "Balls of this radius in every scan")
                           ->check(args::range(1, 16))
                           ->capture_default_str();
  args::Option shots =
      command->add_flag("--shots", options->shots, "The scans are shots of one pose: average them if they agree")
          ->excludes(count);
  command
      ->add_option("--target", options->target,
                   "Write the centres of the accepted scans as a target table for `calibrate solve --kind ball`")
      ->excludes(count)
      ->excludes(shots);
  options->ball.add_to(*command);
  command->add_flag("--json", options->json, "Print slabd.balls/1 on stdout");
  command->runs([options] { return run_ball(*options); });
}

}  // namespace slabd::cli
