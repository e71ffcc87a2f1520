// SPDX-License-Identifier: Apache-2.0
//
// A hand-eye result as text and JSON. Every figure has its unit and meaning; a rejected result has the same figures
// and the cure.
#include <fmt/core.h>

#include <cmath>
#include <vector>

#include "base/fields.h"
#include "cli/calibrate/calibrate.h"
#include "cli/terminal/render.h"
#include "cli/terminal/say.h"

namespace slabd::calib {

SLABD_FIELDS(Reason, code, text, cure);
SLABD_FIELDS(Hypothesis, name, sigmas, residual_mm, residual_deg, angle_mismatch_deg, pitch_mismatch_mm);

template <typename V, RecordOf<ViewFit> R>
void fields(V& v, R& r) {
  v("view", r.number);
  SLABD_EACH(r, kept, residual_mm, residual_deg, leave_one_out_mm, leave_one_out_deg, sigmas)
}

}  // namespace slabd::calib

namespace slabd::cli {
namespace {

using calib::ArtefactKind;
using calib::HandEye;

std::string number(double v, int digits) {
  return has_value(v) ? fmt::format("{:.{}f}", v, digits) : "-";
}

std::string three(const calib::Spread& spread, int digits) {
  return fmt::format("{} / {} / {}", number(spread.median, digits), number(spread.rms, digits),
                     number(spread.max, digits));
}

std::string axes(const std::array<double, 3>& v, int digits) {
  return fmt::format("{} / {} / {}", number(v[0], digits), number(v[1], digits), number(v[2], digits));
}

std::string rejected_views(const HandEye& r) {
  std::string list;
  for (const std::size_t i : r.rejected) list += (list.empty() ? "" : ", ") + std::to_string(r.views[i].number);
  return list.empty() ? say("none") : list;
}

std::string sigmas_of_pose(const Mat6& covariance, bool rotation) {
  std::array<double, 3> sigma{};
  for (int k = 0; k < 3; ++k) {
    const int at = rotation ? k + 3 : k;
    const double s = std::sqrt(covariance(at, at));
    sigma[static_cast<std::size_t>(k)] = rotation ? deg_from_rad(s) : s;
  }
  return axes(sigma, rotation ? 4 : 3);
}

std::string figures(ArtefactKind kind, const HandEye& r) {
  const bool pose = kind == ArtefactKind::pose;
  report::Table table{say("figure"), say("value"), say("unit<"), say("meaning<")};
  const auto add = [&](const std::string& what, const std::string& value, const std::string& unit,
                       const std::string& meaning) { table.add(what, value, unit, meaning); };
  add(say("predicted point error"), number(r.predicted_point_sigma_mm, 3), "mm",
      say("3-D, 1 sigma, rms over the field of view, random part; limit {}", number(r.point_sigma_limit_mm, 3)));
  add(say("  expanded, k = 2"), number(2.0 * r.predicted_point_sigma_mm, 3), "mm", say("the same, 95 %"));
  add(say("leave-one-out"), three(r.leave_one_out_mm, 3), "mm",
      say("median / rms / max miss of a view that took no part in the fit"));
  if (pose) add("", three(r.leave_one_out_deg, 4), "deg", "");
  add(say("residuals"), three(r.residual_mm, 3), "mm",
      say("median / rms / max of the views kept; less meaningful than the two above"));
  if (pose) add("", three(r.residual_deg, 4), "deg", "");
  add("s0", number(r.s0, 2), "", say("residuals over stated noise: 1 when the noise is as stated, allowed 0.1 to 3"));
  if (pose)
    add(say("  position / rotation"), fmt::format("{} / {}", number(r.s0_position, 2), number(r.s0_rotation, 2)), "",
        (r.reweighted ? say("weighed by these") : say("weighed as stated")) +
            (r.robot_lever ? "" : say("; the robot errs smoothly: its turns do not move positions")));
  add(say("sigma of X, position"), sigmas_of_pose(r.covariance, false), "mm", say("along the flange's x / y / z"));
  add(say("sigma of X, rotation"), sigmas_of_pose(r.covariance, true), "deg", say("about the scanner's x / y / z"));
  add(say("condition"), fmt::format("{:.3g}", r.condition), "", say("of the adjustment: healthy 8 to 22, at most 50"));
  add(say("rotation spread"), axes(r.rotation_spread_axes_deg, 1), "deg",
      say("principal values; the second must reach 5, better all 15"));
  if (!pose)
    add(say("ball spread in view"), axes(r.ball_spread_axes_mm, 0), "mm",
        say("principal standard deviations; two must reach 25"));
  add(say("scale (lambda)"), fmt::format("{} +- {}", number(r.scale, 5), number(r.scale_sigma, 5)), "",
      say("1 sigma; by it the scanner's lengths would agree with the robot's; a diagnosis, never applied"));
  add(say("rejected views"), rejected_views(r), "", say("do not fit the others, left out of everything above"));
  if (!r.views.empty())
    add(say("worst view kept"), fmt::format("{}", r.views[r.worst_view].number), "",
        say("{} mm, as rare as {} sigma", number(r.views[r.worst_view].residual_mm, 3),
            number(r.views[r.worst_view].sigmas, 1)));
  return report::text_of(table);
}

void write_target(report::Json& json, ArtefactKind kind, const HandEye& r) {
  json.key("target");
  if (!r.determined) {
    json.null();
  } else if (kind == ArtefactKind::pose) {
    json.value(r.targets[0].to_array());
  } else if (r.targets.size() == 1) {
    json.value(r.targets[0].translation_mm);
  } else {
    json.begin_array();
    for (const Pose& ball : r.targets) json.value(ball.translation_mm);
    json.end_array();
  }
}

void write_conventions(report::Json& json, const calib::ConventionReport& report) {
  json.key("conventions");
  if (report.tried.empty()) {
    json.null();
    return;
  }
  json.begin_object().field("stated_fits", report.stated_fits);
  json.field("fits", report::only_if(report.fits != 0, report.tried[report.fits].name)).field("tried", report.tried);
  json.end_object();
}

}  // namespace

std::string pose_in_three_forms(const Pose& pose) {
  const Mat4 m = pose.matrix();
  std::string text;
  for (int row = 0; row < 4; ++row)
    text += fmt::format("  {} {:12.8f} {:12.8f} {:12.8f} {:12.4f}\n", row == 0 ? "4 x 4     " : "          ", m(row, 0),
                        m(row, 1), m(row, 2), m(row, 3));
  const std::array<double, 7> q = pose.to_array();
  text += say("  quaternion") +
          fmt::format("  {:.4f} {:.4f} {:.4f}  {:.9f} {:.9f} {:.9f} {:.9f}    x y z qw qx qy qz, mm\n", q[0], q[1],
                      q[2], q[3], q[4], q[5], q[6]);
  const KukaAbc abc = kuka_abc_from_rotation(pose.rotation);
  text += fmt::format("  KUKA        X {:.4f}, Y {:.4f}, Z {:.4f}, A {:.6f}, B {:.6f}, C {:.6f}    mm, deg\n", q[0],
                      q[1], q[2], deg_from_rad(abc.a_rad), deg_from_rad(abc.b_rad), deg_from_rad(abc.c_rad));
  return text;
}

std::string hand_eye_text(ArtefactKind kind, const HandEye& r, const calib::StatedNoise& noise) {
  std::string text = say("{} of {} views of {}; stated noise: robot {:.4g} mm, {:.4g} deg, target {:.4g} mm",
                         r.views.size() - r.rejected.size(), r.views.size(),
                         kind == ArtefactKind::pose ? say("an artefact's pose")
                         : r.targets.size() == 1    ? say("a ball")
                                                    : say("{} balls", r.targets.size()),
                         noise.robot_mm, deg_from_rad(noise.robot_rad), noise.target_mm);
  if (kind == ArtefactKind::pose) text += fmt::format(", {:.4g} deg", deg_from_rad(noise.target_rad));
  text += say(" (per axis, 1 sigma)\n\n");
  if (r.determined)
    text += say("T_flange_scanner maps scanner coordinates to flange coordinates\n") +
            pose_in_three_forms(r.T_flange_scanner);
  else
    text += say("T_flange_scanner is not determined by these views\n");
  text += "\n" + figures(kind, r) + "\n";
  for (const std::string& warning : r.warnings) text += say("warning: {}\n", quote(warning));
  if (r.ok) return text + say("accepted\n");
  text += say("REFUSED\n");
  for (const calib::Reason& reason : r.reasons)
    text += say("  {}: {}\n    cure: {}\n", calib::name(reason.code), quote(reason.text), quote(reason.cure));
  return text;
}

void write_hand_eye(report::Json& json, ArtefactKind kind, const HandEye& r, const calib::StatedNoise& noise) {
  json.field("kind", kind).field("status", r.ok ? "ok" : "refused");
  json.field("reasons", r.reasons);
  json.field("warnings", r.warnings).field("maps", "scanner coordinates to flange coordinates");
  const KukaAbc abc = kuka_abc_from_rotation(r.T_flange_scanner.rotation);
  const Vec3& t = r.T_flange_scanner.translation_mm;
  const std::array kuka = {
      t.x(), t.y(), t.z(), deg_from_rad(abc.a_rad), deg_from_rad(abc.b_rad), deg_from_rad(abc.c_rad)};
  json.field("T_flange_scanner", report::only_if(r.determined, r.T_flange_scanner));
  json.field("T_flange_scanner_matrix", report::only_if(r.determined, r.T_flange_scanner.matrix()));
  json.field("T_flange_scanner_kuka_xyzabc_deg", report::only_if(r.determined, kuka));
  write_target(json, kind, r);
  json.field("residual_mm", r.residual_mm);
  json.field("residual_deg", r.residual_deg);
  json.field("leave_one_out_mm", r.leave_one_out_mm);
  json.field("leave_one_out_deg", r.leave_one_out_deg);
  json.field("s0", r.s0).field("s0_position", r.s0_position).field("s0_rotation", r.s0_rotation);
  json.field("reweighted", r.reweighted).field("robot_lever", r.robot_lever).field("condition", r.condition);
  json.field("lambda", r.scale).field("lambda_sigma", r.scale_sigma);
  json.field("rotation_spread_deg", r.rotation_spread_deg);
  json.field("rotation_spread_axes_deg", r.rotation_spread_axes_deg);
  json.field("ball_spread_axes_mm", r.ball_spread_axes_mm);
  json.field("predicted_point_sigma_mm", r.predicted_point_sigma_mm);
  json.field("point_sigma_limit_mm", r.point_sigma_limit_mm).field("covariance", r.covariance);
  json.list("rejected", r.rejected, [&](const std::size_t i) { return r.views[i].number; });
  json.field("worst_view", r.views[r.worst_view].number).key("stated_noise").begin_object();
  json.field("robot_sigma_mm", noise.robot_mm).field("robot_sigma_deg", deg_from_rad(noise.robot_rad));
  json.field("target_sigma_mm", noise.target_mm).field("target_sigma_deg", deg_from_rad(noise.target_rad)).end_object();
  json.field("views", r.views);
  write_conventions(json, r.conventions);
}

}  // namespace slabd::cli
