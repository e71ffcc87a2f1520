// SPDX-License-Identifier: Apache-2.0
//
// Where a calibration stands and what to do next, told after every step of it.
#include <fmt/core.h>

#include <cmath>

#include "cli/calibrate/calibrate.h"
#include "cli/calibrate/session.h"

namespace slabd::cli {
namespace {

using calib::ArtefactKind;
using calib::Guide;
using calib::ViewUse;

std::size_t counted(const Session& session) {
  return session.counted(ViewUse::fit) + session.counted(ViewUse::held_out);
}

std::string sigma(double mm) {
  return has_value(mm) ? fmt::format("{:.3f} mm", mm) : "not determined yet";
}

/// KUKA's six numbers, mm and deg.
std::array<double, 6> kuka_of(const Pose& pose) {
  const KukaAbc abc = kuka_abc_from_rotation(pose.rotation);
  const Vec3& t = pose.translation_mm;
  return {t.x(), t.y(), t.z(), deg_from_rad(abc.a_rad), deg_from_rad(abc.b_rad), deg_from_rad(abc.c_rad)};
}

std::string coverage_text(const Session& session, const Guide& guide) {
  const calib::Coverage& c = guide.coverage;
  std::string text = fmt::format(
      "view {}/{} ({} for the fit, {} held out); turned {:.0f}/{:.0f}/{:.0f} deg; tilted to {} of {} sides; ",
      counted(session), session.settings().goal, session.counted(ViewUse::fit), session.counted(ViewUse::held_out),
      c.rotation_spread_axes_deg[0], c.rotation_spread_axes_deg[1], c.rotation_spread_axes_deg[2], c.sectors_seen(),
      calib::kSectors);
  text += fmt::format("{} of {} places in the view\n", c.cells_seen(), calib::kPlaces * calib::kDepths);
  if (has_value(guide.misfit_mm))
    return text +
           fmt::format(
               "THE VIEWS DO NOT FIT EACH OTHER: they miss by {:.2f} mm (rms); slabctl calibrate solve says why\n",
               guide.misfit_mm);
  text += fmt::format("predicted point error (1 sigma): {}", sigma(c.point_sigma_mm));
  if (guide.next && has_value(guide.next->point_sigma_mm))
    text += fmt::format(", {} after the next view", sigma(guide.next->point_sigma_mm));
  return text + "\n";
}

}  // namespace

std::string next_command(const Session& session) {
  if (counted(session) < session.settings().goal) return "slabctl calibrate capture";
  if (!session.solution_is_current()) return "slabctl calibrate solve";
  if (!session.solution()->record.ok) return "slabctl calibrate capture";
  return session.solution()->verified ? "slabctl calibrate apply" : "slabctl calibrate verify";
}

std::string guide_text(const Session& session, const Guide& guide) {
  const ArtefactKind kind = session.settings().kind;
  std::string text;
  if (guide.coverage.views == 0) {
    const calib::FieldOfView& fov = session.settings().fov;
    return fmt::format(
        "first view: look straight down at the {}, in the middle of the view, {:.0f} mm from the scanner, and stand "
        "still; then\n  slabctl calibrate capture --live        (through the running daemon)\n  slabctl calibrate "
        "capture --scan FILE --flange \"POSE\"\n",
        kind == ArtefactKind::ball ? "ball" : "artefact", 0.5 * (fov.near_mm + fov.far_mm));
  }
  text += coverage_text(session, guide);
  if (counted(session) >= session.settings().goal)
    return text + fmt::format("goal reached; next: {}\n", next_command(session));
  for (const std::string& words : calib::missing_words(guide.coverage, kind)) text += "  " + words + "\n";
  if (!guide.next) {
    text += "next view: tilt 20 to 35 deg to a side not tilted to yet, into another corner of the view\n";
    return text;
  }
  const calib::Suggestion& next = *guide.next;
  const std::array<double, 7> q = next.T_base_flange.to_array();
  const std::array<double, 6> k = kuka_of(next.T_base_flange);
  text += fmt::format("next view: {}\n", calib::suggestion_words(next, kind));
  text += fmt::format("  T_base_flange  {:.2f} {:.2f} {:.2f} {:.6f} {:.6f} {:.6f} {:.6f}    x y z qw qx qy qz, mm\n",
                      q[0], q[1], q[2], q[3], q[4], q[5], q[6]);
  text += fmt::format("  KUKA           X {:.2f}, Y {:.2f}, Z {:.2f}, A {:.3f}, B {:.3f}, C {:.3f}    mm, deg\n", k[0],
                      k[1], k[2], k[3], k[4], k[5]);
  if (next.place_sigma_mm > 10.0)
    text += fmt::format(
        "  the scanner's place is not well known yet: expect the {} within {:.0f} mm of there, and drive by the "
        "picture\n",
        kind == ArtefactKind::ball ? "ball" : "artefact", 2.0 * next.place_sigma_mm);
  return text + "  drive there with care for cables and fixtures: only the geometry is known here\n";
}

void write_guide(Json& json, const Session& session, const Guide& guide) {
  const calib::Coverage& c = guide.coverage;
  json.key("coverage").begin_object().field("views", counted(session)).field("goal", session.settings().goal);
  json.field("fit", session.counted(ViewUse::fit)).field("held_out", session.counted(ViewUse::held_out));
  json.field("rotation_spread_axes_deg", c.rotation_spread_axes_deg).field("sectors_seen", c.sectors_seen());
  json.field("sectors", calib::kSectors).field("places_seen", c.cells_seen());
  json.field("places", calib::kPlaces * calib::kDepths).field("predicted_point_sigma_mm", c.point_sigma_mm);
  json.field("misfit_mm", guide.misfit_mm).field("missing", calib::missing_words(c, session.settings().kind));
  json.end_object();
  json.key("suggestion");
  if (!guide.next || counted(session) >= session.settings().goal) {
    json.null();
  } else {
    const calib::Suggestion& next = *guide.next;
    json.begin_object().field("words", calib::suggestion_words(next, session.settings().kind));
    json.field("T_base_flange", next.T_base_flange).field("kuka_xyzabc_deg", kuka_of(next.T_base_flange));
    json.field("tilt_deg", next.tilt_deg).field("towards", calib::sector_words(next.sector));
    json.field("roll_deg", next.roll_deg).field("place", calib::place_words(next.place, next.depth));
    json.field("target_scanner_mm", next.target_scanner).field("place_sigma_mm", next.place_sigma_mm);
    json.field("predicted_point_sigma_mm", next.point_sigma_mm).end_object();
  }
  json.field("next", next_command(session));
}

void write_session(Json& json, const Session& session) {
  json.field("session", session.settings().name).field("folder", session.dir());
}

}  // namespace slabd::cli
