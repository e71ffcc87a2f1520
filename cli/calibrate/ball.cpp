// SPDX-License-Identifier: Apache-2.0
//
// slabctl calibrate ball: checks the ball's visibility in scans and measures its position. Used offline before and
// after a session, and to make the target table for `calibrate solve`.
#include <fmt/core.h>

#include <charconv>
#include <cmath>
#include <filesystem>
#include <memory>
#include <numeric>
#include <set>

#include "base/durable.h"
#include "cli/calibrate/calibrate.h"
#include "cli/calibrate/find_ball.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/progress.h"
#include "cli/terminal/render.h"
#include "cli/terminal/say.h"
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
  LanguageOption language;
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
    return say("shots together\n  refused: {}\n  cure: {}\n", quote(shots.words.reason.view()),
               quote(shots.words.cure.view()));
  const Vec3& c = shots.centre_mm;
  const Vec3 sigma = shots.cov_mm2.diagonal().cwiseMax(0.0).cwiseSqrt();
  return say(
      "shots together\n  centre ({:.4f}, {:.4f}, {:.4f}) mm, sigma ({:.4f}, {:.4f}, {:.4f}) mm\n  {} shots scatter by "
      "{} mm per axis\n",
      c.x(), c.y(), c.z(), sigma.x(), sigma.y(), sigma.z(), shots.shots,
      has_value(shots.repeat_mm) ? fmt::format("{:.4f}", shots.repeat_mm) : "-");
}

void write_shots(report::Json& json, const calib::BallShots& shots) {
  const Vec3 sigma = shots.cov_mm2.diagonal().cwiseMax(0.0).cwiseSqrt();
  json.key("shots").begin_object().field("status", shots.ok() ? "ok" : "refused").field("refusal", shots.refusal);
  json.field("reason", shots.words.reason).field("cure", shots.words.cure).field("count", shots.shots);
  json.field("centre_mm", shots.centre_mm).field("sigma_mm", sigma).field("repeat_mm", shots.repeat_mm);
  json.field("worst_shot", shots.worst_shot).end_object();
}

/// View numbers from the names of the scans, from 0. The shell sorts view_10 before view_2, and a view may be missing.
/// If all names end with different numbers, these are used; otherwise the positions in the list.
std::vector<std::size_t> view_numbers(const std::vector<std::string>& scans) {
  constexpr unsigned kMost = 999;  // more is a date
  std::vector<std::size_t> places(scans.size());
  std::iota(places.begin(), places.end(), std::size_t{0});
  std::vector<std::size_t> numbers;
  for (const std::string& scan : scans) {
    const std::string stem = std::filesystem::path(scan).stem().string();
    const std::size_t digits = stem.size() - (stem.find_last_not_of("0123456789") + 1);
    unsigned number = 0;
    const auto [stop, fault] = std::from_chars(stem.data() + stem.size() - digits, stem.data() + stem.size(), number);
    if (digits == 0 || fault != std::errc{} || number > kMost) return places;
    numbers.push_back(number);
  }
  const std::set<std::size_t> different(numbers.begin(), numbers.end());
  if (different.size() != numbers.size()) return places;
  // Names count from 1, view numbers from 0.
  if (*different.begin() > 0)
    for (std::size_t& number : numbers) --number;
  return numbers;
}

/// Writes the sightings of the accepted views with labels, so that rejected ones can be missing.
void write_target(const Options& options, const std::vector<calib::BallView>& views) {
  const std::vector<std::size_t> numbers = view_numbers(options.scans);
  for (std::size_t v = 0; v < views.size(); ++v)
    if (numbers[v] != v) {
      complain(say("the views are numbered by the names of the scans, not by their order: {} is view {}",
                   options.scans[v], numbers[v] + 1));
      break;
    }
  std::vector<Pose> poses;
  std::vector<std::size_t> view_labels;
  std::vector<std::size_t> ball_labels;
  for (std::size_t v = 0; v < views.size(); ++v) {
    if (!views[v].ok()) continue;
    poses.push_back({Quat::Identity(), views[v].balls[0].centre_mm});
    view_labels.push_back(numbers[v]);
    ball_labels.push_back(0);
  }
  if (poses.empty()) stop(kRefused, say("{} is not written: no view was accepted", options.target));
  calib::PoseFormat format;
  format.rotation = calib::RotationForm::none;
  format.labelled = true;
  format.declared = true;
  OutFile file(options.target, {.synced = true});
  file.write(calib::write_poses(poses, format, calib::TableRole::target, view_labels, ball_labels));
  need(file.close(Code::journal_write), kNotReachable);
}

