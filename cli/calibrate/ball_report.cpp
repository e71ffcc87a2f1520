// SPDX-License-Identifier: Apache-2.0
//
// What was found in a scan, for people and as JSON. A gate is shown with its figure and its limit whether it passed or
// not: the next view is better when one sees how near the limit this one was.
#include <fmt/core.h>
#include <cmath>

#include "cli/calibrate/find_ball.h"
#include "cli/terminal/render.h"

namespace slabd::cli {
namespace {

using calib::ArtefactReport;
using calib::BallRefusal;
using calib::BallReport;
using calib::BallSettings;

Vec3 sigmas(const Mat3& covariance) {
  return covariance.diagonal().cwiseMax(0.0).cwiseSqrt();
}

void write_words(Json& json, const calib::BallWords& words) {
  json.field("reason", words.reason).field("cure", words.cure);
}

void write_ball(Json& json, const BallReport& b) {
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
  return fmt::format("  refused: {}\n  cure: {}\n", words.reason.view(), words.cure.view());
}

}  // namespace

std::string ball_text(const BallReport& b, const BallSettings& s) {
  const Vec3& c = b.centre_mm;
  const Vec3 sigma = sigmas(b.cov_mm2());
  std::string text =
      fmt::format("  centre ({:.4f}, {:.4f}, {:.4f}) mm in the scanner frame, sigma ({:.4f}, {:.4f}, {:.4f}) mm\n",
                  c.x(), c.y(), c.z(), sigma.x(), sigma.y(), sigma.z());
  if (b.correlated_mm > 0.0)
    text += fmt::format("  neighbouring points have {:.3f} mm in common over {:.1f} mm: that makes most of the sigma\n",
                        b.correlated_mm, b.correlation_length_mm);
  const double radius_shift = b.shift_per_radius.norm();
  text += fmt::format("  a radius certified too large by 0.01 mm would move it {:.3f} mm away from the scanner\n",
                      0.01 * radius_shift);
  Table gates{"  gate", "measured", "limit", "passed"};
  const auto add = [&](const char* what, const Cell& measured, const std::string& limit, BallRefusal gate) {
    gates.add(what, measured, limit,
              std::find(b.failed.begin(), b.failed.end(), gate) != b.failed.end() ? "no" : "yes");
  };
  add("  half angle of the cap, deg", figure(deg_from_rad(b.half_angle_rad), 1),
      fmt::format(">= {:.0f}", deg_from_rad(s.half_angle_min_rad)), BallRefusal::small_cap);
  add("  seen around, deg", figure(deg_from_rad(b.azimuth_rad), 0),
      fmt::format(">= {:.0f}", deg_from_rad(s.azimuth_min_rad)), BallRefusal::azimuth);
  add("  points", b.points_used, fmt::format(">= {}", s.points_min), BallRefusal::few_points);
  add("  free radius, mm", fmt::format("{} +- {}", figure(b.radius_free_mm, 4), figure(b.radius_free_sigma_mm, 4)),
      fmt::format("{:.4f} +- {:.3f}", s.radius_mm, s.radius_off_mm), BallRefusal::radius);
  add("  share of points on the sphere", figure(b.kept_share, 3), fmt::format(">= {:.2f}", s.kept_share_min),
      BallRefusal::spoiled);
  add("  scatter, mm", figure(b.rms_mm, 4), fmt::format("< {:.4f}", s.rms_max * s.noise_mm), BallRefusal::noisy);
  text += text_of(gates);
  if (!b.ok()) text += words_text(b.words);
  return text;
}

std::string ball_view_text(const calib::BallView& view, const BallSettings& settings) {
  std::string text = fmt::format("  {} points, {} finite; {} {} of about radius {:.3f} mm\n", view.points, view.finite,
                                 view.balls.size(), view.balls.size() == 1 ? "sphere" : "spheres", settings.radius_mm);
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
  text = fmt::format("  artefact {}, certificate of {}\n", certificate.id.view(), certificate.date.view());
  text += fmt::format("  T_scanner_target x y z {:.4f} {:.4f} {:.4f} mm, qw qx qy qz {:.7f} {:.7f} {:.7f} {:.7f}\n",
                      pose[0], pose[1], pose[2], pose[3], pose[4], pose[5], pose[6]);
  text += fmt::format("  sigma {:.4f} mm per axis at its origin, {:.5f} deg\n", r.target.sigma_mm(),
                      deg_from_rad(r.target.sigma_rad()));
  Table table{"  ball", "points", "off its place, mm", "x", "y", "z"};
  for (std::size_t k = 0; k < r.residuals_mm.size(); ++k) {
    const Vec3& off = r.residuals_mm[k];
    const auto which = static_cast<std::size_t>(r.assigned[k]);
    const std::string points = which < r.view.balls.size() ? std::to_string(r.view.balls[which].points_used) : "-";
    table.add(fmt::format("  {}", k + 1), points, Cell(off.norm(), 4), fmt::format("{:+.4f}", off.x()),
              fmt::format("{:+.4f}", off.y()), fmt::format("{:+.4f}", off.z()));
  }
  text += text_of(table);
  text += fmt::format("  scale {:+.0f} +- {:.0f} ppm (a diagnosis; never applied)\n", r.scale_ppm, r.scale_sigma_ppm);
  if (!r.ok()) text += words_text(r.words);
  return text;
}

void write_ball_view(Json& json, const calib::BallView& view) {
  json.field("status", view.ok() ? "ok" : "refused").field("refusal", view.refusal);
  write_words(json, view.words);
  json.field("points", view.points).field("finite", view.finite).key("balls").begin_array();
  for (const BallReport& ball : view.balls) write_ball(json, ball);
  json.end_array();
}

void write_artefact(Json& json, const ArtefactReport& r) {
  json.field("status", r.ok() ? "ok" : "refused").field("refusal", r.refusal);
  write_words(json, r.words);
  const bool located = !r.residuals_mm.empty();
  json.field("T_scanner_target", only_if(located, r.target.T_scanner_target));
  json.field("covariance", only_if(located, r.target.covariance));
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
