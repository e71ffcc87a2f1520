// SPDX-License-Identifier: Apache-2.0
//
// slabctl calibrate list, drop, undo: lists the session's views and excludes views from it. Nothing is deleted.
#include <fmt/core.h>

#include <cmath>
#include <map>
#include <memory>

#include "cli/calibrate/calibrate.h"
#include "cli/calibrate/session.h"
#include "cli/client/calibration_change.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/render.h"
#include "cli/terminal/say.h"

namespace slabd::cli {
namespace {

struct Options {
  SessionOptions session;
  std::size_t number = 0;
  std::string why;
  bool json = false;
};

using calib::ViewUse;

std::string state_of(const Session::Entry& e) {
  if (!e.unreadable.empty()) return "UNREADABLE";
  if (e.undone) return "undone";
  if (e.dropped_step != 0) return "dropped";
  switch (e.view.use) {
    case ViewUse::fit: return "fit";
    case ViewUse::held_out: return "held out";
    case ViewUse::refused: break;
  }
  return "refused";
}

std::string note_of(const Session::Entry& e) {
  if (!e.unreadable.empty()) return e.unreadable;
  if (e.dropped_step != 0) return e.dropped_why;
  if (!e.view.accepted()) return say("{}: {}", e.view.refusal, quote(e.view.reason));
  return "";
}

/// Residuals of every counted view in the solution, by number; empty without a current solution.
std::map<std::size_t, calib::ViewFit> fits_of(const Session& session) {
  std::map<std::size_t, calib::ViewFit> fits;
  if (!session.solution_is_current()) return fits;
  const auto fit = session.views(ViewUse::fit);
  const auto held_out = session.views(ViewUse::held_out);
  if (!fit.ok() || !held_out.ok()) return fits;
  calib::SolveSettings quick = session.solve_settings();
  quick.convention_test = false;
  const auto solved = calib::solve(session.settings().kind, fit.value(), session.settings().noise, quick);
  if (!solved.ok() || !solved.value().determined) return fits;
  for (const calib::ViewFit& view : solved.value().views) fits[view.number] = view;
  for (const calib::ViewFit& view :
       calib::residuals_of(session.settings().kind, held_out.value(), solved.value().T_flange_scanner,
                           solved.value().targets, session.settings().noise))
    fits[view.number] = view;
  return fits;
}

std::string number(double v, int digits) {
  return has_value(v) ? fmt::format("{:.{}f}", v, digits) : "-";
}

double tilt_of(const Session& session, const Session::Entry& e, const calib::Guide& guide) {
  const auto pose = calib::parse_flange(e.view.flange_form, e.view.flange, "");
  if (!guide.T_flange_scanner || !pose.ok()) return kNoValue;
  return calib::tilt_deg(pose.value(), *guide.T_flange_scanner, session.settings().down_base);
}

std::string view_table(const Session& session, const calib::Guide& guide) {
  const std::map<std::size_t, calib::ViewFit> fits = fits_of(session);
  report::Table table{say("view"),       say("use<"),     say("points"),           say("cap deg"),     say("rms mm"),
                      say("radius off"), say("tilt deg"), say("seen at x y z mm"), say("residual mm"), say("note<")};
  for (const Session::Entry& e : session.entries()) {
    const calib::CapturedView& v = e.view;
    const Vec3& p = v.T_scanner_target.translation_mm;
    const auto fit = fits.find(v.number);
    std::string note = note_of(e);
    if (fit != fits.end() && !fit->second.kept) note = say("rejected by the solution: look at its scan, or drop it");
    const bool readable = e.unreadable.empty();
    table.add(v.number, translated(state_of(e)), readable ? std::to_string(v.points) : "-", number(v.half_angle_deg, 0),
              number(v.rms_mm, 3), number(v.radius_off_mm, 3), readable ? number(tilt_of(session, e, guide), 0) : "-",
              readable && v.accepted() ? fmt::format("{:.0f} {:.0f} {:.0f}", p.x(), p.y(), p.z()) : "-",
              fit != fits.end() ? number(fit->second.residual_mm, 3) : "-", note);
  }
  return report::text_of(table);
}

void write_views(report::Json& json, const Session& session, const calib::Guide& guide) {
  const std::map<std::size_t, calib::ViewFit> fits = fits_of(session);
  json.list("views", session.entries(), [&](const Session::Entry& e) {
    const calib::CapturedView& v = e.view;
    const auto fit = fits.find(v.number);
    json.field("view", v.number).field("use", state_of(e)).field("counts", e.counts()).field("note", note_of(e));
    json.field("captured", v.captured).field("points", v.points).field("half_angle_deg", v.half_angle_deg);
    json.field("rms_mm", v.rms_mm).field("radius_off_mm", v.radius_off_mm).field("repeat_mm", v.repeat_mm);
    json.field("tilt_deg", e.unreadable.empty() ? tilt_of(session, e, guide) : kNoValue);
    json.field("T_scanner_target", report::only_if(e.unreadable.empty() && v.accepted(), v.T_scanner_target));
    json.field("residual_mm", fit != fits.end() ? fit->second.residual_mm : kNoValue);
    json.field("kept", fit == fits.end() || fit->second.kept);
    json.list("shots", v.shots, [&](const calib::KeptShot& shot) { return e.folder + "/" + shot.file; });
  });
}

void write_solution(report::Json& json, const Session& session) {
  json.key("solution");
  if (!session.solution()) {
    json.null();
    return;
  }
  const calib::SolvedRecord& solved = session.solution()->record;
  json.begin_object().field("id", solved.id).field("status", solved.ok ? "ok" : "refused");
  json.field("current", session.solution_is_current()).field("when", solved.when);
  json.field("predicted_point_sigma_mm", solved.point_sigma_mm).field("s0", solved.s0);
  json.field("inputs_sha256", solved.inputs).field("figures_sha256", solved.figures);
  json.field("verified", session.solution()->verified.has_value()).end_object();
}

int list(const Options& options) {
  set_language(options.session.language, options.json);
  const Session session = find_session(options.session);
  const calib::Guide guide = session.guide();
  if (options.json) {
    report::Json json("slabd.calibration_session/1");
    write_session(json, session);
    json.field("kind", session.settings().kind).field("created", session.settings().created);
    json.field("operator", session.settings().operator_name).field("half_done", session.half_done());
    write_views(json, session, guide);
    write_solution(json, session);
    write_guide(json, session, guide);
    fmt::print("{}", json.text());
    return kDone;
  }
  fmt::print("{}", say("{}, begun {} by {}\n", session_words(session), session.settings().created,
                       session.settings().operator_name));
  for (const std::string& words : session.half_done()) fmt::print("{}", say("note: {}\n", words));
  if (!session.entries().empty()) fmt::print("{}", view_table(session, guide));
  if (session.solution()) {
    const calib::SolvedRecord& solved = session.solution()->record;
    fmt::print("{}", say("solved {} as {}{}: predicted point error {} mm{}\n", solved.when, solved.id,
                         solved.ok ? "" : say(" (REFUSED, stored only)"), number(solved.point_sigma_mm, 3),
                         !session.solution_is_current() ? say("; the views have changed since: solve again")
                         : session.solution()->verified ? say("; verified")
                                                        : say("; not verified yet")));
  }
  fmt::print("{}", guide_text(session, guide));
  return kDone;
}

/// Output of drop and undo: the change, and the state of the session.
int tell_change(const Options& options, const Session& session, const std::string& what) {
  const calib::Guide guide = session.guide();
  session.leave_next_pose(guide);
  if (options.json) {
    report::Json json("slabd.calibration_session_change/1");
    write_session(json, session);
    json.field("done", what);
    write_guide(json, session, guide);
    fmt::print("{}", json.text());
  } else {
    fmt::print("{}\n{}\n{}", session_words(session), what, guide_text(session, guide));
  }
  return kDone;
}

int drop(const Options& options) {
  set_language(options.session.language, options.json);
  Session session = find_session(options.session);
  need(session.lock());
  need(session.drop(options.number, default_operator(), options.why));
  return tell_change(
      options, session,
      say("view {} is dropped ({}); slabctl calibrate undo brings it back", options.number, options.why));
}

int undo(const Options& options) {
  set_language(options.session.language, options.json);
  Session session = find_session(options.session);
  need(session.lock());
  const std::string undone = need(session.undo(default_operator()));
  return tell_change(options, session, undone);
}

}  // namespace

void add_calibrate_list(args::Command& group) {
  auto options = std::make_shared<Options>();
  args::Command command = group.add_subcommand("list", "The session: every view, what is missing, where to drive next");
  command->footer("\nExample: slabctl calibrate list");
  options->session.add_to(*command);
  command->add_flag("--json", options->json, "Print slabd.calibration_session/1 on stdout");
  command->runs([options] { return list(*options); });
}

void add_calibrate_drop(args::Command& group) {
  auto options = std::make_shared<Options>();
  args::Command command = group.add_subcommand("drop", "Leave a view out of everything; its scans stay");
  command->footer("\nExample: slabctl calibrate drop 7 --reason \"an operator leaned on the post\"");
  command->add_option("VIEW", options->number, "Its number in `list`")->required()->check(args::range(1, 9999));
  command->add_option("--reason", options->why, "Why; kept with the view")->required()->check(some_words());
  options->session.add_to(*command);
  command->add_flag("--json", options->json, "Print slabd.calibration_session_change/1 on stdout");
  command->runs([options] { return drop(*options); });
}

void add_calibrate_undo(args::Command& group) {
  auto options = std::make_shared<Options>();
  args::Command command = group.add_subcommand("undo", "Take back the newest capture or drop; again: the one before");
  command->footer("\nExample: slabctl calibrate undo");
  options->session.add_to(*command);
  command->add_flag("--json", options->json, "Print slabd.calibration_session_change/1 on stdout");
  command->runs([options] { return undo(*options); });
}

// State of a calibration and next step, printed after every step.

namespace {

using calib::ArtefactKind;
using calib::Guide;
using calib::ViewUse;

std::size_t counted(const Session& session) {
  return session.counted(ViewUse::fit) + session.counted(ViewUse::held_out);
}

std::string sigma(double mm) {
  return has_value(mm) ? fmt::format("{:.3f} mm", mm) : say("not determined yet");
}

/// KUKA's six numbers, mm and deg.
std::array<double, 6> kuka_of(const Pose& pose) {
  const KukaAbc abc = kuka_abc_from_rotation(pose.rotation);
  const Vec3& t = pose.translation_mm;
  return {t.x(), t.y(), t.z(), deg_from_rad(abc.a_rad), deg_from_rad(abc.b_rad), deg_from_rad(abc.c_rad)};
}

std::string target_word(ArtefactKind kind) {
  return kind == ArtefactKind::ball ? say("ball") : say("artefact");
}

std::string coverage_text(const Session& session, const Guide& guide) {
  const calib::Coverage& c = guide.coverage;
  std::string text =
      say("view {}/{} ({} for the fit, {} held out); turned {:.0f}/{:.0f}/{:.0f} deg; tilted to {} of {} sides; ",
          counted(session), session.settings().goal, session.counted(ViewUse::fit), session.counted(ViewUse::held_out),
          c.rotation_spread_axes_deg[0], c.rotation_spread_axes_deg[1], c.rotation_spread_axes_deg[2], c.sectors_seen(),
          calib::kSectors);
  text += say("{} of {} places in the view\n", c.cells_seen(), calib::kPlaces * calib::kDepths);
  if (has_value(guide.misfit_mm))
    return text +
           say("THE VIEWS DO NOT FIT EACH OTHER: they miss by {:.2f} mm (rms); slabctl calibrate solve shows why\n",
               guide.misfit_mm);
  text += say("predicted point error (1 sigma): {}", sigma(c.point_sigma_mm));
  if (guide.next && has_value(guide.next->point_sigma_mm))
    text += say(", {} after the next view", sigma(guide.next->point_sigma_mm));
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
    return say(
        "first view: look straight down at the {}, in the middle of the view, {:.0f} mm from the scanner, and stand "
        "still; then\n  slabctl calibrate capture --live        (through the running daemon)\n  slabctl calibrate "
        "capture --scan FILE --flange \"POSE\"\n",
        target_word(kind), 0.5 * (fov.near_mm + fov.far_mm));
  }
  text += coverage_text(session, guide);
  if (counted(session) >= session.settings().goal) return text + say("goal reached; next: {}\n", next_command(session));
  for (const std::string& words : calib::missing_words(guide.coverage, kind)) text += "  " + quote(words) + "\n";
  if (!guide.next) {
    text += say("next view: tilt 20 to 35 deg to a side not tilted to yet, into another corner of the view\n");
    return text;
  }
  const calib::Suggestion& next = *guide.next;
  const std::array<double, 7> q = next.T_base_flange.to_array();
  const std::array<double, 6> k = kuka_of(next.T_base_flange);
  text += say("next view: {}\n", quote(calib::suggestion_words(next, kind)));
  text += fmt::format("  T_base_flange  {:.2f} {:.2f} {:.2f} {:.6f} {:.6f} {:.6f} {:.6f}    x y z qw qx qy qz, mm\n",
                      q[0], q[1], q[2], q[3], q[4], q[5], q[6]);
  text += fmt::format("  KUKA           X {:.2f}, Y {:.2f}, Z {:.2f}, A {:.3f}, B {:.3f}, C {:.3f}    mm, deg\n", k[0],
                      k[1], k[2], k[3], k[4], k[5]);
  if (next.place_sigma_mm > 10.0)
    text +=
        say("  the scanner's place is not well known yet: expect the {} within {:.0f} mm of there, and drive by the "
            "picture\n",
            target_word(kind), 2.0 * next.place_sigma_mm);
  return text + say("  drive there with care for cables and fixtures: only the geometry is known here\n");
}

void write_guide(report::Json& json, const Session& session, const Guide& guide) {
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

void write_session(report::Json& json, const Session& session) {
  json.field("session", session.settings().name).field("folder", session.dir());
}

}  // namespace slabd::cli