/// Compares the free radius of all views with the certified one; prints a warning, which does not reject the views.
void tell_radius(const Options& options, const std::vector<calib::BallView>& views, report::Json& json) {
  std::vector<calib::BallReport> balls;
  for (const calib::BallView& view : views)
    if (view.ok()) balls.push_back(view.balls[0]);
  const calib::RadiusCheck check = calib::check_radius(balls, options.settings());
  json.key("radius_free").begin_object().field("views", check.views).field("mean_mm", check.mean_mm);
  json.field("sigma_mm", check.sigma_mm).field("shift_mm", check.shift_mm).field("suspicious", check.suspicious);
  json.end_object();
  if (!options.json && has_value(check.mean_mm))
    fmt::print("{}", say("free radius over {} scans: {:.4f} +- {:.4f} mm, certified {:.4f}\n", check.views,
                         check.mean_mm, 2.0 * check.sigma_mm, options.radius_mm));
  if (check.suspicious)
    complain(say("warning: {}\n  cure: {}", quote(check.words.reason.view()), quote(check.words.cure.view())));
}

int run_ball(const Options& options) {
  set_language(options.language, options.json);
  const calib::BallSettings settings = options.settings();
  std::vector<calib::BallView> views;
  report::Json json("slabd.balls/1");
  json.field("radius_mm", options.radius_mm).field("count", options.count).key("views").begin_array();
  std::size_t accepted = 0;
  each_scan(options.scans, options.ball.form.form(), [&](const std::string& path, std::span<const float> xyz) {
    const Result<calib::BallView> view = calib::find_balls(xyz, settings);
    if (!view) return Status(view.error());
    views.push_back(view.value());
    accepted += view.value().ok() ? 1U : 0U;
    json.begin_object().field("file", path);
    write_ball_view(json, view.value());
    json.end_object();
    if (!options.json)
      fmt::print("{}{}", view.value().ok() ? say("{}: accepted\n", path) : say("{}: refused\n", path),
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
    fmt::print("{}", say("{} of {} scans accepted\n", accepted, views.size()));
  if (!options.target.empty()) {
    write_target(options, views);
    if (!options.json) fmt::print("{}", say("{}: {} sightings, numbered by scan\n", options.target, accepted));
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
  form.add_to(command);
}

calib::BallSettings BallOptions::settings() const {
  calib::BallSettings s;
  s.noise_mm = noise_mm;
  s.noise_correlation_mm = noise_correlation_mm;
  if (parallel) s.viewpoint_mm = Vec3(0.0, 0.0, -1e9);
  return s;
}

Result<std::vector<float>> scan_points(const std::string& path, const hal::ScanForm& form) {
  std::vector<float> xyz(3 * limits::kScanPointsMax);
  const Result<ScanShape> shape = hal::read_scan(path.c_str(), form, std::span<float>(xyz));
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

void each_scan(const std::vector<std::string>& paths, const hal::ScanForm& form,
               const std::function<Status(const std::string&, std::span<const float>)>& use) {
  ProgressCount progress(stderr, paths.size());
  for (const std::string& path : paths) {
    progress.next(path);
    const std::vector<float> xyz = need(scan_points(path, form), kBadInput);
    if (const Status used = use(path, xyz); !used) stop(kUsage, say("{}: {}", path, retold(used.error().text.view())));
  }
}

void add_calibrate_ball(args::Command& group) {
  auto options = std::make_shared<Options>();
  args::Command command = group.add_subcommand("ball", "Find tooling balls in scans: centre, every gate, why refused");
  command->footer(
      "\nThe radius is the certified, effective one of the ball as coated (the radius, not the diameter).\n"
      "Example: slabctl calibrate ball view_*.ply --radius 25.4 --target target.txt\n"
      "Exit status: 0 every scan accepted, 6 one refused, 2 usage, 3 bad input.");
  command
      ->add_option("SCAN", options->scans,
                   "Scans of the ball, one a view; the number at the end of a name is the line of its flange pose, "
                   "without numbers their order")
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
  options->language.add_to(*command, "Language of the text");
  command->add_flag("--json", options->json, "Print slabd.balls/1 on stdout");
  command->runs([options] { return run_ball(*options); });
}

// Results of a scan, as text and JSON. A gate is shown with figure and limit even if it passed, so that the operator
// can see how close to the limit the view is.

namespace {

using calib::ArtefactReport;
using calib::BallRefusal;
using calib::BallReport;
using calib::BallSettings;

Vec3 sigmas(const Mat3& covariance) {
  return covariance.diagonal().cwiseMax(0.0).cwiseSqrt();
}

void write_words(report::Json& json, const calib::BallWords& words) {
  json.field("reason", words.reason).field("cure", words.cure);
}

void write_ball(report::Json& json, const BallReport& b) {
  json.begin_object().field("status", b.ok() ? "ok" : "refused").field("refusal", b.refusal).field("failed", b.failed);
  write_words(json, b.words);
  json.field("centre_mm", b.centre_mm);
  json.field("sigma_mm", sigmas(b.cov_mm2()));
  json.field("cov_white_mm2", b.cov_white_mm2);
  json.field("cov_correlated_mm2", b.cov_correlated_mm2);
  json.field("shift_per_radius", b.shift_per_radius);
  json.field("points_near", b.points_near).field("points_offered", b.points_offered);
  json.field("points_used", b.points_used).field("kept_share", b.kept_share);
  json.field("half_angle_deg", deg_from_rad(b.half_angle_rad)).field("azimuth_deg", deg_from_rad(b.azimuth_rad));
  json.field("rms_mm", b.rms_mm).field("radius_free_mm", b.radius_free_mm);
  json.field("radius_free_sigma_mm", b.radius_free_sigma_mm).field("correlated_mm", b.correlated_mm);
  json.field("correlation_length_mm", b.correlation_length_mm).field("iterations", b.iterations).end_object();
}

std::string words_text(const calib::BallWords& words) {
  return say("  refused: {}\n  cure: {}\n", quote(words.reason.view()), quote(words.cure.view()));
}

}  // namespace

std::string ball_text(const BallReport& b, const BallSettings& s) {
  const Vec3& c = b.centre_mm;
  const Vec3 sigma = sigmas(b.cov_mm2());
  std::string text =
      say("  centre ({:.4f}, {:.4f}, {:.4f}) mm in the scanner frame, sigma ({:.4f}, {:.4f}, {:.4f}) mm\n", c.x(),
          c.y(), c.z(), sigma.x(), sigma.y(), sigma.z());
  if (b.correlated_mm > 0.0)
    text += say("  neighbouring points have {:.3f} mm in common over {:.1f} mm: that makes most of the sigma\n",
                b.correlated_mm, b.correlation_length_mm);
  const double radius_shift = b.shift_per_radius.norm();
  text += say("  a radius certified too large by 0.01 mm would move it {:.3f} mm away from the scanner\n",
              0.01 * radius_shift);
  report::Table gates{say("  gate"), say("measured"), say("limit"), say("passed")};
  const auto add = [&](const std::string& what, const report::Cell& measured, const std::string& limit,
                       BallRefusal gate) {
    gates.add(what, measured, limit,
              std::find(b.failed.begin(), b.failed.end(), gate) != b.failed.end() ? say("no") : say("yes"));
  };
  add(say("  half angle of the cap, deg"), report::figure(deg_from_rad(b.half_angle_rad), 1),
      fmt::format(">= {:.0f}", deg_from_rad(s.half_angle_min_rad)), BallRefusal::small_cap);
  add(say("  seen around, deg"), report::figure(deg_from_rad(b.azimuth_rad), 0),
      fmt::format(">= {:.0f}", deg_from_rad(s.azimuth_min_rad)), BallRefusal::azimuth);
  add(say("  points"), b.points_used, fmt::format(">= {}", s.points_min), BallRefusal::few_points);
  add(say("  free radius, mm"),
      fmt::format("{} +- {}", report::figure(b.radius_free_mm, 4), report::figure(b.radius_free_sigma_mm, 4)),
      fmt::format("{:.4f} +- {:.3f}", s.radius_mm, s.radius_off_mm), BallRefusal::radius);
  add(say("  share of points on the sphere"), report::figure(b.kept_share, 3),
      fmt::format(">= {:.2f}", s.kept_share_min), BallRefusal::spoiled);
  add(say("  scatter, mm"), report::figure(b.rms_mm, 4), fmt::format("< {:.4f}", s.rms_max * s.noise_mm),
      BallRefusal::noisy);
  text += report::text_of(gates);
  if (!b.ok()) text += words_text(b.words);
  return text;
}

std::string ball_view_text(const calib::BallView& view, const BallSettings& settings) {
  std::string text =
      say("  {} points, {} finite; {} {} of about radius {:.3f} mm\n", view.points, view.finite, view.balls.size(),
          view.balls.size() == 1 ? say("sphere") : say("spheres"), settings.radius_mm);
  for (const BallReport& ball : view.balls) text += ball_text(ball, settings);
  const bool said = view.balls.size() == 1 && !view.ok() && view.refusal == view.balls[0].refusal;
  if (!view.ok() && !said) text += words_text(view.words);
  return text;
}

std::string artefact_text(const ArtefactReport& r, const calib::ArtefactCertificate& certificate,
                          const calib::ArtefactSettings& settings) {
  calib::BallSettings ball = settings.ball;
  ball.radius_mm = certificate.ball_radius_mm;
  ball.count = static_cast<int>(certificate.balls_mm.size());
  const bool located = r.ok() || r.refusal == calib::ArtefactRefusal::residual;
  std::string text;
  if (!located) {
    text = ball_view_text(r.view, ball);
    if (r.view.ok()) text += words_text(r.words);
    return text;
  }
  const std::array<double, 7> pose = r.target.T_scanner_target.to_array();
  text = say("  artefact {}, certificate of {}\n", certificate.id.view(), certificate.date.view());
  text += fmt::format("  T_scanner_target x y z {:.4f} {:.4f} {:.4f} mm, qw qx qy qz {:.7f} {:.7f} {:.7f} {:.7f}\n",
                      pose[0], pose[1], pose[2], pose[3], pose[4], pose[5], pose[6]);
  text += say("  sigma {:.4f} mm per axis at its origin, {:.5f} deg\n", r.target.sigma_mm(),
              deg_from_rad(r.target.sigma_rad()));
  report::Table table{say("  ball"), say("points"), say("off its place, mm"), "x", "y", "z"};
  for (std::size_t k = 0; k < r.residuals_mm.size(); ++k) {
    const Vec3& off = r.residuals_mm[k];
    const auto which = static_cast<std::size_t>(r.assigned[k]);
    const std::string points = which < r.view.balls.size() ? std::to_string(r.view.balls[which].points_used) : "-";
    table.add(fmt::format("  {}", k + 1), points, report::Cell(off.norm(), 4), fmt::format("{:+.4f}", off.x()),
              fmt::format("{:+.4f}", off.y()), fmt::format("{:+.4f}", off.z()));
  }
  text += report::text_of(table);
  text += say("  scale {:+.0f} +- {:.0f} ppm (a diagnosis; never applied)\n", r.scale_ppm, r.scale_sigma_ppm);
  if (!r.ok()) text += words_text(r.words);
  return text;
}

void write_ball_view(report::Json& json, const calib::BallView& view) {
  json.field("status", view.ok() ? "ok" : "refused").field("refusal", view.refusal);
  write_words(json, view.words);
  json.field("points", view.points).field("finite", view.finite).key("balls").begin_array();
  for (const BallReport& ball : view.balls) write_ball(json, ball);
  json.end_array();
}

void write_artefact(report::Json& json, const ArtefactReport& r) {
  json.field("status", r.ok() ? "ok" : "refused").field("refusal", r.refusal);
  write_words(json, r.words);
  const bool located = !r.residuals_mm.empty();
  json.field("T_scanner_target", report::only_if(located, r.target.T_scanner_target));
  json.field("covariance", report::only_if(located, r.target.covariance));
  json.field("sigma_mm", located ? r.target.sigma_mm() : kNoValue);
  json.field("sigma_deg", located ? deg_from_rad(r.target.sigma_rad()) : kNoValue);
  json.list("assigned", r.assigned, [&](const int which) { return which + 1; });
  json.field("residuals_mm", r.residuals_mm);
  json.field("residual_rms_mm", r.residual_rms_mm).field("residual_max_mm", r.residual_max_mm);
  json.field("worst_ball", r.worst_ball).field("distance_off_max_mm", r.distance_off_max_mm);
  json.field("scale_ppm", r.scale_ppm).field("scale_sigma_ppm", r.scale_sigma_ppm).key("view").begin_object();
  write_ball_view(json, r.view);
  json.end_object();
}

}  // namespace slabd::cli
